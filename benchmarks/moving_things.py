"""What networks that know the motion say of things that move by themselves, by how far these left their lines.

    python benchmarks/moving_things.py [--networks NAME ...] [--pairs N]

Rendered rooms and flights outdoors that nothing else uses, any lens, camera effects, motions that are reported wrongly,
with one thing each (`moving.py`). A depth is told where its error bar is less than two fifths of
it, as in flight.
"""

from __future__ import annotations

import argparse
from itertools import pairwise

import cv2
import numpy as np
from judging_pairs import fitting_pairs
from moving import with_moving_thing
from rich.console import Console
from rich.table import Table

from flightdepth.commands.terminal import counted
from flightdepth.evaluation.provenance import origin_of
from flightdepth.ranges.fusion import WORST_SIGMA
from flightdepth.runtimes.network import Network, load_network
from flightdepth.scenes import Textures, chance

SEED, TEXTURES = 21, 40
THING = 22  # what a random stream is for; 20 and 21 are the pairs'
EDGES_PX = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 24.0)
LARGEST_ERROR = 2.0  # relative; more counts as this
WHOLE = 0.95  # of a block that a thing covers


def told(network: Network, count: int) -> dict[str, np.ndarray]:
    """Of each block that a thing covers: pixels off its line, error, whether depth is told, whether sigma holds it."""
    textures = Textures.procedural(TEXTURES, SEED)
    parts: dict[str, list[np.ndarray]] = {"off_px": [], "error": [], "told": [], "held": [], "around": []}
    pairs = list(fitting_pairs(count, max(1, round(256 / network.card.focal_px)), SEED))
    for number, pair in enumerate(counted(pairs, network.card.name, "pairs")):
        thing = with_moving_thing(pair, textures, chance.stream(SEED, number, THING))
        if thing is None:
            continue
        grid, length_m = network.grid(pair.camera), float(np.linalg.norm(pair.displacement))
        seen = thing.pair
        found = network.predict([seen.previous], seen.current, seen.displacement[None], seen.camera)
        assert found.sigma_m is not None
        depth_m, sigma_m, size = found.depth_m[0], found.sigma_m[0], grid.valid.shape[::-1]
        truth_m = cv2.resize(seen.target_m, size, interpolation=cv2.INTER_AREA)
        covered = cv2.resize(thing.inside.astype(np.float32), size, interpolation=cv2.INTER_AREA)
        known = grid.valid & (truth_m < network.card.at_focal(grid.camera.fx).alpha * length_m)
        inside = known & (covered > WHOLE)
        sure = sigma_m < WORST_SIGMA * depth_m
        error_m = np.abs(depth_m - truth_m)
        parts["off_px"].append(np.full(inside.sum(), thing.off_px))
        parts["error"].append(np.minimum(error_m[inside] / truth_m[inside], LARGEST_ERROR))
        parts["told"].append(sure[inside])
        parts["held"].append((error_m < sigma_m)[inside])
        parts["around"].append(sure[known & (covered == 0)])
    return {key: np.concatenate(values) for key, values in parts.items()}


def as_table(network: Network, values: dict[str, np.ndarray]) -> Table:
    name, around = network.card.name, values["around"].mean()
    title = f"{name}: things that move by themselves; around them {around:.0%} has a depth"
    table = Table(
        "pixels off its line",
        "blocks",
        "depth told",
        "their error",
        "inside one sigma",
        title=title,
        caption=origin_of(network),
    )
    for low, high in pairwise(EDGES_PX):
        of = (low <= values["off_px"]) & (values["off_px"] < high)
        told = of & values["told"]
        if told.any():
            error = values["error"][told]
            cells = [f"{of.sum():,}", f"{values['told'][of].mean():.0%}"]
            cells += [f"{error.mean():.2f} / {np.median(error):.2f}", f"{values['held'][told].mean():.0%}"]
            table.add_row(f"{low:g} to {high:g}", *cells)
    return table


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--networks", nargs="+", default=["motion", "motion-tiny"])
    parser.add_argument("--pairs", type=int, default=300)
    given = parser.parse_args()
    cv2.setNumThreads(1)
    for name in given.networks:
        network = load_network(name, precision="f32", threads=1)
        Console(width=110).print(as_table(network, told(network, given.pairs)))


if __name__ == "__main__":
    main()
