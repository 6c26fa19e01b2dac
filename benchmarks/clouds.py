"""Whether a point cloud tells the truth, on the sample flight: `flightdepth demo`, then this.

    pip install scipy
    python benchmarks/clouds.py flightdepth-demo --max-sigma 0.04 0.08 1 --picture cloud.png

The truth is the renderer's, as far as --max-range, one point a cube of --voxel. Per distance from the nearest camera:
of the cloud's points, how many lie within half a metre and a metre of a true surface, and within what 95 % do; of the
true surfaces, how many have a point within a metre. The picture shows the last cloud from above, north up.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from occupancy import true_views
from rich.console import Console
from rich.table import Table
from scipy.spatial import KDTree

from flightdepth.commands.demo import AT_TRUTH
from flightdepth.motion import ENU_FROM_NED
from flightdepth.outputs import FlightFolder
from flightdepth.outputs.cloud import CloudSettings, cloud_of
from flightdepth.outputs.voxels import Cloud, VoxelGrid
from flightdepth.runtimes.lens import pixel_rays

RANGES_M = (0.0, 15.0, 30.0, 60.0)
PIXELS_A_METRE = 8

Points = NDArray[np.float64]


def true_points(folder: FlightFolder, settings: CloudSettings) -> tuple[Points, Points]:
    """What the cameras truly saw, and where they were, [N, 3] and [K, 3], east-north-up."""
    grid, cameras = VoxelGrid(settings.voxel_m), []
    for view, depth_m in true_views(folder):
        rays = pixel_rays(view.camera, 1)[AT_TRUTH]
        near = depth_m <= settings.max_range_m
        seen = rays[near] * depth_m[near, None].astype(float)
        points = (seen @ view.pose.ned_from_camera.T + view.pose.position_ned) @ ENU_FROM_NED.T
        grid.add(points, np.zeros(points.shape, np.uint8), np.ones(len(points), np.float32))
        cameras.append(view.pose.position_ned @ ENU_FROM_NED.T)
    return grid.cloud().points_m, np.stack(cameras)


def from_above(cloud: Cloud) -> NDArray[np.uint8]:
    """A picture BGR [H, W, 3], north up; what is higher hides what is lower."""
    across_m = cloud.points_m[:, :2]
    places = (PIXELS_A_METRE * (across_m - across_m.min(axis=0))).astype(int)
    picture = np.full((*(places.max(axis=0)[::-1] + 2), 3), 255, np.uint8)
    upwards = np.argsort(cloud.points_m[:, 2])
    columns, rows = places[upwards].T
    for right, down in np.ndindex(2, 2):
        picture[rows + down, columns + right] = cloud.colours[upwards, ::-1]
    return picture[::-1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path, help="of flightdepth demo")
    usual = CloudSettings()
    parser.add_argument("--max-sigma", type=float, nargs="+", default=[usual.max_sigma])
    parser.add_argument("--every", type=int, default=usual.every)
    parser.add_argument("--min-confidence", type=float, default=usual.min_confidence)
    parser.add_argument("--max-range", type=float, default=usual.max_range_m)
    parser.add_argument("--voxel", type=float, default=usual.voxel_m)
    parser.add_argument("--picture", type=Path)
    given = parser.parse_args()
    settings = CloudSettings(given.min_confidence, usual.max_sigma, given.max_range, given.voxel, given.every)
    folder = FlightFolder(given.folder)
    truth, cameras = true_points(folder, settings)
    truth_from = KDTree(cameras).query(truth)[0]
    heads = "max-sigma, from a camera, points, within .5 m, 1 m, 95 % within, surfaces with a point"
    table = Table(*heads.split(", "), title=str(given.folder))
    for max_sigma in given.max_sigma:
        began = time.perf_counter()
        cloud = cloud_of(folder, replace(settings, max_sigma=max_sigma))
        took_s = time.perf_counter() - began
        cloud_from, off = (KDTree(to).query(cloud.points_m)[0] for to in (cameras, truth))
        missed = KDTree(cloud.points_m).query(truth)[0]
        for low, high in pairwise(RANGES_M):
            here, there = (low <= cloud_from) & (cloud_from < high), (low <= truth_from) & (truth_from < high)
            cells = [f"{np.mean(off[here] < limit):.0%}" for limit in (0.5, 1.0)]
            cells += [f"{np.percentile(off[here], 95):.1f} m", f"{np.mean(missed[there] < 1.0):.0%}"]
            table.add_row(f"{max_sigma:g}", f"{low:g} to {high:g} m", f"{here.sum():,}", *cells)
        table.add_section()
        Console(stderr=True).print(f"max-sigma {max_sigma:g}: {took_s:.1f} s")
    Console().print(table)
    if given.picture:
        cv2.imwrite(str(given.picture), from_above(cloud))


if __name__ == "__main__":
    main()
