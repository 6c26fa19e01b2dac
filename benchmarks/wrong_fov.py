"""What a wrong field of view does to depth: the sample flight, which was rendered with 75 degrees, run with others.

    python benchmarks/wrong_fov.py

Prints for each field of view the median ratio of its depths to those with the true one, pixel by pixel, over the
part that flies ahead and the part that flies sideways, beside the ratio of the focal lengths.
"""

from __future__ import annotations

import argparse
import math

import numpy as np

from flightdepth.commands.demo import LOG, VIDEO
from flightdepth.evaluation.provenance import origin_of
from flightdepth.flight import open_flight
from flightdepth.outputs.run import depths
from flightdepth.ranges import MultiRangeEstimator
from flightdepth.runtimes.network import Network, load_network

TRUE_DEG = 75.0
PARTS_S = {"ahead": (2.0, 3.0), "sideways": (7.0, 8.0)}


def depth_stack(network: Network, hfov_deg: float, start_s: float, end_s: float) -> np.ndarray:
    """Depth [n, H, W] of every fifth frame of a part, from the eleventh on."""
    with open_flight(VIDEO, LOG, hfov_deg=hfov_deg, start_s=start_s, end_s=end_s) as flight:
        estimator = MultiRangeEstimator(network, flight.camera, ranges=2)
        return np.stack(
            [result.depth_m for frame, result in depths(flight, estimator) if frame.index in range(10, 99, 5)]
        )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fov", type=float, nargs="+", default=[55.0, 65.0, 90.0])
    wanted = parser.parse_args().fov
    network = load_network("motion")
    print(origin_of(network))
    truth = {part: depth_stack(network, TRUE_DEG, *span) for part, span in PARTS_S.items()}
    print(f"{'hfov':>6} {'focal':>6} " + " ".join(f"{part:>9}" for part in PARTS_S))
    for hfov_deg in wanted:
        focal = math.tan(math.radians(TRUE_DEG) / 2) / math.tan(math.radians(hfov_deg) / 2)
        ratios = [
            np.nanmedian(depth_stack(network, hfov_deg, *span) / truth[part])
            for part, span in PARTS_S.items()
        ]
        print(f"{hfov_deg:6g} {focal:6.2f} " + " ".join(f"{ratio:9.2f}" for ratio in ratios))


if __name__ == "__main__":
    main()
