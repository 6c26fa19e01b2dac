"""The space of a flight, free, occupied or unknown, as an OctoMap (Hornung et al. 2013).

A cell is occupied where a point of the cloud lies (`cloud.py` says which count). A cell is free where a frame looks
past its middle: nearer than the depth there by two deviations, or than what is "farther than". Frames vote, by
OctoMap's own odds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.errors import BadInput
from flightdepth.motion import ENU_FROM_NED, NED_FROM_ENU, Vector
from flightdepth.outputs.cloud import WIDEST, AgreedView, CloudSettings, agreed_views, looked_up
from flightdepth.outputs.cloud_files import FRAME
from flightdepth.outputs.encoding import Map
from flightdepth.outputs.read import FlightFolder
from flightdepth.ranges.fusion import RIGHT_WITHIN
from flightdepth.runtimes.lens import pixel_rays

DEVIATIONS = 2.0  # that free space ends before what is seen
REACH = 32_768  # cells that an OctoMap has either way; what lies beyond it would leave out without a word
BESIDE = 56  # of a picture's width: free is what is free as far beside it, two pixels of a network's own map


def occupancy_of(
    folder: FlightFolder, settings: CloudSettings, on_view: Callable[[], None] = lambda: None
) -> Any:
    """The `octomap.OcTree` of a flight: cells `voxel_m` wide, `max_range_m` around cameras, axes as of `cloud_of`."""
    from octomap import OcTree

    tree = OcTree(settings.voxel_m)
    for seen in agreed_views(folder, settings, on_view, coloured=False):
        reach_m = free_to(folder, seen.view.pose.index, seen.view.depth_m, settings)
        for layer in free_cells(seen, reach_m, settings):
            tree.updateNodes(layer, False, True)
        hit = np.unique(_cells(seen.points_enu, settings.voxel_m), axis=0)
        tree.updateNodes(_middles(hit, settings.voxel_m), True, True)
    tree.updateInnerOccupancy()
    return tree


def volumes_m3(tree: Any) -> tuple[float, float]:
    """What is occupied and what is free in an `octomap.OcTree`, cubic metres."""
    occupied, free = tree.extractPointCloud()  # of the smallest cells, whatever they are joined to
    cell_m3 = tree.getResolution() ** 3
    return len(occupied) * cell_m3, len(free) * cell_m3


def bt_bytes(tree: Any) -> bytes:
    """An `octomap.OcTree` as a .bt file, with a comment that says whose it is and what its axes are."""
    first, rest = tree.writeBinary().split(b"\n", 1)
    return b"\n".join([first, f"# {FRAME}".encode(), rest])


def free_to(folder: FlightFolder, index: int, depth_m: Map, settings: CloudSettings) -> Map:
    """How far each pixel [H, W] of a frame looks past nothing, metres along the axis, 0 where that is not known."""
    sigma_m = folder.sigma_m(index)
    # A network that tells no deviation has a confidence still, the chance that depth is right within so much.
    least_m = depth_m / np.float32(1 + RIGHT_WITHIN)
    nearest_m = least_m if sigma_m is None else depth_m - DEVIATIONS * sigma_m
    sure = (nearest_m > 0) & (folder.confidence(index) >= settings.min_confidence)
    bound_m = folder.farther_than_m(index)
    beyond_m = np.zeros_like(depth_m) if bound_m is None else np.nan_to_num(bound_m, nan=0.0)
    reach_m = np.where(sure, nearest_m, beyond_m)
    # What is thin may have no pixel of its own in a network's map.
    beside = 2 * max(1, round(reach_m.shape[1] / BESIDE / 2)) + 1
    return np.asarray(cv2.erode(reach_m, np.ones((beside, beside), np.uint8)), np.float32)


def free_cells(seen: AgreedView, reach_m: Map, settings: CloudSettings) -> Iterator[Vector]:
    """Middles [N, 3] of the cells that a frame looks past, `reach_m` [H, W] far, a level after the other."""
    view, here_enu = replace(seen.view, depth_m=reach_m), seen.view.pose.position_ned @ ENU_FROM_NED.T
    rays = pixel_rays(view.camera, seen.step).reshape(-1, 3).clip(-WIDEST, WIDEST)  # none is looked up beyond
    ends = (
        rays @ (ENU_FROM_NED @ view.pose.ned_from_camera).T * min(float(reach_m.max()), settings.max_range_m)
    )
    low, high = (
        _cells(here_enu + far, settings.voxel_m) for far in (ends.min(0).clip(max=0), ends.max(0).clip(min=0))
    )
    east, north = np.meshgrid(np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1))
    for up in range(low[2], high[2] + 1):
        cells = np.stack([east, north, np.full_like(east, up)], axis=-1).reshape(-1, 3)
        level = _middles(cells, settings.voxel_m)
        there_m, past_m = looked_up(level @ NED_FROM_ENU.T, view)
        yield level[(there_m < past_m) & (there_m <= settings.max_range_m)]


def _cells(points_m: Vector, voxel_m: float) -> NDArray[np.int64]:
    return np.floor(points_m / voxel_m).astype(np.int64)


def _middles(cells: NDArray[np.int64], voxel_m: float) -> Vector:
    if len(cells) and (cells.min() < -REACH or cells.max() >= REACH):
        got = f"a flight that leaves {REACH * voxel_m:,.0f} m"
        raise BadInput("--voxel", expected="larger cells", got=got)
    return np.asarray((cells + 0.5) * voxel_m, np.float64)
