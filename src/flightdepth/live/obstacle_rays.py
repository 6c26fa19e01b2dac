"""From a depth map to sectors: what each ray says, from where the drone is by now, and what a sector makes of it.

A point is an obstacle where the drone would touch it: in the corridor between `above_m` over and `below_m` under
the camera. A ray says "clear" up to its point, or up to its bound where it is only known to be "farther than". It
says nothing where confidence is low, or where the drone's motion moves the picture too little. An obstacle needs
less confidence than "clear", and a bound "at most" is one too:

    parallax_px = focal_px * displacement_m * sin(theta) / range_m       theta: angle off the direction of travel

Depth is wrong by the share noise_px / parallax_px, so within a quarter of it where parallax is at least four times
the noise. That leaves a blind cone with sin(theta) = range_m / (focal_px * displacement_m).

A result is a tenth of a second old before anybody can use it. At 5 m/s what stands 5 m to the side has left its
sector by then, so the end of each ray is moved as the drone moved before it is put into a sector.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

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

COLUMNS = 320  # of a picture are enough, and a quarter as many rows an angle
EVERY_ROW = 4
SLOWEST_M_S = 0.3  # a slower velocity hardly tells the direction of travel, where nothing else does
LEAST_LEVEL = np.float32(1e-6)  # of a ray's length, horizontally: one that looks straight down has no azimuth
FAR_M = np.float32(1e4)  # where a ray that says nothing ends: no step changes its direction


@dataclass(frozen=True, eq=False)
class Rays:
    """What n rays say, all distances horizontal.

    direction  [3, n]  in the level frame, with a horizontal length of 1
    hit_m      [n]     distance of what was seen, in the corridor or not; inf where nothing was
    clear_m    [n]     nothing up to here; 0 where the ray says nothing
    reach_m            how far they were followed: ObstacleSettings.reach_m
    """

    direction: Floats
    hit_m: Floats
    clear_m: Floats
    reach_m: float

    @classmethod
    def none(cls, reach_m: float) -> Rays:
        """Of a result without depth."""
        nothing = np.zeros(0, np.float32)
        return cls(np.zeros((3, 0), np.float32), nothing, nothing, reach_m)

    def every(self, step: int) -> Rays:
        """Each of so many."""
        return Rays(self.direction[:, ::step], self.hit_m[::step], self.clear_m[::step], self.reach_m)


@dataclass(frozen=True, eq=False)
class Moved:
    """How the drone moved: `step_m` [3] in the level frame of before, and its nose turned clockwise."""

    step_m: Vector
    turn_rad: float


STILL = Moved(np.zeros(3), 0.0)


def rays_of(depth: RangedDepth, camera: Camera, pose: Pose, sight: Sight, settings: ObstacleSettings) -> Rays:
    """What the pixels of a depth map say; of a large picture not each of them."""
    speed = float(np.linalg.norm(pose.velocity_level))
    reach_m = settings.reach_m(speed)
    if depth.reason is not None or (depth.moved_m is None and speed < SLOWEST_M_S):
        return Rays.none(reach_m)
    pixels, directions, length = _view(camera)
    toward = directions @ pose.level_from_camera.T.astype(np.float32)
    flat: Floats = np.maximum(np.hypot(toward[:, 0], toward[:, 1]), LEAST_LEVEL)
    maps = (depth.depth_m, depth.confidence, depth.farther_than_m, depth.nearer_than_m)
    depth_m, confidence, farther_m, nearer_m = (map_hw.ravel()[pixels] for map_hw in maps)
    unmeasured = np.isnan(depth_m)
    trusted = ~unmeasured & (confidence >= settings.least_confidence) & (confidence > 0)
    told_m = np.where(trusted, depth_m, np.where(unmeasured, farther_m, np.nan))
    met = ~unmeasured & (confidence >= settings.hit_confidence) & (confidence > 0)
    met_m = np.where(met, depth_m, np.where(unmeasured, nearer_m, np.nan))
    moved_m = depth.moved_m
    if moved_m is None:
        travel = pose.level_from_camera.T @ pose.velocity_level
        moved_m = depth.displacements_m[:, None] * travel / np.linalg.norm(travel)
    visible_m = farthest_visible_m(told_m, directions, length, moved_m, sight)
    # NaN compares as false: what is not told is not known.
    known = told_m <= visible_m
    beyond = (told_m > visible_m) & (visible_m * flat >= reach_m)
    seen = met_m <= farthest_visible_m(met_m, directions, length, moved_m, sight)
    return Rays(
        direction=np.divide(toward.T, flat, dtype=np.float32, order="C"),
        hit_m=np.where(seen, met_m * flat, np.float32(np.inf)),
        clear_m=np.select([known, beyond], [told_m * flat, visible_m * flat], np.float32(0.0)),
        reach_m=reach_m,
    )


def sectors_of(rays: Rays, settings: ObstacleSettings, moved: Moved = STILL) -> Sectors:
    """The sectors that rays show to a drone that has moved since."""
    ends = _ends(rays, settings, moved)
    nearest = _nearest(ends, rays.reach_m, settings.hit_share)
    sector = ends.degree[nearest] // SECTOR_DEG
    found = Sectors.unknown()
    found.obstacle_m[sector] = ends.hit_m[nearest]
    # Free where each degree is: nothing a degree wide hides among free pixels.
    clear_m = _clear(ends, rays.reach_m, settings.known_share)
    found.clear_m[:] = clear_m.reshape(SECTORS, SECTOR_DEG).min(axis=1)
    return found


@dataclass(frozen=True, eq=False)
class _Ends:
    """Where n rays end, from where the drone is now; distances horizontal.

    degree    [n]  clockwise from the nose, 0..359, counted from where the first sector begins
    hit_m     [n]  to an obstacle in the corridor, inf where there is none
    clear_m   [n]  nothing up to here; 0 where the ray says nothing
    leaves_m  [n]  where the line to the end leaves the corridor
    """

    degree: NDArray[np.intp]
    hit_m: Floats
    clear_m: Floats
    leaves_m: Floats


def _ends(rays: Rays, settings: ObstacleSettings, moved: Moved) -> _Ends:
    seen, clear = np.isfinite(rays.hit_m), rays.clear_m > 0
    end_m = np.select([seen, clear], [rays.hit_m, rays.clear_m], FAR_M)
    forward, right, down = rays.direction * end_m - moved.step_m.astype(np.float32)[:, None]
    flat_m = np.hypot(forward, right)
    azimuth_deg = np.degrees(np.arctan2(right, forward)) - np.degrees(np.float32(moved.turn_rad))
    inside = seen & (down >= -settings.above_m) & (down <= settings.below_m)
    edge_m = np.where(down > 0, np.float32(settings.below_m), np.float32(settings.above_m))
    with np.errstate(divide="ignore"):
        leaves_m = edge_m * flat_m / np.abs(down)
    return _Ends(
        degree=np.floor(azimuth_deg + SECTOR_DEG / 2).astype(np.intp) % (SECTORS * SECTOR_DEG),
        hit_m=np.where(inside, flat_m, np.float32(np.inf)),
        clear_m=np.where(clear, np.maximum(rays.clear_m + (flat_m - end_m), 0), np.float32(0)),
        leaves_m=leaves_m,
    )


def _nearest(ends: _Ends, reach_m: float, share: float) -> NDArray[np.intp]:
    """Of each sector the end at whose distance `share` of all rays that are still in the corridor there have hit
    something, where there is one."""
    sectors = ends.degree // SECTOR_DEG
    hits = np.flatnonzero(ends.hit_m <= reach_m)
    keys = _by_sector(sectors[hits], ends.hit_m[hits])
    in_order = np.argsort(keys)
    hits, keys = hits[in_order], keys[in_order]
    sector = sectors[hits]
    met = np.arange(1, len(hits) + 1) - np.searchsorted(sector, sector)
    # Of the rays of its sector those have left the corridor before a hit that end among the hits before it.
    place = np.searchsorted(keys, _by_sector(sectors, ends.leaves_m), side="right")
    left = np.cumsum(np.bincount(place, minlength=len(hits)))[: len(hits)]
    inside = np.cumsum(np.bincount(sectors, minlength=SECTORS))[sector] - left
    enough = met >= np.maximum(share * inside, 1)
    _, first = np.unique(sector[enough], return_index=True)
    return np.asarray(hits[enough][first], np.intp)


def _by_sector(sector: NDArray[np.intp], distance_m: Floats) -> Vector:
    """Numbers that sort by sector, then by distance."""
    return np.asarray(sector * (2.0 * FAR_M) + np.minimum(distance_m, FAR_M), np.float64)


def _clear(ends: _Ends, reach_m: float, share: float) -> Vector:
    """How far `share` of the rays of each degree that stay in the corridor up to `reach_m` say that it is clear: [360]
    in metres, 0 where there are none."""
    level = np.flatnonzero(ends.leaves_m >= reach_m)
    level = level[np.lexsort((ends.clear_m[level], ends.degree[level]))]
    first, after = np.searchsorted(ends.degree[level], [np.arange(360), np.arange(1, 361)])
    count = after - first
    place = first + np.minimum(np.floor((1 - share) * count).astype(np.intp), count - 1)
    told_m = ends.clear_m[level[place[count > 0]]]
    clear_m = np.zeros(360)
    clear_m[count > 0] = np.minimum(told_m, reach_m)
    return clear_m


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


@lru_cache(maxsize=4)
def _view(camera: Camera) -> tuple[NDArray[np.intp], Floats, Floats]:
    """Which pixels are taken [n]; their rays with z = 1, float32 [n, 3]; and the rays' lengths [n]."""
    step = max(1, camera.width // COLUMNS)
    rays = pixel_rays(camera, step)[::EVERY_ROW].astype(np.float32)
    sound = np.isfinite(rays).all(axis=2)  # beyond its calibrated field a lens cannot be undistorted
    columns, rows = np.meshgrid(
        np.arange(0, camera.width, step), np.arange(0, camera.height, EVERY_ROW * step)
    )
    index, rays = (rows * camera.width + columns)[sound], rays[sound]
    return np.asarray(index, np.intp), rays, np.linalg.norm(rays, axis=1)
