"""Rotation that derotation leaves in rendered pairs, and its time: python benchmarks/derotation.py [--scenes N].

Nominal pairs of the fixed test sets (rooms; outdoors, 256 px, 90 degrees), the earlier picture turned about a random
axis; each is told its true displacement. Times are processor time on one thread.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence

import cv2
import numpy as np

from flightdepth.camera import Camera
from flightdepth.ranges.remainder import Remainder, remainder
from flightdepth.ranges.tracks import Corners
from flightdepth.stillbox import OutdoorTestSet, PairRule, Picture, TestSet
from flightdepth.stillbox.motion_noise import rotated
from flightdepth.stillbox.testset import TestPair

DEGREES = (0.0, 0.1, 0.5, 2.0, 4.0)
CAMERA = Camera.from_fov(256, 256, 90)


def turn_of(number: int, degrees: float) -> np.ndarray:
    """A rotation vector (3,), radians, about an axis drawn for the pair."""
    axis = np.random.default_rng(number).normal(size=3)
    return np.asarray(axis / np.linalg.norm(axis) * np.radians(degrees))


def timed(pair: TestPair, turn: np.ndarray) -> tuple[Remainder | None, tuple[float, float, float]]:
    """What is found in a pair that was turned, and ms for corners, tracks, solution."""
    previous = rotated(pair.previous, CAMERA, turn)
    stamps = [time.process_time()]
    corners = Corners(pair.current, CAMERA)
    stamps.append(time.process_time())
    rays = corners.rays(previous)
    stamps.append(time.process_time())
    found = remainder(*rays, pair.displacement, CAMERA)
    stamps.append(time.process_time())
    spent = np.diff(stamps) * 1e3
    return found, (spent[0], spent[1], spent[2])


def report(name: str, pairs: Sequence[TestPair]) -> None:
    """Print a line for each turn: what is left of it, pairs that are said to turn, and times."""
    for degrees in DEGREES:
        turns = [turn_of(number, degrees) for number in range(len(pairs))]
        found = [timed(pair, turn) for pair, turn in zip(pairs, turns, strict=True)]
        left = [
            np.degrees(np.linalg.norm(turn if one is None else one.rotation - turn))
            for (one, _), turn in zip(found, turns, strict=True)
        ]
        said = sum(one is not None and one.turns for one, _ in found)
        ms = np.median([spent for _, spent in found], axis=0)
        print(
            f"{name:10}{degrees:5.1f}{np.median(left):8.3f}{np.percentile(left, 90):8.3f}{said:5d}"
            + "".join(f"{each:8.2f}" for each in ms)
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=60)
    scenes = parser.parse_args().scenes
    cv2.setNumThreads(1)
    print("degrees turned by and left (median, 90 %), pairs said to turn, ms: corners, tracks, solution")
    report("rooms", list(TestSet(Picture(256, 256, 256), PairRule(), scenes=scenes)))
    report("outdoors", list(OutdoorTestSet(256, scenes)))


if __name__ == "__main__":
    main()
