"""How far the obstacle distances of the sample flight are from those of its true depth.

    python benchmarks/obstacle_distances.py [--json FILE]

Each tenth frame of the sample has its true depth. The same sectors are worked out from it, with every pixel known and
no blind cone; then each value that the network's depth gives is held against them.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from pathlib import Path

import numpy as np

from flightdepth.camera import Camera
from flightdepth.commands.demo import CALIBRATION, LOG, TRUTH, TRUTH_OFFSET_PX, TRUTH_STEP_PX, VIDEO
from flightdepth.flight import AttitudeSample, VelocitySample, open_flight
from flightdepth.live.obstacle_memory import ObstacleMap
from flightdepth.live.obstacle_messages import UNKNOWN, distances_cm
from flightdepth.live.obstacle_rays import sectors_of
from flightdepth.live.obstacles import ObstacleSettings, Pose, Sight
from flightdepth.motion import rotation_from_quaternion
from flightdepth.outputs.read import read_depth
from flightdepth.outputs.run import depths
from flightdepth.ranges import MultiRangeEstimator, RangedDepth
from flightdepth.runtimes.network import load_network, nearest_network

HEADING_RAD = 0.0  # the sample's camera looks north all the time
AGE_S = 0.05
SETTINGS = ObstacleSettings()


class Heard:
    """A flight that remembers its last velocity and attitude."""

    def __init__(self, flight) -> None:
        self.flight, self.velocity, self.attitude = flight, np.zeros(3), None

    def __getattr__(self, name: str):
        return getattr(self.flight, name)

    def __iter__(self):
        for event in self.flight:
            if isinstance(event, VelocitySample):
                self.velocity = event.velocity
            elif isinstance(event, AttitudeSample):
                self.attitude = event.world_from_camera
            yield event


def true_sectors(path: Path, camera: Camera, attitude, velocity):
    """Sectors of the stored truth: a small picture whose pixels are each fifth of the flight's."""
    depth_m = read_depth(path)
    height, width = depth_m.shape
    small = Camera(
        width,
        height,
        camera.fx / TRUTH_STEP_PX,
        camera.fy / TRUTH_STEP_PX,
        (camera.cx - TRUTH_OFFSET_PX) / TRUTH_STEP_PX,
        (camera.cy - TRUTH_OFFSET_PX) / TRUTH_STEP_PX,
    )
    nothing = np.full(depth_m.shape, np.nan, np.float32)
    told = RangedDepth(
        depth_m=depth_m,
        confidence=np.ones_like(depth_m),
        sigma_m=None,
        range_depths_m=np.zeros((1, 1, 1), np.float32),
        shifts=np.ones(1, np.int64),
        displacements_m=np.array([1e9]),
        centroids_m=np.full(1, np.nan),
        farther_than_m=nothing,
        nearer_than_m=nothing,
        latency_ms=0.0,
        # Across the optical axis and upwards: every ray that matters sees it.
        moved_m=np.array([[0.0, 1e9, 0.0]]),
    )
    return sectors_of(told, small, Pose.of(attitude, HEADING_RAD, velocity), Sight(1e6), SETTINGS)


def compare(told_cm: np.ndarray, true_m: np.ndarray, counts: Counter[str], ratios: list[float]) -> None:
    """One frame's values against the true distances [72] (NaN: nothing within reach)."""
    for value, true in zip(told_cm.astype(int), true_m, strict=True):
        near = true <= SETTINGS.max_m
        kind = "unknown" if value == UNKNOWN else "free" if value > SETTINGS.max_m * 100 else "distance"
        counts[f"{kind}, {'an obstacle' if near else 'nothing'} within {SETTINGS.max_m:.0f} m"] += 1
        if kind == "distance" and near:
            ratios.append(value / 100 / true)
        if kind == "free" and near:
            counts["free, an obstacle within 20 m"] += true <= SETTINGS.max_m / 2


def main() -> None:
    """Print what came of it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    counts: Counter[str] = Counter()
    ratios: list[float] = []
    with open_flight(VIDEO, LOG, CALIBRATION) as flight:
        network = load_network(nearest_network(flight.camera))
        sight = Sight.of(network.card, network.grid(flight.camera).camera.fx)
        obstacles, heard = ObstacleMap(sight, SETTINGS), Heard(flight)
        for frame, result in depths(heard, MultiRangeEstimator(network, flight.camera, ranges=2)):
            assert heard.attitude is not None
            assert abs(rotation_from_quaternion(heard.attitude)[:, 2] @ (1, 0, 0)) > 0.99
            sectors = obstacles.add(
                frame.stamp_ns,
                result,
                flight.camera,
                world_from_camera=heard.attitude,
                heading_rad=HEADING_RAD,
                velocity_ned=heard.velocity,
            )
            truth = TRUTH / f"{frame.index:06d}.png"
            if truth.exists():
                true = true_sectors(truth, flight.camera, heard.attitude, heard.velocity)
                seen = (true.clear_m > 0) | np.isfinite(true.obstacle_m)  # within the view
                told_cm = distances_cm(sectors, AGE_S, SETTINGS)
                compare(told_cm[seen], true.obstacle_m[seen], counts, ratios)
    low, median, high = (float(value) for value in np.percentile(ratios, (10, 50, 90)))
    for name in sorted(counts):
        print(f"{counts[name]:5d} sectors {name}")
    print(
        f"reported / true distance: median {median:.2f}, 10 to 90 %: {low:.2f} to {high:.2f} ({len(ratios)})"
    )
    if options.json:
        figures = {"counts": dict(counts), "ratio": {"p10": low, "median": median, "p90": high}}
        options.json.write_text(
            json.dumps(figures | {"weights_sha256": network.card.sha256}, indent=2) + "\n"
        )


if __name__ == "__main__":
    main()
