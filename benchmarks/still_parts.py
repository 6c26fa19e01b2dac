"""What stands still in every picture, with a mask and without: the sample flight with a leg or with text drawn into it.

    python benchmarks/still_parts.py [--find [--untold]]

Prints how much of the leg or text is given a depth, and how much is told to be "farther than"; then the mean relative
error and the share with depth of what is no sky: within 20 px of it, and elsewhere. Four seconds that fly ahead.

--find: how much of it, of a blank leg too, and how much else is proposed for a mask in flights of `turns.py`, whose
camera pans at 90 degrees a second for 1.2 s. It is drawn before H.264. --untold: for six seconds it swings at
up to 45 degrees a second, and no log tells its attitude: how it turns is seen in the same pictures.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.commands.demo import AT_TRUTH, CALIBRATION, LOG, TRUTH, VIDEO
from flightdepth.evaluation.provenance import origin_of
from flightdepth.flight import AttitudeSample, Flight, Frame, Steadiness, VelocitySample, open_flight
from flightdepth.flight.records import NS_PER_S, give
from flightdepth.flight.still_parts import StillParts
from flightdepth.motion import Vector, rotation_from_quaternion
from flightdepth.outputs import read_depth
from flightdepth.outputs.run import depths
from flightdepth.ranges import MultiRangeEstimator
from flightdepth.runtimes.network import Network, load_network

if TYPE_CHECKING:
    from turns import Turning

START_S, END_S, FRAMES_S = 1.0, 5.1, 30
FARTHEST_M = 100.0  # of the truth that counts
BESIDE_PX = 20
WIDTH, HEIGHT = 640, 360
FLIGHTS, PAN_DEG_S, SWING_DEG_S, SWING_HZ, RATE_FACTOR = 6, 90.0, 45.0, 0.2, 21.0  # of --find
RATE_HZ = 30  # of the flights of turns.py
LINES = {
    "BAT 15.2V 1842mAh": (12, 25),
    "LQ 98": (281, 25),
    "GPS 14  ALT 23m": (396, 25),
    "HOME 182m  SPD 5.4": (12, 342),
    "REC 00:12": (460, 342),
}

Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Still:
    """A thing that stands still: its colours [H, W, 3], and where it is [H, W]."""

    image: NDArray[np.uint8]
    where: Flags

    @property
    def near(self) -> Flags:
        """Where it is, and within BESIDE_PX of it."""
        around = np.ones((2 * BESIDE_PX + 1,) * 2, np.uint8)
        return np.asarray(cv2.dilate(self.where.astype(np.uint8), around) > 0)


def leg() -> Still:
    """A textured bar from the lower left corner."""
    where = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.line(where, (-13, 367), (166, 223), 255, 54)
    grain = np.random.default_rng(1).integers(20, 130, (60, 107, 3), np.uint8)
    return Still(cv2.resize(grain, (WIDTH, HEIGHT)), where > 0)


def blank() -> Still:
    """The same bar without a texture."""
    return Still(np.full((HEIGHT, WIDTH, 3), (40, 42, 45), np.uint8), leg().where)


def text() -> Still:
    """White letters with black outlines."""
    image, where = np.zeros((HEIGHT, WIDTH, 3), np.uint8), np.zeros((HEIGHT, WIDTH), np.uint8)
    for line, place in LINES.items():
        cv2.putText(where, line, place, cv2.FONT_HERSHEY_SIMPLEX, 0.7, 255, 5)
        cv2.putText(image, line, place, cv2.FONT_HERSHEY_SIMPLEX, 0.7, (255, 255, 255), 1, cv2.LINE_AA)
    return Still(image, where > 0)


class Drawn:
    """A flight in whose pictures something stands still."""

    def __init__(self, flight: Flight, still: Still) -> None:
        self._flight, self._still = flight, still

    def __getattr__(self, name: str) -> object:
        return getattr(self._flight, name)

    def __iter__(self) -> Iterator[object]:
        for event in self._flight:
            if not isinstance(event, Frame):
                yield event
                continue
            image = np.where(self._still.where[..., None], self._still.image, event.image)
            yield replace(event, image=image)


def row(network: Network, still: Still, *, drawn: bool, masked: bool) -> str:
    """The figures of one run."""
    near = still.near
    parts = {"beside": near & ~still.where, "elsewhere": ~near}
    told: list[tuple[float, float]] = []
    errors: dict[str, list[NDArray[np.float64]]] = {name: [] for name in parts}
    with open_flight(VIDEO, LOG, CALIBRATION, start_s=START_S, end_s=END_S) as flight:
        mask = ~still.where if masked else None
        estimator = MultiRangeEstimator(network, flight.camera, ranges=2, mask=mask)
        for frame, result in depths(Drawn(flight, still) if drawn else flight, estimator):  # type: ignore[arg-type]
            truth = TRUTH / f"{round(frame.stamp_ns * 1e-9 * FRAMES_S):06d}.png"
            if not truth.exists() or result.reason is not None:
                continue
            farther = np.isfinite(result.farther_than_m[still.where]).mean()
            told.append((float(np.isfinite(result.depth_m[still.where]).mean()), float(farther)))
            truth_m = read_depth(truth)
            off = np.abs(result.depth_m[AT_TRUTH] - truth_m) / truth_m
            for name, part in parts.items():
                errors[name].append(off[part[AT_TRUTH] & (truth_m < FARTHEST_M)])
    cells = [f"{share:12.0%}" for share in np.mean(told, axis=0)]
    for found in errors.values():
        every = np.concatenate(found)
        cells.append(f"{np.nanmean(every):10.3f} {np.isfinite(every).mean():6.0%}")
    return " ".join(cells)


def find(*, untold: bool) -> None:
    """Print what is found, flight by flight."""
    import turns  # renders, so it needs the extra `train`
    from seen_attitudes import LONG

    from flightdepth.stillbox.h264 import through_h264

    nothing = Still(np.zeros((HEIGHT, WIDTH, 3), np.uint8), np.zeros((HEIGHT, WIDTH), np.bool_))
    for number in range(FLIGHTS):
        if untold:
            flight = turns.Turning.filmed(number, SWING_DEG_S, config=LONG, swing_hz=SWING_HZ, readout_s=0.0)
        else:
            flight = turns.Turning.filmed(number, PAN_DEG_S, readout_s=0.0)
        for name, still in {"none": nothing, "leg": leg(), "blank leg": blank(), "text": text()}.items():
            drawn = [np.where(still.where[..., None], still.image, picture) for picture in flight.pictures]
            pictures = through_h264(drawn, RATE_FACTOR)
            parts = StillParts(turns.CAMERA)
            for picture, how in zip(pictures, (seen if untold else told)(flight, pictures), strict=True):
                if how is not None:
                    parts.add(picture, *how)
            part = parts.found()
            hidden = np.zeros_like(still.where) if part is None else ~part.shown
            inside = f"{hidden[still.where].mean():.0%} of it" if still.where.any() else "nothing there"
            print(
                f"flight {number}, {name:9}: {inside}, {hidden[~still.near].mean():.2%} of what is not near it",
                flush=True,
            )


def told(flight: Turning, pictures: Sequence[NDArray[np.uint8]]) -> Iterator[tuple[Vector, object] | None]:
    """Of each picture the camera's attitude, as the log tells it next to that time, and its axes."""
    attitudes = [sample for sample in flight.samples if isinstance(sample, AttitudeSample)]
    for index in range(len(pictures)):
        stamp_ns = index / RATE_HZ * NS_PER_S
        nearest = min(attitudes, key=lambda sample, at=stamp_ns: abs(sample.stamp_ns - at))
        yield rotation_from_quaternion(nearest.world_from_camera), None


