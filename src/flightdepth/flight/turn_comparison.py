"""Turns seen in pictures beside those that a log tells: their ratio, how sure it is, and whether they are the same.

Flying past things looks like turning, but changes slowly: what is constant or rises evenly within a turn is taken
off both. Electronic stabilisation, or a gimbal between the camera and what the log tells of, leaves pictures that
turn more smoothly than the log does; a second term, of the log's second differences, finds that out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flightdepth.flight.signals import Signal
from flightdepth.motion import Vector

LEAST_RATE_RAD_S = math.radians(3.0)  # slower turns drown in what flying does
APART_S = 0.5  # between two turns
LONGEST_S = 4.0  # of one turn; longer ones are several
FEWEST_PAIRS = 12  # of a turn
PART_S = 0.5  # of a turn; parts err each for themselves
FEWEST_PARTS = 3
SELDOM_S = 0.25  # between what the log tells: turns in between are not known
LAGS_S = np.linspace(-0.15, 0.15, 31)  # of the log's clock
BEND_S = 0.15  # step of the second differences
LEAST_SHARE = 0.02  # of the ratio: no better is claimed


@dataclass(frozen=True)
class Comparison:
    """Turns seen over turns told.

    ratio        of the two; turning about the axis of view, which all lenses show alike, does not count
    share        standard deviation of the ratio, as a share of it
    smoother     share by which the ratio changes where the pictures may turn more smoothly than the log tells
    drift        share by which it changes from the first turn to the last
    correlation  of the two, -1..1
    lag_s        of the log behind the pictures, where the two fit best
    turned_deg   by how much the log says that the camera turned
    """

    ratio: float = 1.0
    share: float = math.inf
    smoother: float = math.inf
    drift: float = math.inf
    correlation: float = 0.0
    lag_s: float = 0.0
    turned_deg: float = 0.0

    @property
    def at_the_end(self) -> bool:
        """Whether a lag beyond those that were tried would fit better."""
        return abs(self.lag_s) > float(LAGS_S[-2])


class ToldTurns:
    """How a log tells the turns between pairs of pictures, whose times are seconds [k, 2], rising."""

    def __init__(self, spans_s: Vector, told: Signal) -> None:
        self._spans_s, self._axes, self._angles = spans_s, told.axes, _Angles.of(told)
        self._turns = list(_turns(spans_s))
        self._apart_s = max(float(np.median(np.diff(spans_s[:, 1]))), 1e-3)

    def compared(self, seen: Vector) -> Comparison:
        """With the rotation vectors seen in the pairs, rad [k, 3], at the lag that fits best."""
        rates = seen / np.diff(self._spans_s, axis=1)
        tries = (self._matched(rates, float(lag_s)) for lag_s in LAGS_S)
        return max(tries, key=lambda each: each.correlation).judged()

    def _matched(self, seen: Vector, lag_s: float) -> _Matched:
        """Rates seen, rad/s [k, 3], beside those told `lag_s` later."""
        spans_s = self._spans_s + lag_s
        known = self._angles.known(spans_s)
        turns = [turn[known[turn]] for turn in self._turns]
        turns = [turn for turn in turns if len(turn) >= FEWEST_PAIRS]
        evens = [self._even(turn) for turn in turns]
        before, told, after = (self._angles.rates(spans_s + step_s) for step_s in (-BEND_S, 0.0, BEND_S))
        seen, uneven, bent = (
            _uneven(values, turns, evens) for values in (seen, told, before - 2 * told + after)
        )
        used = np.concatenate([np.empty(0, np.int64), *turns])
        speeds = np.linalg.norm(told[used], axis=1)
        turned_rad = float(speeds[speeds > LEAST_RATE_RAD_S].sum()) * self._apart_s
        whole_s = max(float(self._spans_s[-1, 1] - self._spans_s[0, 1]), 1.0)
        at = (self._spans_s[used, 1] - self._spans_s[0, 1]) / whole_s
        matched = _Matched(seen, uneven, bent, at, self._parts(turns), lag_s, turned_rad)
        return matched if self._axes else matched.in_axes_of_the_camera()

    def _even(self, turn: NDArray[np.int64]) -> Vector:
        """What changes evenly in the k pairs of a turn: two orthonormal columns [k, 2]."""
        at_s = self._spans_s[turn].mean(axis=1)
        return np.asarray(np.linalg.qr(np.stack([np.ones_like(at_s), at_s - at_s.mean()], axis=1))[0])

    def _parts(self, turns: list[NDArray[np.int64]]) -> NDArray[np.int64]:
        """Number of the part of a turn that each of their pairs belongs to."""
        parts, first = [np.empty(0, np.int64)], 0
        for turn in turns:
            at_s = self._spans_s[turn, 1]
            parts.append(first + ((at_s - at_s[0]) / PART_S).astype(np.int64))
            first = int(parts[-1][-1]) + 1
        return np.concatenate(parts)


@dataclass(frozen=True, eq=False)
class _Matched:
    """Rates seen and told, and the told ones' second differences, rad/s [m, 3], without what changes evenly.

    at          their time: 0 for the first pair of all, 1 for the last one, [m]
    parts       numbers of the parts of turns that they belong to [m]
    turned_rad  by how much the log says that the camera turned meanwhile
    """

    seen: Vector
    told: Vector
    bent: Vector
    at: Vector
    parts: NDArray[np.int64]
    lag_s: float
    turned_rad: float

    def in_axes_of_the_camera(self) -> _Matched:
        """With what is told turned by the best rotation between unknown axes."""
        u, _, v = np.linalg.svd(self.seen.T @ self.told)
        turn = (u @ v).T
        return replace(self, told=self.told @ turn, bent=self.bent @ turn)

    @cached_property
    def correlation(self) -> float:
        """Of seen and told, all three axes."""
        size = float(np.linalg.norm(self.seen) * np.linalg.norm(self.told))
        return float((self.seen * self.told).sum()) / size if size > 1e-9 else 0.0

    def judged(self) -> Comparison:
        """The ratio about the picture's two axes."""
        seen, told, bent = self.seen[:, :2], self.told[:, :2], self.bent[:, :2]
        products, squares = (
            np.bincount(self.parts, (each * told).sum(axis=1)).astype(np.float64) for each in (seen, told)
        )
        turned_deg = math.degrees(self.turned_rad)
        if len(squares) < FEWEST_PARTS or (squares.sum() - squares).min() < 1e-12 or products.sum() <= 0:
            return Comparison(correlation=self.correlation, lag_s=self.lag_s, turned_deg=turned_deg)
        ratio = float(products.sum() / squares.sum())
        return Comparison(
            ratio,
            math.hypot(_share(products, squares), LEAST_SHARE),
            abs(_fit(seen, told, bent)[0] / ratio - 1),
            abs(_fit(seen, told, told * self.at[:, None])[1] / ratio),
            self.correlation,
            self.lag_s,
            turned_deg,
        )


