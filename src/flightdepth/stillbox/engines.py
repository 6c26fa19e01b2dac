"""Scenes in the order of their numbers, rendered by the threads of this process or on a Ray cluster.

The bytes are the same either way: each scene follows from its number alone.
"""

from __future__ import annotations

import logging
import os
import socket
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from itertools import islice
from typing import Any, TypeVar

from flightdepth.errors import BadInput, FlightDepthError
from flightdepth.scenes import Textures
from flightdepth.stillbox.encoding import EncodedScene, Source

SCENES_PER_TASK = 4
KNOCK_S = 5.0
LONGEST_CAUSE = 200  # characters of somebody else's error
Work = TypeVar("Work")
Ticket = TypeVar("Ticket")


def on_threads(
    source: Source, textures: Textures, numbers: range, threads: int | None = None
) -> Generator[EncodedScene]:
    """Scenes `numbers`, a core each; only a few wait to be taken."""
    count = threads or os.cpu_count() or 1
    with ThreadPoolExecutor(count, thread_name_prefix="render") as executor:
        try:
            waiting = _ahead(
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

    os.environ.setdefault("RAY_IGNORE_UNHANDLED_ERRORS", "1")  # the first failure is raised, which is enough
    ranges = [numbers[first : first + SCENES_PER_TASK] for first in range(0, len(numbers), SCENES_PER_TASK)]
    with _cluster(ray, address) as cores:
        shared, task = ray.put(textures), ray.remote(num_cpus=1)(_encoded_range)
        for part, reference in zip(
            ranges, _ahead(ranges, lambda part: task.remote(source, shared, part), 2 * cores), strict=True
        ):
            try:
                yield from ray.get(reference)
            except ray.exceptions.RayError as error:
                raise _failed(part, error) from error


def _ahead(work: Iterable[Work], submit: Callable[[Work], Ticket], most: int) -> Iterator[Ticket]:
    """Tickets in the order of the work, `most` submitted ahead of the one that is taken."""
    rest = iter(work)
    waiting = deque(submit(each) for each in islice(rest, most))
    while waiting:
        yield waiting.popleft()
        waiting.extend(submit(each) for each in islice(rest, 1))


def _encoded_range(source: Source, textures: Textures, numbers: range) -> list[EncodedScene]:
    return [source.encoded(number, textures) for number in numbers]


@contextmanager
def _cluster(ray: Any, address: str | None) -> Iterator[int]:
    """The cores of a cluster that is ours for a while; one that this process has joined already is used as it is."""
    joined = ray.is_initialized()
    if not joined:
        if address not in (None, "auto"):
            _knock(address)
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # nothing is reported to anybody
        quiet = {"logging_level": logging.ERROR, "log_to_driver": False}
        try:
            ray.init(address=address or "local", **quiet, **({} if address else {"include_dashboard": False}))
        except (ConnectionError, ValueError, RuntimeError) as error:
            raise BadInput(
                "--address", expected="a Ray cluster", got=f"{address} ({_short(error)})"
            ) from error
    try:
        yield max(1, int(ray.cluster_resources().get("CPU", 1)))
    finally:
        if not joined:
            ray.shutdown()


def _knock(address: str) -> None:
    """Ray itself tries for minutes where nobody answers."""
    expected = "HOST:PORT of a Ray cluster's head, or auto"
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not (host and port.isdecimal()):
        raise BadInput("--address", expected=expected, got=address)
    try:
        socket.create_connection((host, int(port)), KNOCK_S).close()
    except (OSError, OverflowError) as error:
        raise BadInput("--address", expected=expected, got=f"{address} ({error})") from error


def _failed(numbers: range, error: Exception) -> FlightDepthError:
    """One line for what went wrong in a task; its own error where it raised one."""
    cause = getattr(error, "cause", None) or error
    if isinstance(cause, FlightDepthError):
        return cause
    return FlightDepthError(
        f"rendering scenes {numbers[0]}-{numbers[-1]} on Ray: {type(cause).__name__}: {_short(cause)}"
    )


def _short(error: BaseException) -> str:
    lines = str(error).strip().splitlines() or [type(error).__name__]
    return lines[0][:LONGEST_CAUSE]
