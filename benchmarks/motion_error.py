"""Whether the error bar keeps its word where the motion was wrong: python benchmarks/motion_error.py [--scenes N].

Nominal pairs of other rooms than a test has, and of the outdoor test set. The earlier picture is turned about a random
axis and the direction tilted, both are mended as in flight, and errors within one sigma are counted, of all pixels
that fusion would believe and of the sixth with the largest share of motion in their error bar: by the network's own
bar, and by that which holds what the mended motion leaves open.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable

import cv2
import numpy as np

from flightdepth.evaluation.pairs import Task
from flightdepth.evaluation.provenance import origin_of
from flightdepth.evaluation.sigma_scale import believed, calibration_set
from flightdepth.ranges.derotation import derotated
from flightdepth.ranges.motion_error import with_motion_error
from flightdepth.runtimes.network import Network, load_network
from flightdepth.scenes import chance
from flightdepth.stillbox import OutdoorTestSet
from flightdepth.stillbox.motion_noise import rotated, tilted
from flightdepth.stillbox.testset import TestPair

WRONG_DEG = ((0.0, 0.0), (0.05, 0.0), (0.1, 2.0), (0.25, 4.0))  # turned by; direction tilted by


def answers(network: Network, pairs: Iterable[TestPair], turn_deg: float, tilt_deg: float) -> np.ndarray:
    """Error, the network's bar, the widened one and depth of each pixel, metres at D0, [4, N]."""
    maps = []
    for number, pair in enumerate(pairs):
        rng = np.random.default_rng(number)
        task = Task.of(pair, network.card)
        turn = chance.unit_vector(rng) * np.radians(turn_deg)
        reported = tilted(task.nominal, chance.unit_vector(rng), tilt_deg)
        previous = rotated(pair.previous, task.camera, turn)
        previous, nominal, covariance = derotated(previous, pair.current, reported, task.camera)
        found = task.ask(network, pair, previous=previous, nominal=nominal)
        depth_m, own_m = found.depth_m[0], found.sigma_m[0]
        wide_m = own_m
        if covariance is not None:
            wide_m = with_motion_error(own_m, depth_m, nominal, covariance, task.camera)
        maps.append(np.stack([np.abs(depth_m - task.truth_m), own_m, wide_m, depth_m]).reshape(4, -1))
    return np.concatenate(maps, axis=1)


def report(network: Network, name: str, pairs: list[TestPair]) -> None:
    """Print a line for each wrong motion."""
    for turn_deg, tilt_deg in WRONG_DEG:
        error, own, wide, depth = answers(network, pairs, turn_deg, tilt_deg)
        shares = []
        for sigma in (own, wide):
            counted, moved = believed(network.card, depth, sigma), wide / own
            most = counted & (moved >= np.quantile(moved[counted], 5 / 6))
            shares += [counted.mean(), *((error < sigma)[which].mean() for which in (counted, most))]
        print(f"{name:10}{turn_deg:6.2f}{tilt_deg:6.1f}  " + "".join(f"{share:9.1%}" for share in shares))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=60)
    parser.add_argument("--network", default="motion")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    network = load_network(given.network)
    print(origin_of(network))
    print(
        "degrees turned, tilted; believed, inside one sigma, of the sixth: the network's bar; then the widened one"
    )
    report(network, "rooms", list(calibration_set(network.card, scenes=given.scenes)))
    report(network, "outdoors", list(OutdoorTestSet(256, given.scenes)))


if __name__ == "__main__":
    main()