def _uneven(rates: Vector, turns: list[NDArray[np.int64]], evens: list[Vector]) -> Vector:
    """Rates [m, 3] of the pairs of all turns, without what changes evenly in each."""
    left = (rates[turn] - even @ (even.T @ rates[turn]) for turn, even in zip(turns, evens, strict=True))
    return np.concatenate([np.empty((0, 3)), *left])


def _fit(seen: Vector, *terms: Vector) -> Vector:
    """Coefficients of terms [m, 2] that make up what is seen [m, 2] best."""
    return np.asarray(np.linalg.lstsq(np.stack([term.ravel() for term in terms], axis=1), seen.ravel())[0])


def _share(products: Vector, squares: Vector) -> float:
    """Standard deviation of sum(products) / sum(squares) as a share of it, from leaving out one part each [p]."""
    ratios = (products.sum() - products) / (squares.sum() - squares)
    deviation = math.sqrt((len(ratios) - 1) * float(ratios.var()))
    return deviation * float(squares.sum() / products.sum())


@dataclass(frozen=True, eq=False)
class _Angles:
    """Angles turned, rad [n, 3], up to rising times, seconds [n], and the rates there; a cubic between two of them.

    `told_s` are the times at which the log tells a rate.
    """

    at_s: Vector
    angles: Vector
    rates_rad_s: Vector
    told_s: Vector

    @classmethod
    def of(cls, told: Signal) -> _Angles:
        """Of turn rates, each of which is the mean over the time that is nearest to it."""
        rising = told.at_s > np.concatenate([[-np.inf], np.maximum.accumulate(told.at_s)[:-1]])
        told_s, rates = told.at_s[rising], told.values[rising]
        at_s = np.concatenate([told_s[:1], (told_s[1:] + told_s[:-1]) / 2, told_s[-1:]])
        steps = rates * np.diff(at_s)[:, None]
        angles = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
        return cls(at_s, angles, np.gradient(angles, at_s, axis=0), told_s)

    def known(self, spans_s: Vector) -> NDArray[np.bool_]:
        """Whether the log tells spans [k, 2], and BEND_S before and after, often enough."""
        first = np.searchsorted(self.told_s, spans_s[:, 0] - BEND_S, "right") - 1
        last = np.searchsorted(self.told_s, spans_s[:, 1] + BEND_S)
        inside = (first >= 0) & (last < len(self.told_s))
        seldom = np.concatenate([[0], np.cumsum(np.diff(self.told_s) > SELDOM_S)])
        often = seldom[last.clip(0, len(seldom) - 1)] == seldom[first.clip(0)]
        return np.asarray(inside & often)

    def rates(self, spans_s: Vector) -> Vector:
        """Mean turn rates, rad/s [k, 3], over spans [k, 2]."""
        return (self._at(spans_s[:, 1]) - self._at(spans_s[:, 0])) / np.diff(spans_s, axis=1)

    def _at(self, at_s: Vector) -> Vector:
        """Angles [k, 3] by Hermite's cubic."""
        after = np.searchsorted(self.at_s, at_s).clip(1, len(self.at_s) - 1)
        step_s = (self.at_s[after] - self.at_s[after - 1])[:, None]
        part = ((at_s - self.at_s[after - 1])[:, None] / step_s).clip(0, 1)
        start, end = (self.rates_rad_s[k] * step_s for k in (after - 1, after))
        way = self.angles[after] - self.angles[after - 1]
        bow = part * (1 - part) * ((1 - part) * start - part * end)
        return np.asarray(self.angles[after - 1] + way * part**2 * (3 - 2 * part) + bow)


def _turns(spans_s: Vector) -> Iterator[NDArray[np.int64]]:
    """Numbers of the pairs of each turn."""
    starts_s, first = spans_s[:, 0], 0
    for number in range(1, len(starts_s) + 1):
        ended = number == len(starts_s) or starts_s[number] - starts_s[number - 1] > APART_S
        if ended or starts_s[number] - starts_s[first] > LONGEST_S:
            yield np.arange(first, number)
            first = number