def seen(flight: Turning, pictures: Sequence[NDArray[np.uint8]]) -> Iterator[tuple[Vector, object] | None]:
    """Of each picture the orientation that they show themselves, and its axes."""
    from turns import CAMERA

    estimator, steadiness = MultiRangeEstimator(load_network("motion-tiny"), CAMERA), Steadiness(CAMERA)
    for sample in flight.samples:
        if isinstance(sample, VelocitySample):
            give(sample, estimator)
    for index, picture in enumerate(pictures):
        stamp_ns = round(index / RATE_HZ * NS_PER_S)
        unusable = steadiness.add(stamp_ns, picture, estimator.max_turn_rad(stamp_ns)).unusable
        found = estimator.add_frame(stamp_ns, picture, unusable=unusable).orientation
        yield None if found is None else (found.rotation, found.axes(stamp_ns))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--networks", nargs="+", default=["motion", "motion-tiny"])
    parser.add_argument("--find", action="store_true", help="what `run` finds by itself")
    parser.add_argument("--untold", action="store_true", help="where no log tells the attitude")
    options = parser.parse_args()
    if options.find:
        find(untold=options.untold)
        return
    wanted = options.networks
    print(
        f"{'':34} {'in it: depth':>12} {'farther than':>12} {'beside':>10} {'known':>6} {'else':>10} {'known':>6}"
    )
    for network in map(load_network, wanted):
        print(f"{network.card.name}: {origin_of(network)}")
        for name, still in {"leg": leg(), "text": text()}.items():
            for way in ("not there", "no mask", "masked"):
                figures = row(network, still, drawn=way != "not there", masked=way == "masked")
                print(
                    f"{network.card.name:12} {name} of {still.where.mean():.1%}, {way:9} {figures}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
