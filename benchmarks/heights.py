"""Whether a height map tells the truth, on the sample flight: `flightdepth demo`, then this.

    pip install scipy
    python benchmarks/heights.py flightdepth-demo --voxel 0.25 0.5 1 --picture heights.png

The truth is the renderer's: of each cell the highest point that a camera truly saw. Per distance of it from the nearest
camera ("m off"): of these cells, how many have a height; of those, the median error, how many are right to half a metre
and a metre, and how many are more than 2 m too high and too low. Beside the map: the same cloud's highest point of each
cell ("top point"), and what the map's rule makes of the true points: the error that a perfect depth would have. The
picture shows the last map from above, shaded, and its colours.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from clouds import RANGES_M, Points, true_points
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy.spatial import KDTree

from flightdepth.commands.convert import CELL_M
from flightdepth.commands.convert_heights import VOXELS_A_CELL
from flightdepth.outputs import FlightFolder
from flightdepth.outputs.cloud import CloudSettings, cloud_of
from flightdepth.outputs.heights import LEAST_POINTS, HeightMap, height_map
from flightdepth.outputs.voxels import Cloud

TRUTH_VOXEL_M = 0.05
FAR_OFF_M = 2.0
PIXELS = 4  # a cell's edge in the picture
SUN = np.array([-0.5, 0.5, 0.7])  # east, north, up: from the north-west

Heights = NDArray[np.float64]


@dataclass(frozen=True)
class Truth:
    """Middles [N, 2] of cells that hold a true point, the highest one's height [N], and its nearest camera [N]."""

    middles_m: Points
    height_m: Heights
    from_m: Heights


def highest(points: Points, cell_m: float) -> tuple[Points, Points]:
    """Middles [N, 2] of the cells that hold a point, and the highest of each [N, 3]."""
    upwards = points[np.argsort(points[:, 2])[::-1]]
    cells, place = np.unique(np.floor(upwards[:, :2] / cell_m), axis=0, return_index=True)
    return (cells + 0.5) * cell_m, upwards[place]


def heights_at(surface: HeightMap, places_m: Points) -> Heights:
    """What a map says at places [N, 2], NaN outside it."""
    west_m, north_m = surface.corner_m
    columns, rows = np.floor((places_m - (west_m, north_m)) * (1, -1) / surface.cell_m).astype(int).T
    height, width = surface.height_m.shape
    inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
    found = surface.height_m[np.where(inside, rows, 0), np.where(inside, columns, 0)]
    return np.where(inside, found, np.nan)


def highest_points(points: Points, places_m: Points, cell_m: float) -> Heights:
    """The highest point's height in the cells of those middles [N, 2], NaN where there is none."""
    middles_m, points = highest(points, cell_m)
    off_m, nearest = KDTree(middles_m).query(places_m)
    return np.where(off_m < cell_m / 2, points[nearest, 2], np.nan)


def rows(name: str, height_m: Heights, truth: Truth) -> Iterator[tuple[str, ...]]:
    """Of the table."""
    for low, high in pairwise(RANGES_M):
        here = (low <= truth.from_m) & (truth.from_m < high)
        off_m = (height_m - truth.height_m)[here]
        known = off_m[np.isfinite(off_m)]
        shares = [f"{np.mean(np.abs(known) < limit):.0%}" for limit in (0.5, 1.0)]
        shares += [f"{share:.1%}" for share in (np.mean(known > FAR_OFF_M), np.mean(known < -FAR_OFF_M))]
        median = f"{np.median(np.abs(known)):.2f} m"
        yield (
            name,
            f"{low:g} to {high:g}",
            f"{here.sum():,}",
            f"{len(known) / here.sum():.0%}",
            median,
            *shares,
        )


def picture(surface: HeightMap) -> NDArray[np.uint8]:
    """BGR: heights from dark (low) to light, shaded, and their colours beside them."""
    height_m = surface.height_m
    known = np.isfinite(height_m)
    low, high = np.percentile(height_m[known], [1, 99])
    southwards, eastwards = np.gradient(height_m, surface.cell_m)
    normals = np.stack([-eastwards, southwards, np.ones_like(height_m)], axis=-1)
    light = (normals / np.linalg.norm(normals, axis=-1, keepdims=True)) @ (SUN / np.linalg.norm(SUN))
    light = np.clip(np.where(np.isfinite(light), light, 0.7), 0, 1)  # beside unknown cells: as level ground
    share = np.clip((np.where(known, height_m, low) - low) / (high - low), 0, 1)
    tinted = cv2.applyColorMap((share * 255).astype(np.uint8), cv2.COLORMAP_VIRIDIS)
    panels = [tinted * (0.35 + 0.65 * light[..., None]), surface.colours[..., 2::-1]]
    gap = np.full((len(height_m), 2, 3), 255)
    shown = [np.where(known[..., None], panel, 255) for panel in panels]
    joined = np.concatenate([shown[0], gap, shown[1]], axis=1).astype(np.uint8)
    return np.asarray(joined.repeat(PIXELS, axis=0).repeat(PIXELS, axis=1), np.uint8)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path, help="of flightdepth demo")
    usual = CloudSettings(voxel_m=CELL_M)
    parser.add_argument("--voxel", type=float, nargs="+", default=[CELL_M])
    parser.add_argument("--max-sigma", type=float, default=usual.max_sigma)
    parser.add_argument("--max-range", type=float, default=usual.max_range_m)
    parser.add_argument("--every", type=int, default=usual.every)
    parser.add_argument("--picture", type=Path)
    given = parser.parse_args()
    folder = FlightFolder(given.folder)
    settings = replace(
        usual,
        max_sigma=given.max_sigma,
        max_range_m=given.max_range,
        voxel_m=TRUTH_VOXEL_M,
        every=given.every,
    )
    true, cameras = true_points(folder, settings)
    # It is of fewer pixels than a cloud: each counts as many as a height needs.
    perfect = Cloud(
        true, np.zeros(true.shape, np.uint8), np.ones(len(true), np.float32), np.full(len(true), LEAST_POINTS)
    )
    heads = "voxel, of, m off, cells, known, median, in .5 m, 1 m, high, low"
    table = Table(*heads.split(", "), title=str(given.folder))
    for cell_m in given.voxel:
        middles_m, tops = highest(true, cell_m)
        truth = Truth(middles_m, tops[:, 2], KDTree(cameras).query(tops)[0])
        began = time.perf_counter()
        cloud = cloud_of(folder, replace(settings, voxel_m=cell_m / VOXELS_A_CELL))
        surface = height_map(cloud, cell_m)
        took_s = time.perf_counter() - began
        ways = {
            "map": heights_at(surface, middles_m),
            "top point": highest_points(cloud.points_m, middles_m, cell_m),
            "perfect": heights_at(height_map(perfect, cell_m), middles_m),
        }
        for name, height_m in ways.items():
            for row in rows(name, height_m, truth):
                table.add_row(f"{cell_m:g}", *row)
        table.add_section()
        Console(stderr=True).print(f"voxel {cell_m:g}: {took_s:.1f} s, {surface.known:,} cells")
    Console().print(table)
    if given.picture:
        cv2.imwrite(str(given.picture), picture(surface))


if __name__ == "__main__":
    main()
