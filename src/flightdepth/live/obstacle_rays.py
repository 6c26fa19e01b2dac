"""From a depth map to sectors: what each ray says, and what a sector makes of its rays.

A point is an obstacle where the drone would touch it: in the corridor between `above_m` over and `below_m` under
the camera. A ray says "clear" up to its point, or up to its bound where it is only known to be "farther than". It
says nothing where confidence is low, or where the drone's motion moves the picture too little. An obstacle needs
less confidence than "clear", and a bound "at most" is one too:

    parallax_px = focal_px * displacement_m * sin(theta) / range_m       theta: angle off the direction of travel

Depth is wrong by the share noise_px / parallax_px, so within a quarter of it where parallax is at least four times
the noise. That leaves a blind cone with sin(theta) = range_m / (focal_px * displacement_m).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.live.obstacles import (
    LEAST_PARALLAX_PX,
    SECTOR_DEG,
    SECTORS,
    ObstacleSettings,
    Pose,
    Sectors,
    Sight,
)
from flightdepth.motion import Vector
from flightdepth.ranges.result import RangedDepth
from flightdepth.runtimes.lens import pixel_rays

Floats = NDArray[np.float32]

PARTS = 5  # a sector is free where each degree of it is: nothing a degree wide hides among free pixels
COLUMNS = 320  # of a picture are enough, and half as many rows an angle
SLOWEST_M_S = 0.3  # a slower velocity hardly tells the direction of travel, where nothing else does


@dataclass(frozen=True, eq=False)
class Rays:
    """What n rays say, all distances horizontal.

    azimuth_deg  [n]     0..360, clockwise from the nose
    hit_m        [n]     distance of the obstacle seen, inf where none
    clear_m      [n]     nothing up to here; 0 where the ray says nothing
    leaves_m     [n]     where the ray leaves the corridor
    points_m     [n, 3]  what was seen, in the level frame
    """

    azimuth_deg: Floats
    hit_m: Floats
    clear_m: Floats
    leaves_m: Floats
    points_m: Floats


def sectors_of(
    depth: RangedDepth, camera: Camera, pose: Pose, sight: Sight, settings: ObstacleSettings
) -> Sectors:
    """The sectors that one depth map shows."""
    speed = float(np.linalg.norm(pose.velocity_level))
    if depth.reason is not None or (depth.moved_m is None and speed < SLOWEST_M_S):
        return Sectors.unknown(speed)
    reach_m = settings.reach_m(speed)
    rays = rays_of(depth, camera, pose, sight, settings)
    part = (np.floor(rays.azimuth_deg + SECTOR_DEG / 2) % 360).astype(np.intp)
    order = np.argsort(part, kind="stable")
    edges = np.searchsorted(part[order], np.arange(361))
    found = Sectors.unknown(speed)
    for sector in range(SECTORS):
        pieces = edges[sector * PARTS : sector * PARTS + PARTS + 1]
        if pieces[0] == pieces[-1]:
            continue
        nearest = _nearest(rays, order[pieces[0] : pieces[-1]], reach_m, settings.hit_share)
        if nearest is not None:
            found.obstacle_m[sector] = rays.hit_m[nearest]
            found.points_m[sector] = rays.points_m[nearest]
        found.clear_m[sector] = min(
            _clear(rays, order[start:end], reach_m, settings.known_share) for start, end in pairwise(pieces)
        )
    return found


def rays_of(depth: RangedDepth, camera: Camera, pose: Pose, sight: Sight, settings: ObstacleSettings) -> Rays:
    """What the pixels of a depth map say; of a large picture not each of them."""
    pixels, directions, length = _view(camera)
    toward = directions @ pose.level_from_camera.T.astype(np.float32)
    flat = np.hypot(toward[:, 0], toward[:, 1])
    maps = (depth.depth_m, depth.confidence, depth.farther_than_m, depth.nearer_than_m)
    depth_m, confidence, farther_m, nearer_m = (map_hw.ravel()[pixels] for map_hw in maps)
    unmeasured = np.isnan(depth_m)
    trusted = ~unmeasured & (confidence >= settings.least_confidence) & (confidence > 0)
    told_m = np.where(trusted, depth_m, np.where(unmeasured, farther_m, np.nan))
    met = ~unmeasured & (confidence >= settings.hit_confidence) & (confidence > 0)
    met_m = np.where(met, depth_m, np.where(unmeasured, nearer_m, np.nan))
    reach_m = settings.reach_m(float(np.linalg.norm(pose.velocity_level)))
    moved_m = depth.moved_m
    if moved_m is None:
        travel = pose.level_from_camera.T @ pose.velocity_level
        moved_m = depth.displacements_m[:, None] * travel / np.linalg.norm(travel)
    visible_m = farthest_visible_m(told_m, directions, length, moved_m, sight)
    # NaN compares as false: what is not told is not known.
    known = told_m <= visible_m
    beyond = (told_m > visible_m) & (visible_m * flat >= reach_m)
    down_m = met_m * toward[:, 2]
    inside = (down_m >= -settings.above_m) & (down_m <= settings.below_m)
    inside &= met_m <= farthest_visible_m(met_m, directions, length, moved_m, sight)
    with np.errstate(divide="ignore"):
        edge_m = np.where(toward[:, 2] > 0, np.float32(settings.below_m), np.float32(settings.above_m))
        leaves = np.asarray(edge_m * flat / np.abs(toward[:, 2]), np.float32)
    return Rays(
        azimuth_deg=np.degrees(np.arctan2(toward[:, 1], toward[:, 0])) % 360,
        hit_m=np.where(inside, met_m * flat, np.inf),
        clear_m=np.select([known, beyond], [told_m * flat, reach_m], 0.0),
        leaves_m=leaves,
        points_m=met_m[:, None] * toward,
    )


def farthest_visible_m(
    depth_m: Floats, rays: Floats, length: Floats, moved_m: Vector, sight: Sight
) -> Floats:
    """The z-depth [n] at which a point on each ray would still have moved by the least parallax.

    rays [n, 3] with z = 1, their length [n] and the displacements moved_m [k, 3], all in the camera's axes. The
    longest displacements see nothing nearer than `least_depth_per_m` times their length; what lies nearer, at
    `depth_m` [n], was seen over a shorter one.
    """
    by_length = moved_m[np.argsort(np.linalg.norm(moved_m, axis=1))].astype(np.float32)
    across_m = _across(rays, length, by_length[0])
    for moved in by_length[1:]:
        sees = depth_m >= sight.least_depth_per_m * float(np.linalg.norm(moved))
        across_m = np.where(sees, _across(rays, length, moved), across_m)
    return np.asarray(np.float32(sight.focal_px / LEAST_PARALLAX_PX) * across_m / length)


def _across(rays: Floats, length: Floats, moved: Floats) -> Floats:
    """How much of a displacement [3] is across each ray, in metres: its length times sin(theta)."""
    along = rays @ moved / length
    return np.asarray(np.sqrt(np.maximum(moved @ moved - np.square(along), 0)))


def _nearest(rays: Rays, sector: NDArray[np.intp], reach_m: float, share: float) -> int | None:
    """The ray at whose distance `share` of all rays that are still in the corridor there have hit something."""
    hit_m = rays.hit_m[sector]
    hits = sector[hit_m <= reach_m]
    if not len(hits):
        return None
    hits = hits[np.argsort(rays.hit_m[hits])]
    inside = len(sector) - np.searchsorted(np.sort(rays.leaves_m[sector]), rays.hit_m[hits])
    enough = np.arange(1, len(hits) + 1) >= np.maximum(share * inside, 1)
    return int(hits[np.argmax(enough)]) if enough.any() else None


def _clear(rays: Rays, part: NDArray[np.intp], reach_m: float, share: float) -> float:
    """How far `share` of the rays that stay in the corridor up to `reach_m` say that it is clear."""
    level = part[rays.leaves_m[part] >= reach_m]
    if not len(level):
        return 0.0
    clear = np.sort(rays.clear_m[level])
    return float(min(reach_m, clear[min(math.floor((1 - share) * len(level)), len(level) - 1)]))


@lru_cache(maxsize=4)
def _view(camera: Camera) -> tuple[NDArray[np.intp], Floats, Floats]:
    """Which pixels are taken [n]; their rays with z = 1, float32 [n, 3]; and the rays' lengths [n]."""
    step = max(1, camera.width // COLUMNS)
    rays = pixel_rays(camera, step)[::2].astype(np.float32)
    sound = np.isfinite(rays).all(axis=2)  # beyond its calibrated field a lens cannot be undistorted
    columns, rows = np.meshgrid(np.arange(0, camera.width, step), np.arange(0, camera.height, 2 * step))
    index, rays = (rows * camera.width + columns)[sound], rays[sound]
    return np.asarray(index, np.intp), rays, np.linalg.norm(rays, axis=1)
