"""Attitudes that the pictures tell where no log does: `python benchmarks/seen_attitudes.py [--scenes N]`.

Flights of `turns.py`, six seconds each, any way and height, whose camera keeps its direction, pans at an even rate or
swings. The log tells velocities of the world alone. What is told of a frame's attitude (poses.csv, `pictures`) is
compared with the truth: of how many frames there is one, and by what angle it is off.
"""

from __future__ import annotations

import argparse

import numpy as np
from rich.console import Console
from rich.table import Table
from turns import CAMERA, CONFIG, Turning

from flightdepth.commands.terminal import counted
from flightdepth.flight import Frame, Steadiness, VelocitySample
from flightdepth.flight.records import NS_PER_S, give
from flightdepth.motion import Vector, rotation_angle_rad
from flightdepth.outputs.poses import PoseTrack
from flightdepth.ranges.estimator import MultiRangeEstimator
from flightdepth.runtimes.network import Network, load_network

LONG = CONFIG.model_copy(update={"frames": 180, "turn_over_s": 1.5, "pitch_down": (0.1, 0.6)})
TURNS = {"still": (0.0, 0.0), "pans, 12 degrees/s": (12.0, 0.0), "swings, up to 15 degrees/s": (15.0, 0.15)}
READOUT_S = 0.02


def angles_off_deg(network: Network, flight: Turning) -> Vector:
    """Of each frame [F]; NaN where no attitude is told."""
    estimator, track = MultiRangeEstimator(network, CAMERA, ranges=2), PoseTrack()
    steadiness, off_deg = Steadiness(CAMERA), []
    for sample in flight.samples:
        if isinstance(sample, VelocitySample):
            give(sample, estimator)
            track.add(sample)
    for index, (picture, truth) in enumerate(zip(flight.pictures, flight.ned_from_camera, strict=True)):
        stamp_ns = round(index * NS_PER_S / LONG.rate_hz)
        unusable = steadiness.add(stamp_ns, picture, estimator.max_turn_rad(stamp_ns)).unusable
        result = estimator.add_frame(stamp_ns, picture, unusable=unusable)
        pose = track.at(Frame(index, stamp_ns, picture), result)
        known = pose is not None and pose.attitude == "pictures"
        off_deg.append(np.degrees(rotation_angle_rad(pose.ned_from_camera.T @ truth)) if known else np.nan)
    return np.array(off_deg)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=6)
    parser.add_argument("--network", default="motion")
    options = parser.parse_args()
    network = load_network(options.network)
    table = Table("camera", "attitude told", "off, median", "95 %")
    for name, (rate_deg_s, swing_hz) in TURNS.items():
        off_deg = []
        for number in counted(range(options.scenes), name, "flights"):
            flight = Turning.filmed(number, rate_deg_s, config=LONG, swing_hz=swing_hz, readout_s=READOUT_S)
            off_deg.append(angles_off_deg(network, flight))
        every = np.concatenate(off_deg)
        known = np.isfinite(every)
        median_deg, most_deg = np.percentile(every[known], [50, 95])
        table.add_row(name, f"{known.mean():.0%}", f"{median_deg:.1f} degrees", f"{most_deg:.1f}")
    Console().print(table)


if __name__ == "__main__":
    main()
