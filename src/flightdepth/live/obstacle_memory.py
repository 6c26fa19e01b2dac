"""What older results still say of sectors that the newest knows nothing of: remembered, and moved by the motion.

Needed above all where the drone flies to (no parallax there) and while it turns or brakes (no depth at all).
Two results in a row count as one: the nearer obstacle of both stands. They may have looked at different ranges in
turn (MultiRangeEstimator, `turns`), and what one misses the other may have seen.
An obstacle is remembered as its point. "Clear" is remembered as the sectors of that time: a sector is clear now as
far as each of its points lay in a clear one then.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.flight.records import NS_PER_S
from flightdepth.live.obstacle_rays import sectors_of
from flightdepth.live.obstacles import (
    SECTOR_DEG,
    SECTORS,
    Flags,
    ObstacleSettings,
    Pose,
    Sectors,
    Sight,
    level_from_world,
)
from flightdepth.motion import Vector
from flightdepth.ranges.result import RangedDepth

EVERY_NS = NS_PER_S // 5
MAX_STEP_NS = NS_PER_S // 2  # a longer gap between results: nobody knows where the drone went meanwhile
JOINED_NS = NS_PER_S // 4  # two results at most so far apart count as one
STEP_M = 1.0
# Of `max_m`: a sector remembered as clear less far than this is a gap between sectors, not a wall.
WORTH = 0.5
ACROSS_DEG = np.array([-2.0, 0.0, 2.0])


@dataclass(frozen=True, eq=False)
class Snapshot:
    """A result's own sectors, where the camera was then (NED, m) and the nose's heading."""

    stamp_ns: int
    position_ned: Vector
    heading_rad: float
    sectors: Sectors


class ObstacleMap:
    """Sectors of result after result; one a flight, not for use from several threads at once.

    sight_of  what the network sees through a camera
    """

    def __init__(self, sight_of: Callable[[Camera], Sight], settings: ObstacleSettings | None = None) -> None:
        self.settings = settings or ObstacleSettings()
        self._sight_of = lru_cache(maxsize=1)(sight_of)  # pictures seldom change their size
        self._snapshots: deque[Snapshot] = deque()
        self._before: Snapshot | None = None
        self._position: Vector = np.zeros(3)
        self._last: tuple[int, Vector] | None = None

    def add(
        self,
        stamp_ns: int,
        depth: RangedDepth,
        camera: Camera,
        *,
        world_from_camera: Vector | None,
        heading_rad: float | None,
        velocity_ned: Vector | None,
        height_m: float | None = None,
    ) -> Sectors:
        """The sectors at `stamp_ns`; all unknown where attitude, heading or velocity are."""
        if velocity_ned is None:
            self._forget()
            return Sectors.unknown()
        self._move(stamp_ns, np.asarray(velocity_ned, dtype=np.float64))
        speed = float(np.linalg.norm(velocity_ned))
        if world_from_camera is None or heading_rad is None:
            return Sectors.unknown(speed)
        settings = self.settings.over_ground(height_m)
        pose = Pose.of(world_from_camera, heading_rad, velocity_ned)
        seen = sectors_of(depth, camera, pose, self._sight_of(camera), settings)
        now = Snapshot(stamp_ns, self._position.copy(), heading_rad, seen)
        filled = self._filled(self._joined(now, settings), settings)
        self._keep(now)
        self._before = now
        return filled

    def _move(self, stamp_ns: int, velocity: Vector) -> None:
        if self._last is not None:
            step_ns = stamp_ns - self._last[0]
            if not 0 <= step_ns <= MAX_STEP_NS:
                self._forget()
            else:
                self._position += (velocity + self._last[1]) / 2 * step_ns / NS_PER_S
        self._last = stamp_ns, velocity
        oldest = stamp_ns - round(self.settings.memory_s * NS_PER_S)
        while self._snapshots and self._snapshots[0].stamp_ns < oldest:
            self._snapshots.popleft()

    def _keep(self, now: Snapshot) -> None:
        """The newest that knows anything, since the next may know nothing, and older ones EVERY_NS apart."""
        kept = self._snapshots
        if not np.isfinite(now.sectors.obstacle_m).any() and not now.sectors.clear_m.any():
            return
        if len(kept) > 1 and kept[-1].stamp_ns - kept[-2].stamp_ns < EVERY_NS:
            kept.pop()
        kept.append(now)

    def _forget(self) -> None:
        self._snapshots.clear()
        self._before, self._last = None, None

    def _joined(self, now: Snapshot, settings: ObstacleSettings) -> Snapshot:
        """With what the result before saw: the nearer obstacle, and clear as far as either knew."""
        before, seen = self._before, now.sectors
        if before is None or now.stamp_ns - before.stamp_ns > JOINED_NS:
            return now
        lacking = _lacking(seen, settings)
        obstacle_m, points_m, clear_m = seen.obstacle_m.copy(), seen.points_m.copy(), seen.clear_m.copy()
        _take_nearer(obstacle_m, points_m, moved_points(before, now, settings))
        wanted = np.flatnonzero(clear_m < settings.max_m)
        clear_m[wanted] = np.maximum(clear_m[wanted], moved_clear(before, now, wanted, settings))
        clear_m = np.fmin(clear_m, obstacle_m)
        joined = replace(seen, obstacle_m=obstacle_m, points_m=points_m, clear_m=clear_m)
        return replace(now, sectors=replace(joined, remembered=lacking & ~_lacking(joined, settings)))

    def _filled(self, now: Snapshot, settings: ObstacleSettings) -> Sectors:
        seen = now.sectors
        lacking = _lacking(seen, settings)
        if not self._snapshots or not lacking.any():
            return seen
        obstacle_m, points_m, clear_m = seen.obstacle_m.copy(), seen.points_m.copy(), seen.clear_m.copy()
        for snapshot in self._snapshots:
            moved = moved_points(snapshot, now, settings)
            _take_nearer(
                obstacle_m, points_m, [(sector, point) for sector, point in moved if lacking[sector]]
            )
            wanted = np.flatnonzero(lacking & np.isnan(obstacle_m))
            clear_m[wanted] = np.maximum(clear_m[wanted], moved_clear(snapshot, now, wanted, settings))
        # What a later snapshot saw stands before what an earlier one called clear.
        clear_m[lacking] = np.fmin(clear_m, obstacle_m)[lacking]
        remembered = seen.remembered | (lacking & (np.isfinite(obstacle_m) | (clear_m > 0)))
        return replace(seen, obstacle_m=obstacle_m, clear_m=clear_m, points_m=points_m, remembered=remembered)


def _lacking(sectors: Sectors, settings: ObstacleSettings) -> Flags:
    """Which sectors nothing is known of, [72]."""
    return np.asarray(np.isnan(sectors.obstacle_m) & (sectors.clear_m < settings.min_m))


def _take_nearer(obstacle_m: Vector, points_m: Vector, moved: list[tuple[int, Vector]]) -> None:
    """Put each point (3,) into its sector of obstacle_m [72] and points_m [72, 3], where none nearer stands."""
    for sector, point in moved:
        distance = float(np.hypot(point[0], point[1]))
        if not obstacle_m[sector] <= distance:  # NaN: none stands there
            obstacle_m[sector], points_m[sector] = distance, point


def moved_points(then: Snapshot, now: Snapshot, settings: ObstacleSettings) -> list[tuple[int, Vector]]:
    """Obstacles of `then` that still stand in the corridor, each with its sector and its point as seen now."""
    points = then.sectors.points_m[np.isfinite(then.sectors.obstacle_m)]
    world = points @ level_from_world(then.heading_rad) + then.position_ned - now.position_ned
    level = world @ level_from_world(now.heading_rad).T
    inside = (level[:, 2] >= -settings.above_m) & (level[:, 2] <= settings.below_m)
    return [
        (int(sector), point) for sector, point in zip(sector_of(level[inside]), level[inside], strict=True)
    ]


def moved_clear(
    then: Snapshot, now: Snapshot, wanted: NDArray[np.intp], settings: ObstacleSettings
) -> Vector:
    """How far the `wanted` sectors [k] are clear now, as far as `then` knew: [k] in metres, 0 where hardly."""
    apart_m = float(np.linalg.norm(now.position_ned - then.position_ned))
    if then.sectors.clear_m.max() + apart_m < WORTH * settings.max_m:
        return np.zeros(len(wanted))
    reach_m = settings.reach_m(now.sectors.speed_m_s)
    ranges = np.append(np.arange(STEP_M, reach_m, STEP_M), reach_m)
    azimuths = np.radians(wanted[:, None] * SECTOR_DEG + ACROSS_DEG)
    rays = np.stack([np.cos(azimuths), np.sin(azimuths), np.zeros_like(azimuths)], axis=-1)
    # [k, across, range, 3], from the level frame of now into that of then
    points = ranges[:, None] * rays[:, :, None, :] @ level_from_world(now.heading_rad)
    points = (points + now.position_ned - then.position_ned) @ level_from_world(then.heading_rad).T
    within = np.hypot(points[..., 0], points[..., 1])
    # The drone was nearby itself.
    known = (within < then.sectors.clear_m[sector_of(points)]) | (within < settings.min_m)
    # The corridor moved up or down with the drone: where it left the old one nothing is known.
    known &= abs(points[..., 2]) < min(settings.above_m, settings.below_m) / 2
    steps = np.cumprod(known.all(axis=1), axis=1).sum(axis=1)
    reached = np.concatenate([[0.0], ranges])[steps]
    return np.where(reached >= WORTH * settings.max_m, reached, 0.0)


def sector_of(points_level: Vector) -> NDArray[np.intp]:
    """The sector of each point [..., 3] of the level frame."""
    azimuth_deg = np.degrees(np.arctan2(points_level[..., 1], points_level[..., 0]))
    return np.asarray(np.rint(azimuth_deg / SECTOR_DEG) % SECTORS, np.intp)
