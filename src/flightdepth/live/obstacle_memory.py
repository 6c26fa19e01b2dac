"""What results say of the sectors by now, and what older ones still say of those that the newest knows nothing of.

Needed above all where the drone flies to (no parallax there) and while it turns or brakes (no depth at all).
Two results in a row count as one: the nearer obstacle of both stands. They may have looked at different ranges in
turn (MultiRangeEstimator, `turns`), and what one misses the other may have seen.
Each ray is moved by the motion since. But of older results only what it hit counts so: what one saw past then, another
place sees from the side. "Clear" is remembered as the sectors of that time: a sector is clear now as far as each of
its points lay in a clear one then.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.flight.records import NS_PER_S
from flightdepth.live.obstacle_rays import Moved, Rays, rays_of, sectors_of
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
REMEMBERED_RAY = 4  # each fourth: 300 of a sector's 1,400
STEP_M = 1.0
# Of `max_m`: a sector remembered as clear less far than this is a gap between sectors, not a wall.
WORTH = 0.5
ACROSS_DEG = np.array([-2.0, 0.0, 2.0])


@dataclass(frozen=True, eq=False)
class Place:
    """Where the camera was at a time (NED, m), and the nose's heading."""

    stamp_ns: int
    position_ned: Vector
    heading_rad: float

    def to(self, later: Place) -> Moved:
        """How the drone moved from here."""
        step_m = level_from_world(self.heading_rad) @ (later.position_ned - self.position_ned)
        return Moved(step_m, later.heading_rad - self.heading_rad)


@dataclass(frozen=True, eq=False)
class Seen:
    """What the rays of a result said, from where, and in which corridor."""

    place: Place
    rays: Rays
    settings: ObstacleSettings

    @cached_property
    def sectors(self) -> Sectors:
        """Its sectors at its own time."""
        return sectors_of(self.rays, self.settings)

    @cached_property
    def few(self) -> Rays:
        """Enough of them to remember obstacles by."""
        return self.rays.every(REMEMBERED_RAY)


class ObstacleMap:
    """Results in, sectors at any time after; one a flight, not for use from several threads at once.

    sight_of  what the network sees through a camera
    """

    def __init__(self, sight_of: Callable[[Camera], Sight], settings: ObstacleSettings | None = None) -> None:
        self.settings = settings or ObstacleSettings()
        self._sight_of = lru_cache(maxsize=1)(sight_of)  # pictures seldom change their size
        # Each with the result before it, since they may have looked near and far in turn.
        self._kept: deque[tuple[Seen, ...]] = deque()
        self._newest: Seen | None = None
        self._before: Seen | None = None
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
    ) -> None:
        """Take the result of a picture; all is unknown while attitude, heading or velocity are."""
        self._before, self._newest = self._newest or self._before, None
        if velocity_ned is None:
            self._forget()
            return
        self._move(stamp_ns, np.asarray(velocity_ned, dtype=np.float64))
        if world_from_camera is None or heading_rad is None:
            return
        settings = self.settings.over_ground(height_m)
        pose = Pose.of(world_from_camera, heading_rad, velocity_ned)
        rays = rays_of(depth, camera, pose, self._sight_of(camera), settings)
        place = Place(stamp_ns, self._position.copy(), heading_rad)
        self._newest = Seen(place, rays, settings)
        self._keep()

    def at(
        self, stamp_ns: int, *, heading_rad: float | None = None, velocity_ned: Vector | None = None
    ) -> Sectors:
        """The sectors at a time, not before the newest result's, to a drone that has this heading and velocity by then;
        as that result had them where they are not given."""
        newest = self._newest
        if newest is None or self._last is None:
            return Sectors.unknown()
        then, velocity_then = newest.place, self._last[1]
        late_s = max(0, stamp_ns - then.stamp_ns) / NS_PER_S
        velocity = velocity_then if velocity_ned is None else velocity_ned
        now = Place(
            max(stamp_ns, then.stamp_ns),
            then.position_ned + (velocity_then + velocity) / 2 * late_s,
            then.heading_rad if heading_rad is None else heading_rad,
        )
        joined = self._in_a_row()
        # Each once: where results come slowly, the one before is kept as the newest of its time too.
        older = [then for then in dict.fromkeys(chain.from_iterable(self._kept)) if then not in joined]
        return _filled(_joined(joined, now), older, now, newest)

    def _move(self, stamp_ns: int, velocity: Vector) -> None:
        if self._last is not None:
            step_ns = stamp_ns - self._last[0]
            if not 0 <= step_ns <= MAX_STEP_NS:
                self._forget()
            else:
                self._position += (velocity + self._last[1]) / 2 * step_ns / NS_PER_S
        self._last = stamp_ns, velocity
        oldest = stamp_ns - round(self.settings.memory_s * NS_PER_S)
        while self._kept and self._kept[0][0].place.stamp_ns < oldest:
            self._kept.popleft()

    def _in_a_row(self) -> tuple[Seen, ...]:
        """The newest result and, if it is no older than that, the one before."""
        newest, before = self._newest, self._before
        assert newest is not None
        if before is None or newest.place.stamp_ns - before.place.stamp_ns > JOINED_NS:
            return (newest,)
        return newest, before

    def _keep(self) -> None:
        """The newest that says anything, since the next may say nothing, and older ones EVERY_NS apart."""
        row = self._in_a_row()
        if not np.isfinite(row[0].rays.hit_m).any() and not row[0].rays.clear_m.any():
            return
        kept = self._kept
        if len(kept) > 1 and kept[-1][0].place.stamp_ns - kept[-2][0].place.stamp_ns < EVERY_NS:
            kept.pop()
        kept.append(row)

    def _forget(self) -> None:
        self._kept.clear()
        self._before, self._last = None, None


