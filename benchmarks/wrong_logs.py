"""What a wrong log does to depth: the sample flight with its log in other axes, late, or without the camera's attitude.

    python benchmarks/wrong_logs.py

Each is run with the check of the log's direction (`ranges/log_check.py`) and without it: the pixels with a depth, of
those nearer than 200 m, their relative error, the median confidence, the share of frames whose log was denied, and of
errors inside one sigma.

Then each velocity is off as a satellite receiver's is, by an error that drifts away within a second, and the log tells
by how much, or does not.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import astuple, dataclass, replace
from functools import reduce
from unittest.mock import patch

import numpy as np

from flightdepth.commands.demo import AT_TRUTH, CALIBRATION, LOG, TRUTH, VIDEO
from flightdepth.evaluation.provenance import origin_of
from flightdepth.flight.cameras import choose_camera
from flightdepth.flight.open import Flight
from flightdepth.flight.records import NS_PER_S, AttitudeSample, Sample, Telemetry, VelocitySample
from flightdepth.flight.telemetry import read_telemetry
from flightdepth.flight.video import Video
from flightdepth.outputs import read_depth
from flightdepth.outputs.run import depths
from flightdepth.ranges import MultiRangeEstimator
from flightdepth.ranges.log_check import LogCheck
from flightdepth.runtimes.network import Network, load_network

FARTHEST_M = 200.0
LASTS_S, NOISES_M_S, SEEDS = 1.0, (0.0, 0.3, 1.0), 2


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


def noisy(log: Telemetry, sigma_m_s: float, *, told: bool, seed: int) -> Telemetry:
    """The log with an error of each velocity that is e times smaller LASTS_S later; `told`: it says its deviation."""
    rng, error, before_ns = np.random.default_rng(seed), np.zeros(3), None
    samples: list[Sample] = []
    for sample in log.samples:
        if isinstance(sample, VelocitySample):
            passed_s = np.inf if before_ns is None else (sample.stamp_ns - before_ns) / NS_PER_S
            kept, before_ns = np.exp(-passed_s / LASTS_S), sample.stamp_ns
            error = kept * error + sigma_m_s * np.sqrt(1 - kept**2) * rng.standard_normal(3)
            sigma = np.hypot(sigma_m_s, sample.sigma or 0.0) if told else None
            samples.append(replace(sample, velocity=sample.velocity + error, sigma=sigma))
        else:
            samples.append(sample)
    return replace(log, samples=tuple(samples))


@dataclass
class Row:
    """Means over frames with a truth, of pixels nearer than FARTHEST_M."""

    known: list[float]
    error: list[float]
    confidence: list[float]
    denied: list[bool]
    inside: list[float]

    def __str__(self) -> str:
        known, error, confidence, denied, inside = (
            100 * np.nanmean(each)
            for each in (self.known, self.error, self.confidence, self.denied, self.inside)
        )
        return f"{known:6.0f} {error:7.1f} {confidence:10.0f} {denied:7.0f} {inside:7.0f}"

    def joined(self, other: Row) -> Row:
        """The frames of both."""
        return Row(*(mine + others for mine, others in zip(astuple(self), astuple(other), strict=True)))


def flown(network: Network, log: Telemetry) -> Row:
    """The sample flight with a log."""
    row = Row([], [], [], [], [])
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
            if known.any() and result.sigma_m is not None:
                sigma_m = result.sigma_m[AT_TRUTH][known]
                row.inside.append(float(np.mean(np.abs(depth_m[known] - truth_m[known]) < sigma_m)))
    return row


def main() -> None:
    """Print both tables."""
    argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    ).parse_args()
    network, right = load_network("motion"), read_telemetry(LOG)
    print(origin_of(network))
    print(f"{'% of each':28} {'known':>6} {'error':>7} {'confidence':>10} {'denied':>7} {'inside':>7}")
    for name, change in LOGS.items():
        for kind in ("without", "with"):
            with patch.object(LogCheck, "denies", return_value=False) if kind == "without" else nullcontext():
                print(f"{name + ', ' + kind:28} {flown(network, change(right))}", flush=True)
    for sigma_m_s in NOISES_M_S:
        for told in (False, True):
            logs = (noisy(right, sigma_m_s, told=told, seed=seed) for seed in range(SEEDS))
            row = reduce(Row.joined, (flown(network, log) for log in logs))
            print(f"{sigma_m_s:.1f} m/s, {'told' if told else 'not told':18} {row}", flush=True)


if __name__ == "__main__":
    main()
