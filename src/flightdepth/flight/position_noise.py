"""Positions that jitter, drawn to a parabola around each.

Pairs of pictures are centimetres apart where things are near: two positions that each err by one make a displacement
of 6 cm wrong by a fourth, and so all depth. Over some tenths of a second a drone flies along a parabola, to within
less. How much positions jitter, and over which time a parabola fits best, they tell themselves: by how well those
around foretell each.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from flightdepth.motion import Vector

HALF_WINDOWS_S = (0.1, 0.2, 0.4)
FEWEST = 5  # positions in a window, for a parabola that is more than the positions themselves
MOST = 1000  # a thousand a second fill the widest window with 800; more come of damaged times
ASKED = 500  # positions that choose the window
WORTH_IT = 0.75  # of the jitter's variance: a parabola that errs by more is not taken
# A step that stands out is a jump (a loop closure): nothing is drawn across it.
JUMP_M, JUMP_OVER_NOISE = 0.1, 10.0
ROWS_AT_ONCE = 2000

Indices = NDArray[np.intp]


def smoothed(times_s: Vector, ned: Vector) -> Vector:
    """Positions [n, 3], metres, at rising times [n]; themselves where they hardly jitter, come seldom or too often."""
    noise_m = jitter_m(times_s, ned)
    if not noise_m or (times_s[MOST:] - times_s[:-MOST] < 2 * HALF_WINDOWS_S[-1]).any():
        return ned
    parts = np.split(np.arange(len(ned)), jumps(times_s, ned, noise_m) + 1)
    half_s = _best_window(times_s, ned, parts, noise_m)
    if half_s is None:
        return ned
    found = ned.copy()
    for part in parts:
        for rows in _some(np.arange(len(part))):
            drawn, _, count = parabolas(times_s[part], ned[part], rows, half_s)
            enough = count >= FEWEST
            found[part[rows[enough]]] = drawn[enough]
    return found


def jitter_m(times_s: Vector, ned: Vector) -> float:
    """Standard deviation of each of positions [n, 3] along an axis, by the cubic through the two on either side.

    0 where there are fewer than five. The median of all, so that jumps do not count.
    """
    if len(ned) < FEWEST:
        return 0.0
    others = np.stack([times_s[:-4], times_s[1:-3], times_s[3:-1], times_s[4:]])  # (4, m)
    share = np.ones_like(others)  # Lagrange's, of each of the four
    for one in range(4):
        for other in range(4):
            if other != one:
                share[one] *= (times_s[2:-2] - others[other]) / (others[one] - others[other])
    around = np.stack([ned[:-4], ned[1:-3], ned[3:-1], ned[4:]])
    off_m = ned[2:-2] - np.einsum("km,kmd->md", share, around)
    return float(1.4826 * np.median(np.abs(off_m) / np.sqrt(1 + (share**2).sum(axis=0))[:, None]))


def jumps(times_s: Vector, ned: Vector, noise_m: float) -> Indices:
    """Places of positions [n, 3] before a step that differs from those beside it by more than drones fly."""
    speeds = np.diff(ned, axis=0) / np.diff(times_s)[:, None]
    beside = np.stack([speeds[np.r_[0, : len(speeds) - 1]], speeds[np.r_[1 : len(speeds), -1]]])
    apart_m = np.linalg.norm(beside - speeds, axis=2).min(axis=0) * np.diff(times_s)
    return np.flatnonzero(apart_m > max(JUMP_M, JUMP_OVER_NOISE * noise_m))


def parabolas(
    times_s: Vector, ned: Vector, rows: Indices, half_s: float
) -> tuple[Vector, Vector, NDArray[np.intp]]:
    """At `rows` [m] of the positions [n, 3]: where the parabola through those within `half_s` passes, [m, 3].

    And its leverage [m], the share that the position itself has in that (Hastie, Tibshirani and Friedman, The Elements
    of Statistical Learning, 7.10), and how many there were [m]; NaN where they are fewer than three.
    """
    first = np.searchsorted(times_s, times_s[rows] - half_s - 1e-9)
    count = np.searchsorted(times_s, times_s[rows] + half_s + 1e-9) - first
    index = first[:, None] + np.arange(count.max(initial=0))
    held = index < (first + count)[:, None]
    index = np.minimum(index, len(ned) - 1)
    apart = np.where(held, (times_s[index] - times_s[rows][:, None]) / half_s, 0.0)
    powers = np.stack([held, apart, apart**2], axis=2).astype(np.float64)  # (m, k, 3)
    normal = np.einsum("mka,mkb->mab", powers, powers)
    normal[count < 3] = np.nan
    # At the position itself the parabola is its first coefficient.
    own = np.linalg.solve(normal, np.broadcast_to([[1.0], [0.0], [0.0]], (len(rows), 3, 1)))[..., 0]
    share = np.einsum("mka,ma->mk", powers, own)
    return np.einsum("mk,mkd->md", share, ned[index]), own[:, 0], count


def _best_window(times_s: Vector, ned: Vector, parts: list[Indices], noise_m: float) -> float | None:
    """The half window whose parabolas err least; None where none is worth it.

    What a parabola without the position itself is off by is that one's jitter and what jitter moves the parabola by,
    together jitter / (1 - h)^0.5 with the leverage h, and how far the flight is from a parabola.
    """
    best, least = None, WORTH_IT * noise_m**2
    for half_s in HALF_WINDOWS_S:
        off: list[Vector] = []
        leverages: list[Vector] = []
        for part in parts:
            rows = np.unique(np.linspace(0, len(part) - 1, ASKED).astype(np.intp))
            drawn, leverage, count = parabolas(times_s[part], ned[part], rows, half_s)
            told = (count >= FEWEST) & (leverage < 1)
            off.append((ned[part][rows] - drawn)[told] / (1 - leverage[told])[:, None])
            leverages.append(leverage[told])
        own = np.concatenate(leverages)
        if len(own) * 2 <= min(len(ned), ASKED):
            continue
        by_flight = np.mean(np.concatenate(off) ** 2) - noise_m**2 * np.mean(1 / (1 - own))
        variance = float(own.mean() * noise_m**2 + max(by_flight, 0.0))
        if variance < least:
            best, least = half_s, variance
    return best


def _some(rows: Indices) -> Iterator[Indices]:
    for start in range(0, len(rows), ROWS_AT_ONCE):
        yield rows[start : start + ROWS_AT_ONCE]
