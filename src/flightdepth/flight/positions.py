"""Velocity and way from positions: latitude, longitude and height as a GPS repeats them between its fixes.

A camera writes a position for each picture or second, but the receiver has a new one only now and then, and
each is rounded. So the instants at which the value really changed are found first, and the velocity is the
slope of a straight line fitted to the positions of a short window around each (local_regression.py).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from flightdepth.flight.local_regression import half_window_s, line_slopes
from flightdepth.flight.order import rising
from flightdepth.flight.places import AltitudeAbove, PlaceTrack
from flightdepth.flight.records import FASTEST_M_S, NS_PER_S, VelocitySample
from flightdepth.motion import Stamps, Vector

EARTH_RADIUS_M = 6378137.0  # WGS 84, equator
EARTH_ECCENTRICITY_SQUARED = 6.69437999014e-3
APART_S = 1.0  # velocities are told at least so often, where fixes are seldom seen to change
JUMPING = "positions that jump"
UNFIXED = "positions without a fix"
LEVEL = "positions without an altitude"
JUMP_M = 100.0  # off the median of its neighbours: not flown
DEGREE_M = 111_320.0  # of the equator: the longest

Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Velocities:
    """Velocity [n, 3] north-east-down, m/s, its standard deviation per component [n], the stamps [n]."""

    stamps_ns: Stamps
    velocity_ned: Vector
    sigma: Vector

    @classmethod
    def none(cls) -> Velocities:
        """Of no instant."""
        return cls(np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros(0))

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def where(self, kept: NDArray[np.bool_]) -> Velocities:
        """Those of a mask [n]."""
        return Velocities(self.stamps_ns[kept], self.velocity_ned[kept], self.sigma[kept])

    def samples(self) -> list[VelocitySample]:
        """One for each instant, in the world frame."""
        table = zip(self.stamps_ns.tolist(), self.velocity_ned, self.sigma.tolist(), strict=True)
        return [VelocitySample(stamp_ns, ned, "world", sigma) for stamp_ns, ned, sigma in table]


def velocities_by_places(
    stamps_ns: Stamps, places_deg: Vector, heights_m: Vector, counts: Counter[str]
) -> Velocities:
    """From latitudes and longitudes [n, 2] and heights [n] at rising stamps; positions that jump are counted.

    None where fewer than two are sound.
    """
    if len(stamps_ns) < 2:
        return Velocities.none()
    ned = local_ned(places_deg, heights_m)
    kept = without_jumps(ned)
    counts[JUMPING] += int((~kept).sum())
    if np.count_nonzero(kept) < 2:
        return Velocities.none()
    steps_m = decimal_step(places_deg[kept]) * DEGREE_M, decimal_step(heights_m[kept])
    return velocities(stamps_ns[kept], ned[kept], steps_m=steps_m)


def velocities_by_fixes(
    stamps_ns: Stamps, places_deg: Vector, altitudes_m: Vector, counts: Counter[str]
) -> Velocities:
    """The same where places may be none on Earth and altitudes [n] NaN; both are counted.

    An altitude is filled in from those around it, or all are level.
    """
    fixed = on_earth(places_deg)
    counts[UNFIXED] += int((~fixed).sum())
    stamps_ns, places_deg, altitudes_m = stamps_ns[fixed], places_deg[fixed], altitudes_m[fixed]
    told = np.isfinite(altitudes_m)
    counts[LEVEL] += int((~told).sum())
    if told.any():
        at_s = (stamps_ns - stamps_ns[0]) / NS_PER_S
        altitudes_m = np.interp(at_s, at_s[told], altitudes_m[told])
    else:
        altitudes_m = np.zeros(len(stamps_ns))
    return velocities_by_places(stamps_ns, places_deg, altitudes_m, counts)


def place_track(
    stamps_ns: Sequence[int] | Stamps,
    places_deg: Vector,
    altitudes_m: Vector,
    above: AltitudeAbove,
    counts: Counter[str] | None = None,
) -> PlaceTrack | None:
    """From latitudes and longitudes [n, 2] and altitudes [n], NaN where they are not told, at any stamps.

    Only real fixes stand in it: positions that repeat until the next would lag behind. What is no place on Earth goes,
    positions that jump are counted, unless they have been; None where fewer than two are sound.
    """
    stamps = np.asarray(stamps_ns, dtype=np.int64)
    kept = np.flatnonzero(on_earth(places_deg))
    kept = kept[rising(stamps[kept].tolist())]
    if len(kept) < 2:
        return None
    sound = without_jumps(local_ned(places_deg[kept], np.zeros(len(kept))))
    if counts is not None:
        counts[JUMPING] += int((~sound).sum())
    kept = kept[sound]
    if len(kept) < 2:
        return None
    kept = kept[fixes((stamps[kept] - stamps[kept[0]]) / NS_PER_S, places_deg[kept])]
    altitudes_m = np.where(np.isfinite(altitudes_m), altitudes_m, np.nan)[kept]
    told = above if np.isfinite(altitudes_m).any() else None
    return PlaceTrack(stamps[kept], np.c_[places_deg[kept], altitudes_m], told)


def on_earth(places_deg: Vector) -> NDArray[np.bool_]:
    """Which latitudes and longitudes [n, 2] are any; 0, 0 is written before the first fix."""
    return np.asarray((np.abs(places_deg) <= (90, 180)).all(axis=1) & places_deg.any(axis=1))


def local_ned(places_deg: Vector, heights_m: Vector) -> Vector:
    """Metres north, east, down [n, 3] of the first of latitudes and longitudes [n, 2], for flights of some 10 km.

    North = M d(latitude), east = N cos(latitude) d(longitude), with the radii of curvature of WGS 84 at the
    median latitude, since the first may be wrong: M = a (1 - e^2) / (1 - e^2 sin^2)^1.5 and
    N = a / (1 - e^2 sin^2)^0.5.
    """
    latitude, longitude = np.deg2rad(places_deg).T
    middle = np.median(latitude)
    flattened = 1 - EARTH_ECCENTRICITY_SQUARED * np.sin(middle) ** 2
    meridian_m = EARTH_RADIUS_M * (1 - EARTH_ECCENTRICITY_SQUARED) / flattened**1.5
    parallel_m = EARTH_RADIUS_M / np.sqrt(flattened) * np.cos(middle)
    east_rad = (longitude - longitude[0] + np.pi) % (2 * np.pi) - np.pi  # across the date line too
    return np.stack([meridian_m * (latitude - latitude[0]), parallel_m * east_rad, -heights_m], axis=1)


def without_jumps(ned: Vector) -> NDArray[np.bool_]:
    """Which positions [n, 3] lie within JUMP_M of the median of the five around them.

    Beyond either end stands what the next three say of the end, straight on, so that it may jump too.
    """
    before, after = _end_foretold(ned), _end_foretold(ned[::-1])[::-1]
    around = np.lib.stride_tricks.sliding_window_view(np.concatenate([before, ned, after]), 5, axis=0)
    return np.asarray(np.abs(ned - np.median(around, axis=-1)).max(axis=1) <= JUMP_M)


def _end_foretold(ned: Vector) -> Vector:
    """The first of positions [n, 3] by the line through the third and fourth, and the second and third, [2, 3]."""
    if len(ned) < 4:
        return np.repeat(ned[:1], 2, axis=0)
    return np.stack([3 * ned[2] - 2 * ned[3], 2 * ned[1] - ned[2]])


def fixes(times_s: Vector, values: Vector) -> Indices:
    """Indices of the real fixes among `values` [n, k] at rising times: those that changed.

    One that stands still also counts, a fix's time and a half after the last: a hovering drone has fixes too.
    """
    changed = np.flatnonzero(np.r_[True, (np.diff(values, axis=0) != 0).any(axis=1)])
    period_s = fix_period_s(times_s, changed)
    is_change = np.zeros(len(values), dtype=bool)
    is_change[changed] = True
    kept = [0]
    for index in range(1, len(values)):
        if is_change[index] or times_s[index] - times_s[kept[-1]] > 1.5 * period_s:
            kept.append(index)
    return np.array(kept, dtype=np.int64)


def fix_period_s(times_s: Vector, changed: Indices) -> float:
    """Median time between changes; 1 s where there are none."""
    return float(np.median(np.diff(times_s[changed]))) if len(changed) > 1 else 1.0


def filled(times_s: Vector, kept: Indices) -> Indices:
    """`kept`, and between two that lie farther apart than APART_S those of `times_s` that part them evenly.

    A line around a time between two fixes tells its velocity as well as one around a fix.
    """
    found, middles_s = [kept], (times_s[1:] + times_s[:-1]) / 2
    for first, last in pairwise(kept.tolist()):
        first_s, last_s = times_s[first], times_s[last]
        # A clock that is set while it is recorded leaves a gap of years, in which nothing was told.
        parts = min(math.ceil((last_s - first_s) / APART_S - 0.25), last - first)
        found.append(np.searchsorted(middles_s, np.linspace(first_s, last_s, max(parts, 1) + 1)[1:-1]))
    return np.unique(np.concatenate(found))


def decimal_step(values: Vector) -> float:
    """The power of ten to which all values were rounded: 1e-6 for 48.700001 and 48.7, at least 1e-9."""
    for decimals in range(9):
        if np.abs(values - np.round(values, decimals)).max(initial=0.0) < 1e-10:
            return float(10.0**-decimals)
    return 1e-9


def velocities(stamps_ns: Stamps, ned: Vector, *, steps_m: tuple[float, float]) -> Velocities:
    """Velocities at the horizontal fixes of positions [n, 3] at rising stamps, and between fixes that are seldom.

    Those beyond reason are left out. `steps_m` is what places and heights are rounded to.
    Across a step that nobody flew, as where two recordings are joined, the deviation is FASTEST_M_S.
    """
    times_s = (stamps_ns - stamps_ns[0]) / NS_PER_S
    across, up = fixes(times_s, ned[:, :2]), fixes(times_s, ned[:, 2:])
    told = filled(times_s, across)
    at_s = times_s[told]
    horizontal = line_slopes(times_s[across], ned[across, :2], at_s, steps_m[0])
    vertical = line_slopes(times_s[up], ned[up, 2:], at_s, steps_m[1])
    # Heights may come less often than positions: where a window holds too few, the flight is taken as level.
    down = np.where(np.isfinite(vertical.slopes), vertical.slopes, 0.0)
    velocity = np.concatenate([horizontal.slopes, down], axis=1)
    sigma = np.fmax(horizontal.sigma, vertical.sigma)
    sigma[torn(times_s[across], ned[across, :2], at_s, steps_m[0])] = FASTEST_M_S
    sound = np.isfinite(velocity).all(axis=1) & np.isfinite(sigma)
    sound[sound] = np.linalg.norm(velocity[sound], axis=1) < FASTEST_M_S
    return Velocities(stamps_ns[told][sound], velocity[sound], sigma[sound])


def torn(times_s: Vector, values: Vector, at_s: Vector, step_m: float) -> NDArray[np.bool_]:
    """Around which of `at_s` [n] a line's window holds a step between fixes [m, 2] that is faster than any drone.

    Rounding, to `step_m`, may move two fixes by a step each.
    """
    half_s = half_window_s(times_s, step_m)
    moved_m, took_s = np.linalg.norm(np.diff(values, axis=0), axis=1), np.diff(times_s)
    steps = np.flatnonzero(moved_m - 2 * step_m > FASTEST_M_S * took_s)
    found = np.zeros(len(at_s), dtype=np.bool_)
    for step in steps.tolist():
        found |= (at_s - half_s <= times_s[step]) & (times_s[step + 1] <= at_s + half_s)
    return found
