"""How a DJI flight record says that the drone flew: by its x, y and z speed, else by its positions.

DJI counts x to the north, y to the east and z down (its SDK's FlightControllerState), whatever AirData's manual says
of x. In real logs of a Mini 2 (Flight Reader) and of a drone of two cells (AirData) x follows the latitude and y the
longitude; in these and a Phantom 4's (TXTlogToCSVtool) z is down. Logs of other makers pass through the same
programs, so the positions overrule that: axes and sign are those that agree with them, and speeds that agree in no
way are left for the positions' slopes.

The speeds are rounded to 0.1 m/s and were up to 0.15 s late in those logs. Their standard deviation is that of
their rounding, or what they differ from the slopes by beyond the slopes' own error, whichever is more.
"""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flightdepth.flight.dji_columns import FlightTable
from flightdepth.flight.positions import Velocities, on_earth, velocities_by_places
from flightdepth.flight.records import FASTEST_M_S, NS_PER_S
from flightdepth.motion import Stamps, Vector

Mask = NDArray[np.bool_]

MOVING_M_S = 1.0  # slower flight tells nothing of the axes,
CLIMBING_M_S = 0.5  # nor a slower climb of the sign
TELLING = 20  # instants that must tell of them
CLEARLY = 0.5  # of the error of DJI's own axes: others must do so well to be believed
LEAST_DENIED_M_S = 1.0  # speeds that differ by less from the positions are not denied,
DENIED_SHARE = 0.5  # nor by less than this of the speed
STUCK_NS = 2 * NS_PER_S  # the same place and speed for longer, while moving: rows repeat
STUCK_M_S = 0.5  # those of a hovering drone may


class Flown(NamedTuple):
    """Velocities, and a word on where they come from."""

    velocities: Velocities
    source: str


def flown(table: FlightTable, counts: Counter[str]) -> Flown:
    """Velocities of the rows that tell one; the others are counted."""
    fixed = on_earth(table.places_deg)
    slopes = _slopes(table, fixed, counts)
    known = np.isfinite(table.speeds).all(axis=1)
    told = None
    if known.any():
        stamps_ns, speeds = table.stamps_ns[known], table.speeds[known]
        told = _by_speeds(stamps_ns, speeds, slopes)
    if told is None:
        return Flown(slopes, "from positions")
    counts["rows without a speed"] += int((~known).sum())
    fast: Mask = np.asarray(np.linalg.norm(told.velocities.velocity_ned, axis=1) > FASTEST_M_S)
    counts[f"velocities above {FASTEST_M_S:.0f} m/s"] += int(fast.sum())
    places_deg = np.where(fixed[:, None], table.places_deg, np.nan)[known]
    stuck = ~fast & _stuck(stamps_ns, np.c_[places_deg, speeds])
    counts["rows that repeat while moving"] += int(stuck.sum())
    return Flown(told.velocities.where(~(fast | stuck)), told.source)


def _slopes(table: FlightTable, fixed: Mask, counts: Counter[str]) -> Velocities:
    """Velocities from the positions that are fixed [n]."""
    counts["rows without a position"] += int((~fixed).sum())
    heights_m = _filled(table.heights_m[fixed])
    return velocities_by_places(table.stamps_ns[fixed], table.places_deg[fixed], heights_m, counts)


def _filled(heights_m: Vector) -> Vector:
    """Heights [n] with their gaps filled; level flight where most are unknown."""
    known = np.isfinite(heights_m)
    if 2 * np.count_nonzero(known) <= len(heights_m):
        return np.zeros(len(heights_m))
    return np.asarray(np.interp(np.arange(len(heights_m)), np.flatnonzero(known), heights_m[known]))


def _by_speeds(stamps_ns: Stamps, speeds: Vector, slopes: Velocities) -> Flown | None:
    """The speeds [n, 3] as velocity north, east, down; None where the positions deny them."""
    rounding = _rounding(speeds)
    if not len(slopes):
        return Flown(Velocities(stamps_ns, speeds, np.full(len(stamps_ns), rounding)), "from its speeds")
    at = np.stack([np.interp(slopes.stamps_ns, stamps_ns, column) for column in speeds.T], axis=1)
    moving = np.linalg.norm(slopes.velocity_ned, axis=1) > MOVING_M_S
    turn, source = np.eye(3), "from its speeds"
    if np.count_nonzero(moving) >= TELLING:
        turn, source = _axes(at[moving], slopes.velocity_ned[moving])
        apart = np.linalg.norm((at @ turn - slopes.velocity_ned)[moving], axis=1)
        flown_m_s = np.median(np.linalg.norm(slopes.velocity_ned[moving], axis=1))
        if np.median(apart) > max(LEAST_DENIED_M_S, DENIED_SHARE * float(flown_m_s)):
            return None
    else:
        moving[:] = True
    # Two thirds of a normal error's sizes are below one standard deviation.
    error = np.quantile(np.abs(at @ turn - slopes.velocity_ned)[moving], 0.683)
    beyond = np.sqrt(max(error**2 - float(np.median(slopes.sigma[moving])) ** 2, 0.0))
    sigma = np.full(len(stamps_ns), max(rounding, float(beyond)))
    return Flown(Velocities(stamps_ns, speeds @ turn, sigma), source)


def _axes(speeds: Vector, slopes: Vector) -> tuple[Vector, str]:
    """What turns speeds [m, 3] into north, east, down [3, 3], by the slopes [m, 3], and a word on it."""
    turn, source = np.eye(3), "from its speeds"
    swapped = np.eye(3)[[1, 0, 2]]
    straight_m_s, swapped_m_s = (
        float(np.median(np.linalg.norm((speeds @ each - slopes)[:, :2], axis=1))) for each in (turn, swapped)
    )
    if straight_m_s > LEAST_DENIED_M_S and swapped_m_s < CLEARLY * straight_m_s:
        turn, source = swapped, f"{source} (x is east)"
    climbing = np.abs(slopes[:, 2]) > CLIMBING_M_S
    if np.count_nonzero(climbing) >= TELLING:
        down, told = slopes[climbing, 2], speeds[climbing, 2]
        if np.median(np.abs(told + down)) < CLEARLY * min(np.median(np.abs(told - down)), CLIMBING_M_S * 2):
            turn, source = turn @ np.diag([1.0, 1.0, -1.0]), f"{source} (z is up)"
    return turn, source


def _rounding(speeds: Vector) -> float:
    """Standard deviation of what speeds [n, 3] were rounded to: the least step between two of them over 12^0.5."""
    steps = np.diff(np.unique(np.round(speeds, 4)))
    return float(steps.min(initial=1.0) / np.sqrt(12)) if len(steps) else 0.0


def _stuck(stamps_ns: Stamps, rows: Vector) -> Mask:
    """Rows [n, k], whose last three are speeds, that have been the same for more than STUCK_NS while moving.

    A NaN is never the same: without a place nobody knows whether the rest repeats.
    """
    same = np.r_[False, (rows[1:] == rows[:-1]).all(axis=1)]
    since_ns = stamps_ns[np.maximum.accumulate(np.where(same, 0, np.arange(len(rows))))]
    moving = np.linalg.norm(rows[:, -3:], axis=1) > STUCK_M_S
    return np.asarray(moving & (stamps_ns - since_ns > STUCK_NS))
