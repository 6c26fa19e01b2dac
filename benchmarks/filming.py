"""What compressed pictures cost: `python benchmarks/compression.py [--networks NAME ...] [--times N] [--scenes N]`.

The first rooms of each network's fixed test set: as they were drawn, as JPEGs of several qualities, and as two frames
of an H.264 video of several qualities (x264's constant rate factor: 23 where nobody says, more is worse). With
`--times` they are compressed so many times as large and then scaled down, as the pictures of a flight are.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from flightdepth.commands.terminal import counted
from flightdepth.evaluation.fixed_set import fixed_set
from flightdepth.evaluation.network import evaluate_network
from flightdepth.evaluation.provenance import origin_of
from flightdepth.runtimes.network import load_network
from flightdepth.stillbox import Picture, TestPair, TestSet
from flightdepth.stillbox.h264 import through_h264
from flightdepth.stillbox.pairs import Image
from flightdepth.stillbox.photometric import through_jpeg
from flightdepth.weights.card import NetworkCard

JPEG_QUALITIES = (95, 80, 60)
RATE_FACTORS = (18, 23, 28)


Pictures = tuple[Image, Image]


def by_jpeg(pictures: Pictures, quality: int) -> Iterable[Image]:
    return (through_jpeg(picture, quality) for picture in pictures)


def ways() -> dict[str, Callable[[Pictures], Iterable[Image]]]:
    jpeg = {f"JPEG of quality {quality}": partial(by_jpeg, quality=quality) for quality in JPEG_QUALITIES}
    video = {f"H.264, factor {factor}": partial(through_h264, rate_factor=factor) for factor in RATE_FACTORS}
    return {"as drawn": iter} | jpeg | video


def seen(large: TestPair, way: Callable[[Pictures], Iterable[Image]], times: int) -> TestPair:
    """The pair compressed, then scaled down."""
    previous, current = (shrunk(picture, times) for picture in way((large.previous, large.current)))
    depth_m = np.ascontiguousarray(large.depth_m[times // 2 :: times, times // 2 :: times])
    return TestPair(previous, current, depth_m, large.displacement, large.focal_px / times)


def shrunk(picture: Image, times: int) -> Image:
    size = picture.shape[1] // times, picture.shape[0] // times
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)


def large_rooms(card: NetworkCard, scenes: int, times: int) -> TestSet:
    rooms = fixed_set(card, scenes=scenes)
    drawn = rooms.picture
    return replace(
        rooms, picture=Picture(times * drawn.width, times * drawn.height, times * drawn.full_width)
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--networks", nargs="+", default=["motion", "depthnet-256", "tiny-clamped-256"])
    parser.add_argument("--times", type=int, default=1)
    parser.add_argument("--scenes", type=int, default=60)
    options = parser.parse_args()
    for name in options.networks:
        network = load_network(name, "openvino", precision="f32")
        pairs = list(large_rooms(network.card, options.scenes, options.times))
        title = f"{network.card.name}, {len(pairs)} rooms, compressed {options.times} times as large"
        table = Table("", "L1 m", "relative", "classical peer, L1 m", title=title, caption=origin_of(network))
        for way, compressed in ways().items():
            shown = (seen(pair, compressed, options.times) for pair in counted(pairs, way, "pairs"))
            found = evaluate_network(network, shown, set_name=way)
            cells = (found["network"]["l1_m"], found["network"]["abs_rel"], found["classical"]["l1_m"])
            table.add_row(way, *(f"{value:.3f}" for value in cells))
        Console().print(table)


if __name__ == "__main__":
    main()
