"""What a wrong log does to depth: the sample flight with its log in other axes, late, or without the camera's attitude.

    python benchmarks/wrong_logs.py

Each is run with the check of the log's direction (`ranges/log_check.py`) and without it: the pixels with a depth, of
those nearer than 200 m, their relative error, the median confidence and the share of frames whose log was denied.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, replace
from unittest.mock import patch

import numpy as np

from flightdepth.commands.demo import AT_TRUTH, CALIBRATION, LOG, TRUTH, VIDEO
from flightdepth.evaluation.provenance import origin_of
from flightdepth.flight.cameras import choose_camera
from flightdepth.flight.open import Flight
from flightdepth.flight.records import NS_PER_S, AttitudeSample, Telemetry, VelocitySample
from flightdepth.flight.telemetry import read_telemetry
from flightdepth.flight.video import Video
from flightdepth.outputs import read_depth
from flightdepth.outputs.run import depths
from flightdepth.ranges import MultiRangeEstimator
from flightdepth.ranges.log_check import LogCheck
from flightdepth.runtimes.network import Network, load_network

FARTHEST_M = 200.0


def turned(matrix: list[list[float]]) -> Callable[[Telemetry], Telemetry]:
    """The log with its velocities multiplied by a matrix (north, east, down)."""

    def change(log: Telemetry) -> Telemetry:
        return replace(
            log,
            samples=tuple(
                replace(sample, velocity=np.array(matrix) @ sample.velocity)
                if isinstance(sample, VelocitySample)
                else sample
                for sample in log.samples
            ),
        )

    return change


def without_attitude(log: Telemetry) -> Telemetry:
    """The log with velocities alone."""
    return replace(log, samples=tuple(each for each in log.samples if not isinstance(each, AttitudeSample)))


LOGS: dict[str, Callable[[Telemetry], Telemetry]] = {
    "right": lambda log: log,
    "without attitude": without_attitude,
    "east, north, up": turned([[0, 1, 0], [1, 0, 0], [0, 0, -1]]),
    "a quarter turn off": turned([[0, -1, 0], [1, 0, 0], [0, 0, 1]]),
    "backwards": turned([[-1, 0, 0], [0, -1, 0], [0, 0, -1]]),
    "1.5 s late": lambda log: log.later_by(3 * NS_PER_S // 2),
}


@dataclass
class Row:
    """Means over frames with a truth, of pixels nearer than FARTHEST_M."""

    known: list[float]
    error: list[float]
    confidence: list[float]
    denied: list[bool]

    def __str__(self) -> str:
        known, error, confidence, denied = (
            100 * np.nanmean(each) for each in (self.known, self.error, self.confidence, self.denied)
        )
        return f"{known:6.0f} {error:7.1f} {confidence:10.0f} {denied:7.0f}"


def flown(network: Network, log: Telemetry) -> Row:
    """The sample flight with a log."""
    row = Row([], [], [], [])
    video = Video(VIDEO)
    with Flight(video, choose_camera(video, CALIBRATION, None, log), log, 0.0) as flight:
        estimator = MultiRangeEstimator(network, flight.camera, ranges=2)
        for frame, result in depths(flight, estimator):
            row.denied.append(result.doubt is not None)
            path = TRUTH / f"{frame.index:06d}.png"
            if not path.exists():
                continue
            truth_m, depth_m = read_depth(path), result.depth_m[AT_TRUTH]
            wanted = truth_m < FARTHEST_M
            known = wanted & np.isfinite(depth_m)
            row.known.append(float(known.sum() / wanted.sum()))
            if known.any():
                row.error.append(float(np.mean(np.abs(depth_m[known] / truth_m[known] - 1))))
                row.confidence.append(float(np.median(result.confidence[AT_TRUTH][known])))
    return row


def main() -> None:
    """Print the table."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    network = load_network("motion")
    print(origin_of(network))
    print(f"{'% of each':28} {'known':>6} {'error':>7} {'confidence':>10} {'denied':>7}")
    right = read_telemetry(LOG)
    for name, change in LOGS.items():
        for kind in ("without", "with"):
            with patch.object(LogCheck, "denies", return_value=False) if kind == "without" else nullcontext():
                print(f"{name + ', ' + kind:28} {flown(network, change(right))}", flush=True)


if __name__ == "__main__":
    main()