def _joined(row: tuple[Seen, ...], now: Place) -> Sectors:
    """What the newest result says by now, with what the one before saw: the nearer obstacle, and clear as far as
    either knew."""
    settings = row[0].settings
    seen, *earlier = (sectors_of(then.rays, settings, then.place.to(now)) for then in row)
    joined = seen
    for each in earlier:
        obstacle_m = np.fmin(joined.obstacle_m, each.obstacle_m)
        clear_m = np.fmin(np.maximum(joined.clear_m, each.clear_m), obstacle_m)
        joined = replace(joined, obstacle_m=obstacle_m, clear_m=clear_m)
    return replace(joined, remembered=_lacking(seen, settings) & ~_lacking(joined, settings))


def _filled(seen: Sectors, older: list[Seen], now: Place, newest: Seen) -> Sectors:
    """With what `older` results still say of sectors of which nothing is known."""
    settings = newest.settings
    lacking = _lacking(seen, settings)
    if not older or not lacking.any():
        return seen
    obstacle_m, clear_m = seen.obstacle_m.copy(), seen.clear_m.copy()
    for then in older:
        then_m = sectors_of(then.few, settings, then.place.to(now)).obstacle_m
        obstacle_m[lacking] = np.fmin(obstacle_m, then_m)[lacking]
        wanted = np.flatnonzero(lacking & np.isnan(obstacle_m))
        clear_m[wanted] = np.maximum(clear_m[wanted], moved_clear(then, now, wanted, newest))
    # What a later result saw stands before what an earlier one called clear.
    clear_m[lacking] = np.fmin(clear_m, obstacle_m)[lacking]
    remembered = seen.remembered | (lacking & (np.isfinite(obstacle_m) | (clear_m > 0)))
    return Sectors(obstacle_m, clear_m, remembered)


def _lacking(sectors: Sectors, settings: ObstacleSettings) -> Flags:
    """Which sectors nothing is known of, [72]."""
    return np.asarray(np.isnan(sectors.obstacle_m) & (sectors.clear_m < settings.min_m))


def moved_clear(then: Seen, now: Place, wanted: NDArray[np.intp], newest: Seen) -> Vector:
    """How far the `wanted` sectors [k] are clear now, as far as `then` knew: [k] in metres, 0 where hardly."""
    settings, reach_m, moved = newest.settings, newest.rays.reach_m, then.place.to(now)
    worth_m = WORTH * settings.max_m
    found = np.zeros(len(wanted))
    if then.sectors.clear_m.max() + float(np.linalg.norm(moved.step_m)) < worth_m:
        return found
    # What was not clear at that range is not worth the other ranges' time.
    ahead = np.flatnonzero(_was_clear(then, moved, wanted, np.array([worth_m]), settings)[:, 0])
    ranges = np.append(np.arange(STEP_M, reach_m, STEP_M), reach_m)
    steps = np.cumprod(_was_clear(then, moved, wanted[ahead], ranges, settings), axis=1).sum(axis=1)
    reached = np.concatenate([[0.0], ranges])[steps]
    found[ahead] = np.where(reached >= worth_m, reached, 0.0)
    return found


def _was_clear(
    then: Seen, moved: Moved, sectors: NDArray[np.intp], ranges: Vector, settings: ObstacleSettings
) -> Flags:
    """Whether all across these sectors [k] of now the places at these ranges [r] were clear then, [k, r]."""
    azimuths = np.radians(sectors[:, None] * SECTOR_DEG + ACROSS_DEG)
    rays = np.stack([np.cos(azimuths), np.sin(azimuths), np.zeros_like(azimuths)], axis=-1)
    # [k, across, range, 3], from the level frame of now into that of then
    points = ranges[:, None] * rays[:, :, None, :] @ level_from_world(moved.turn_rad) + moved.step_m
    within = np.hypot(points[..., 0], points[..., 1])
    # The drone was nearby itself.
    known = (within < then.sectors.clear_m[sector_of(points)]) | (within < settings.min_m)
    # The corridor moved up or down with the drone: where it left the old one nothing is known.
    known &= abs(points[..., 2]) < min(settings.above_m, settings.below_m) / 2
    return np.asarray(known.all(axis=1))


def sector_of(points_level: Vector) -> NDArray[np.intp]:
    """The sector of each point [..., 3] of the level frame."""
    azimuth_deg = np.degrees(np.arctan2(points_level[..., 1], points_level[..., 0]))
    return np.asarray(np.rint(azimuth_deg / SECTOR_DEG) % SECTORS, np.intp)
