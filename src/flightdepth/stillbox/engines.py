"""Scenes in the order of their numbers, rendered by the threads of this process or on a Ray cluster.

The bytes are the same either way: each scene follows from its number alone.
"""

from __future__ import annotations

from collections.abc import Generator
from concurrent.futures import ThreadPoolExecutor

from flightdepth.cluster import ahead, cluster, failed
from flightdepth.machine import usable_cores
from flightdepth.renderers.raycast import scenes_in_memory
from flightdepth.scenes import Textures
from flightdepth.stillbox.encoding import EncodedScene, Source

SCENES_PER_TASK = 4


def on_threads(
    source: Source, textures: Textures, numbers: range, threads: int | None = None
) -> Generator[EncodedScene]:
    """Scenes `numbers`, a core each where memory allows; only a few wait to be taken."""
    drawn = source.scenes
    room = scenes_in_memory(drawn.camera, drawn.config.frames) / 2  # as many again wait, encoded
    count = threads or int(max(1, min(usable_cores(), room)))
    with ThreadPoolExecutor(count, thread_name_prefix="render") as executor:
        try:
            waiting = ahead(
                numbers, lambda number: executor.submit(source.encoded, number, textures), 2 * count
            )
            for future in waiting:
                yield future.result()
        finally:  # also when nobody takes the rest
            executor.shutdown(wait=True, cancel_futures=True)


def on_ray(
    source: Source, textures: Textures, numbers: range, address: str | None = None
) -> Generator[EncodedScene]:
    """Scenes `numbers` from a Ray cluster: the one at `address` ("auto": where Ray says), else one on this machine.

    The textures go to each machine once. Tasks send encoded scenes back, so that no disk need be shared. A task whose
    worker dies is run again (Ray's three times).

    Raises:
        BadInput: there is no cluster at `address`.
        FlightDepthError: a task failed, or its workers died each time.
    """
    import ray

    ranges = [numbers[first : first + SCENES_PER_TASK] for first in range(0, len(numbers), SCENES_PER_TASK)]
    with cluster(ray, address) as cores:
        shared, task = ray.put(textures), ray.remote(num_cpus=1)(_encoded_range)
        for part, reference in zip(
            ranges, ahead(ranges, lambda part: task.remote(source, shared, part), 2 * cores), strict=True
        ):
            try:
                yield from ray.get(reference)
            except ray.exceptions.RayError as error:
                raise failed(f"rendering scenes {part[0]}-{part[-1]}", error) from error


def _encoded_range(source: Source, textures: Textures, numbers: range) -> list[EncodedScene]:
    return [source.encoded(number, textures) for number in numbers]
