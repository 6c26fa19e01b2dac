"""What aligning depth with the pictures gives, by how far points moved, and what it takes.

    python benchmarks/alignment.py [--networks NAME ...] [--pairs N]
    python benchmarks/alignment.py --fit FILE.onnx [--pairs 2400]    fits the judge anew, on other pairs
    python benchmarks/alignment.py --fit FILE.onnx --go-on           the error bars alone, of the one that ships, where
                                                                     the motion is known

Rendered rooms and flights outdoors that nothing else uses, as `judging_pairs.py` draws them: any
lens, camera effects, motions that are reported wrongly; to fit, also things that move by themselves. One core, without
and with it in turns; compare within a run.
"""

from __future__ import annotations

import argparse
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from judging import RATE, STEPS, fitted_judge, told_of
from judging_pairs import MOVING_SHARE, fitting_pairs
from rich.console import Console
from rich.table import Table

from flightdepth.commands.terminal import counted, progress_bar
from flightdepth.evaluation.provenance import origin_of
from flightdepth.processor import cpu_name
from flightdepth.runtimes.judge import JUDGE
from flightdepth.runtimes.network import Network, load_network, networks
from flightdepth.stillbox.pairs import Pair
from flightdepth.weights.store import find_network, read_card

SEED = 3
EDGES_PX = (0.0, 1.0, 2.0, 4.0, 8.0, 16.0, 64.0)
LARGEST_ERROR = 2.0  # relative; more counts as this


def knowing() -> list[str]:
    return [name for name in networks() if read_card(find_network(name)).knows_direction]


def drawn_for(network: Network, count: int, **options: Any) -> list[Pair]:
    return list(fitting_pairs(count, max(1, round(256 / network.card.focal_px)), **options))


def fit(names: list[str], file: Path, count: int, steps: int, *, go_on: bool) -> None:
    told, wrong = [], {"wrong_share": 0.0} if go_on else {}  # what an uncertain motion adds comes on top
    for name in names:
        network = load_network(name, aligned=False, threads=1)
        pairs = drawn_for(network, count, moving_share=MOVING_SHARE, **wrong)
        told += [told_of(network, pair) for pair in counted(pairs, name, "pairs")]
    start: dict[str, Any] = {"start": JUDGE.read_bytes(), "rate": RATE / 2} if go_on else {}
    with progress_bar("judge", steps, "steps") as bar:
        judge = fitted_judge(told, steps=steps, after_step=bar.step, **start)
    file.write_bytes(judge)


def measure(name: str, count: int) -> Table:
    network = load_network(name, threads=1)
    errors: dict[bool, list[np.ndarray]] = {False: [], True: []}
    times_ms: dict[bool, list[float]] = {False: [], True: []}
    moved = []
    for pair in counted(drawn_for(network, count, seed=SEED), name, "pairs"):
        grid, length_m = network.grid(pair.camera), float(np.linalg.norm(pair.displacement))
        range_m = network.card.at_focal(grid.camera.fx).alpha * length_m
        truth_m = cv2.resize(pair.target_m, grid.valid.shape[::-1], interpolation=cv2.INTER_AREA)
        known = grid.valid & (truth_m < range_m)
        moved.append((grid.camera.fx * length_m / truth_m)[known])
        for aligned, parts in errors.items():
            network.aligned = aligned
            began = time.perf_counter()
            found = network.predict([pair.previous], pair.current, pair.displacement[None], pair.camera)
            times_ms[aligned].append((time.perf_counter() - began) * 1000)
            parts.append(np.minimum(np.abs(found.depth_m[0] / truth_m - 1)[known], LARGEST_ERROR))
    moved_px = np.concatenate(moved)
    title = f"{name}: relative error, mean / median, by pixels moved (sideways); ms a pair, one core"
    table = Table(
        "",
        *(f"{a:g}-{b:g}" for a, b in pairwise(EDGES_PX)),
        "all",
        "ms",
        title=title,
        caption=origin_of(network),
    )
    for aligned, parts in errors.items():
        values = np.concatenate(parts)
        groups = [values[(a <= moved_px) & (moved_px < b)] for a, b in pairwise(EDGES_PX)]
        cells = [f"{group.mean():.3f} / {np.median(group):.3f}" for group in (*groups, values)]
        table.add_row("aligned" if aligned else "network", *cells, f"{np.median(times_ms[aligned]):.1f}")
    return table


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--networks", nargs="+", default=knowing())
    parser.add_argument("--pairs", type=int, help="200; 2400 to fit")
    parser.add_argument("--steps", type=int, default=STEPS, help="of the fit")
    parser.add_argument("--fit", type=Path, metavar="FILE")
    parser.add_argument(
        "--go-on",
        action="store_true",
        help="with --fit: teach the judge that ships better error bars, at half the rate; its depth stays",
    )
    given = parser.parse_args()
    cv2.setNumThreads(1)
    if given.fit is not None:
        fit(given.networks, given.fit, given.pairs or 2400, given.steps, go_on=given.go_on)
        return
    console = Console(width=160)
    console.print(cpu_name())
    for name in given.networks:
        console.print(measure(name, given.pairs or 200))


if __name__ == "__main__":
    main()
