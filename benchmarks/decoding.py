"""What a video's pictures cost before any depth: decoding them, and turning them into RGB.

    python benchmarks/decoding.py [VIDEO] --sizes 640x360 1920x1080 --busy 1

Milliseconds by the clock a picture (median): decoded on all threads, turned into RGB as flights read it
(`flight/display_matrix.py`) and as PyAV does unless told otherwise, with the same bytes. Without sizes the video's own.
`--busy` keeps some cores at work meanwhile, as a network does.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any

import av
import numpy as np

from flightdepth.commands.demo import VIDEO
from flightdepth.flight.display_matrix import Turn, turned_upright


def as_flights_do(picture: Any) -> Any:
    return turned_upright(picture, Turn(0, False))


def by_default(picture: Any) -> Any:
    return picture.to_ndarray(format="rgb24")


def clocked_ms(work: Callable[[Any], Any], given: Any) -> tuple[float, Any]:
    """How long it takes, and what it gives."""
    began = time.perf_counter()
    made = work(given)
    return 1e3 * (time.perf_counter() - began), made


def as_decoded(picture: Any, width: int, height: int) -> Any:
    """Scaled, and without a converter, which a picture keeps once it was converted."""
    scaled = picture.reformat(width, height, picture.format.name)
    return av.VideoFrame.from_ndarray(scaled.to_ndarray(), picture.format.name)


@contextmanager
def busy(cores: int) -> Iterator[None]:
    workers = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(cores)]
    try:
        yield
    finally:
        for worker in workers:
            worker.kill()
            worker.wait()


def report(path: Path, sizes: list[str], count: int) -> None:
    with av.open(str(path)) as container:
        container.streams.video[0].thread_type = "AUTO"
        spent_ms, pictures = clocked_ms(lambda video: list(islice(video.decode(video=0), count)), container)
    own = f"{pictures[0].width}x{pictures[0].height}"
    print(f"{path.name}, {own}: {spent_ms / len(pictures):.2f} ms a picture to decode")
    for size in sizes or [own]:
        width, height = map(int, size.split("x"))
        spent: dict[Callable[[Any], Any], list[float]] = {as_flights_do: [], by_default: []}
        for picture in pictures:
            images = []
            for way, all_ms in spent.items():
                one_ms, image = clocked_ms(way, as_decoded(picture, width, height))
                all_ms.append(one_ms)
                images.append(image)
            assert np.array_equal(*images)
        ours, theirs = (np.median(each) for each in spent.values())
        print(
            f"{size} to RGB: {ours:.2f} ms, by PyAV's default {theirs:.2f}, {theirs / ours:.1f} times as long"
        )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("video", nargs="?", type=Path, default=VIDEO)
    parser.add_argument("--sizes", nargs="+", default=[], metavar="WxH", help="pictures scaled to these")
    parser.add_argument("--count", type=int, default=60, help="pictures of each size")
    parser.add_argument("--busy", type=int, default=0, metavar="CORES")
    args = parser.parse_args()
    with busy(args.busy):
        report(args.video, args.sizes, args.count)


if __name__ == "__main__":
    main()
