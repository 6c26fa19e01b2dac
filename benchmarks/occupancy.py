"""Whether an occupancy map tells the truth, on the sample flight: `flightdepth demo`, then this.

    python benchmarks/occupancy.py flightdepth-demo --picture slice.png

The truth is the renderer's, of every tenth frame, as far as the map tells anything. Prints what the map says of the
cells that a camera truly looked past, and of those that truly hold a surface; and of the cells that it calls occupied,
how far the nearest surface on the line of sight is. The picture is a level of the map, north up.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from flightdepth.commands.convert import OF_A_MAP
from flightdepth.commands.demo import TRUTH, TRUTH_STEP_PX
from flightdepth.motion import NED_FROM_ENU
from flightdepth.outputs import FlightFolder, read_depth
from flightdepth.outputs.cloud import CloudSettings, View, looked_up, views
from flightdepth.outputs.occupancy import occupancy_of

TRUTH_EVERY = 10  # frames
STATES = {"unknown": -1, "free": 0, "occupied": 1}
GREYS = {-1: 160, 0: 255, 1: 0}
PIXELS = 6  # a cell's edge in the picture

Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Truth:
    """Of cells [N]: whether a camera looked past them, whether they hold a surface, and how far off one is.

    off  metres along the line of sight from the cell's middle, least of all frames that see it
    at   metres from that camera
    """

    past: Flags
    surface: Flags
    off: NDArray[np.float64]
    at: NDArray[np.float64]


def true_views(folder: FlightFolder) -> Iterator[tuple[View, NDArray[np.float32]]]:
    """Frames whose truth is known, and it: at the pixels `commands.demo.AT_TRUTH`, metres."""
    for view in views(folder, TRUTH_EVERY, 1, coloured=False):
        path = TRUTH / f"{view.pose.index:06d}.png"
        if path.exists():
            yield view, read_depth(path)


def truth_of(folder: FlightFolder, middles: NDArray[np.float64], settings: CloudSettings) -> Truth:
    """The truth about cells whose middles [N, 3] are east-north-up."""
    past, surface = np.zeros(len(middles), bool), np.zeros(len(middles), bool)
    off, at = np.full(len(middles), np.inf), np.full(len(middles), np.inf)
    for view, at_truth_m in true_views(folder):
        depth_m = at_truth_m.repeat(TRUTH_STEP_PX, axis=0).repeat(TRUTH_STEP_PX, axis=1)
        there_m, true_m = looked_up(middles @ NED_FROM_ENU.T, replace(view, depth_m=depth_m))
        seen = np.isfinite(true_m) & (there_m <= settings.max_range_m)
        apart = np.where(seen, np.abs(true_m - there_m), np.inf)
        past |= seen & (true_m > there_m + settings.voxel_m)
        surface |= apart < settings.voxel_m / 2
        at = np.where(apart < off, there_m, at)
        off = np.minimum(off, apart)
    return Truth(past & ~surface, surface, off, at)


def lattice(low_m: NDArray[np.float64], high_m: NDArray[np.float64], voxel_m: float) -> NDArray[np.float64]:
    """Middles of all cells between two corners, [east, north, up, 3]."""
    axes = [
        np.arange(np.floor(a / voxel_m), np.ceil(b / voxel_m)) for a, b in zip(low_m, high_m, strict=True)
    ]
    return (np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1) + 0.5) * voxel_m


def rows(labels: NDArray[np.int32], truth: Truth, voxel_m: float) -> Iterator[tuple[str, ...]]:
    """Of the table."""
    for name, of in (("looked past", truth.past), ("with a surface", truth.surface)):
        said = (f"{name} {np.mean(labels[of] == state):.1%}" for name, state in STATES.items())
        yield f"cells {name}", f"{of.sum():,}", ", ".join(said)
    free, occupied = labels == STATES["free"], labels == STATES["occupied"]
    yield "cells called free", f"{free.sum():,}", f"with a surface {truth.surface[free].mean():.2%}"
    off, at = truth.off[occupied], truth.at[occupied]
    near, tenth = np.mean(off < voxel_m), np.mean(off < np.maximum(at / 10, voxel_m))
    said = f"a surface within a cell's width {near:.0%}, within a tenth of the distance {tenth:.0%}"
    yield "cells called occupied", f"{occupied.sum():,}", said


def picture(labels: NDArray[np.int32]) -> NDArray[np.uint8]:
    """A level [east, north] in greys, north up: free white, occupied black."""
    greys = np.vectorize(GREYS.get, otypes=[np.uint8])(labels)
    return np.asarray(greys.T[::-1].repeat(PIXELS, axis=0).repeat(PIXELS, axis=1), np.uint8)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path, help="of flightdepth demo")
    parser.add_argument("--voxel", type=float, default=OF_A_MAP["voxel_m"])
    parser.add_argument("--max-range", type=float, default=OF_A_MAP["max_range_m"])
    parser.add_argument("--every", type=int, default=CloudSettings().every)
    parser.add_argument("--max-sigma", type=float, default=CloudSettings().max_sigma)
    parser.add_argument("--picture", type=Path)
    given = parser.parse_args()
    settings = CloudSettings(
        max_sigma=given.max_sigma, max_range_m=given.max_range, voxel_m=given.voxel, every=given.every
    )
    folder, began = FlightFolder(given.folder), time.perf_counter()
    tree = occupancy_of(folder, settings)
    took_s = time.perf_counter() - began
    middles = lattice(tree.getMetricMin(), tree.getMetricMax(), settings.voxel_m)
    flat = middles.reshape(-1, 3)
    labels = np.asarray(tree.getLabels(flat)).ravel()
    table = Table(
        "", "", "", title=f"{given.folder}: {took_s:.1f} s, {len(tree.writeBinary()) / 1e3:,.0f} kB"
    )
    for row in rows(labels, truth_of(folder, flat, settings), settings.voxel_m):
        table.add_row(*row)
    Console().print(table)
    if given.picture:
        level = np.abs(middles[0, 0, :, 2]).argmin()  # the first camera's
        cv2.imwrite(str(given.picture), picture(labels.reshape(middles.shape[:3])[:, :, level]))


if __name__ == "__main__":
    main()
