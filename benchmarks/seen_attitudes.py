"""Attitudes that the pictures tell where no log does: `python benchmarks/seen_attitudes.py [--scenes N]`.

Flights of `turns.py`, six seconds each, any way and height, whose camera keeps its direction, pans at an even rate or
swings. The log tells velocities of the world alone. What is told of a frame's attitude (poses.csv, `pictures`) is
compared with the truth: of how many frames there is one, and by what angle it is off. So is the way that is put
together where of these velocities only the speed counts, as of `--speed`: how far off it ends (share of its length),
and by what angle the last attitude is off, both in the first one's axes.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np
from rich.console import Console
from rich.table import Table
from turns import CAMERA, CONFIG, SEED, Turning

from flightdepth.commands.terminal import counted
from flightdepth.flight import Frame, Steadiness, VelocitySample
from flightdepth.flight.records import NS_PER_S, give
from flightdepth.motion import NED_FROM_CAMERA, Vector, rotation_angle_rad
from flightdepth.outputs.poses import PoseTrack
from flightdepth.outputs.seen_path import SeenPath
from flightdepth.ranges.estimator import MultiRangeEstimator
from flightdepth.runtimes.network import Network, load_network
from flightdepth.scenes.outdoor import outdoor_flight

LONG = CONFIG.model_copy(update={"frames": 180, "turn_over_s": 1.5, "pitch_down": (0.1, 0.6)})
TURNS = {
    "still": (0.0, 0.0),
    "pans, 12 degrees/s": (12.0, 0.0),
    "swings, up to 15 degrees/s": (15.0, 0.15),
    "swings, up to 45 degrees/s": (45.0, 0.2),
}
READOUT_S = 0.02


@dataclass
class Off:
    """What is off in a flight: each frame's attitude [F], degrees, NaN where none is told; then the way, a share."""

    attitude_deg: Vector
    way: float
    turned_deg: float


def flown(network: Network, flight: Turning, number: int) -> Off:
    """One flight through the estimator and both ways of placing it."""
    estimator, track, path = MultiRangeEstimator(network, CAMERA, ranges=2), PoseTrack(), SeenPath()
    steadiness, off_deg, seen = Steadiness(CAMERA), [], []
    for sample in flight.samples:
        if isinstance(sample, VelocitySample):
            give(sample, estimator)
            track.add(sample)
    for index, (picture, truth) in enumerate(zip(flight.pictures, flight.ned_from_camera, strict=True)):
        stamp_ns = round(index * NS_PER_S / LONG.rate_hz)
        unusable = steadiness.add(stamp_ns, picture, estimator.max_turn_rad(stamp_ns)).unusable
        result = estimator.add_frame(stamp_ns, picture, unusable=unusable)
        pose = track.at(Frame(index, stamp_ns, picture), result)
        told = pose is not None and pose.attitude == "pictures"
        off_deg.append(angle_deg(pose.ned_from_camera, truth) if pose is not None and told else np.nan)
        if (found := path.at(index, result)) is not None:
            seen.append((index, *found))
    segment = seen[-1][2]
    first, *_, last = (place for place in seen if place[2] == segment)
    times_s = np.arange(LONG.frames) / LONG.rate_hz
    way_m = outdoor_flight(LONG, SEED, number).position(times_s) @ NED_FROM_CAMERA.T
    level = flight.ned_from_camera[first[0]] @ first[3].T
    flown_m, true_m = level @ (last[1] - first[1]), way_m[last[0]] - way_m[first[0]]
    length_m = np.linalg.norm(np.diff(way_m[first[0] : last[0] + 1], axis=0), axis=1).sum()
    turned_deg = angle_deg(level @ last[3], flight.ned_from_camera[last[0]])
    return Off(np.array(off_deg), float(np.linalg.norm(flown_m - true_m) / length_m), turned_deg)


def angle_deg(one: Vector, other: Vector) -> float:
    """Between two attitudes (3, 3)."""
    return float(np.degrees(rotation_angle_rad(one.T @ other)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=6)
    parser.add_argument("--network", default="motion")
    options = parser.parse_args()
    network = load_network(options.network)
    table = Table("camera", "attitude told", "off, median", "95 %", "way off, median, most", "turned, most")
    for name, (rate_deg_s, swing_hz) in TURNS.items():
        flights = []
        for number in counted(range(options.scenes), name, "flights"):
            flight = Turning.filmed(number, rate_deg_s, config=LONG, swing_hz=swing_hz, readout_s=READOUT_S)
            flights.append(flown(network, flight, number))
        every = np.concatenate([flight.attitude_deg for flight in flights])
        median_deg, most_deg = np.nanpercentile(every, [50, 95])
        ways = [flight.way for flight in flights]
        table.add_row(
            name,
            f"{np.isfinite(every).mean():.0%}",
            f"{median_deg:.1f} degrees",
            f"{most_deg:.1f}",
            f"{np.median(ways):.1%}, {max(ways):.1%}",
            f"{max(flight.turned_deg for flight in flights):.1f} degrees",
        )
    Console().print(table)


if __name__ == "__main__":
    main()
