"""Local linear regression: the slope of positions at any time, by a straight line through a short window around it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flightdepth.motion import Vector

HALF_WINDOW_S = 0.5  # half of the window of a receiver with 6 fixes a second or more
HALF_WINDOW_PERIODS = 1.5  # slower ones: the fix before, this one, the one after
HALF_WINDOW_LIMIT_S = 5.0
ROUNDING_TARGET_M_S = 0.2  # the window grows until rounding costs less than this
STANDING_OUT = 10.0  # times the median variance: of windows of three fixes one in a thousand does by chance


@dataclass(frozen=True, eq=False)
class Slopes:
    """Slopes [n, k] of lines fitted around n instants, and their standard deviations [n]."""

    slopes: Vector
    sigma: Vector


def line_slopes(times_s: Vector, values: Vector, at_s: Vector, step_m: float) -> Slopes:
    """Slope [n, k] of the least-squares line through `values` [m, k] around each of `at_s` [n].

    Its standard deviation is that of the residuals of all windows together (or of rounding to `step_m`, if that
    is more), over the spread of the window's times; where a window stands out, as at a fix that is wrong, that of
    its own. NaN where a window holds fewer than two fixes.
    """
    half_s = half_window_s(times_s, step_m)
    slopes = np.full((len(at_s), values.shape[1]), np.nan)
    spread, residual, freedom = np.full(len(at_s), np.nan), np.zeros(len(at_s)), np.zeros(len(at_s))
    first = np.searchsorted(times_s, at_s - half_s - 1e-6)
    last = np.searchsorted(times_s, at_s + half_s + 1e-6)
    for index, (start, end) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
        if end - start < 2:
            continue
        t = times_s[start:end] - times_s[start:end].mean()
        x = values[start:end] - values[start:end].mean(axis=0)
        spread[index] = t @ t
        slopes[index] = t @ x / spread[index]
        residual[index] = ((x - np.outer(t, slopes[index])) ** 2).sum()
        freedom[index] = (end - start - 2) * values.shape[1]
    return Slopes(slopes, np.sqrt(_scatter(residual, freedom, step_m**2 / 12) / spread))


def half_window_s(times_s: Vector, step_m: float) -> float:
    """Half the window: by the fixes' period T and the step q to which the values are rounded.

    Over 2h seconds rounding (standard deviation q / 12^0.5) gives a slope's variance of 3 T q^2 / (24 h^3).
    """
    period_s = float(np.median(np.diff(times_s))) if len(times_s) > 1 else 1.0
    by_rounding_s = (3 * period_s * step_m**2 / 24 / ROUNDING_TARGET_M_S**2) ** (1 / 3)
    return float(min(max(HALF_WINDOW_S, HALF_WINDOW_PERIODS * period_s, by_rounding_s), HALF_WINDOW_LIMIT_S))


def _scatter(residual: Vector, freedom: Vector, least: float) -> Vector:
    """Variance of the values in each window, [n], from its sum of squares and degrees of freedom: that of all windows
    together, or of its own where that stands out. At least `least`.
    """
    own = residual / np.maximum(freedom, 1)
    median = np.median(own[freedom > 0]) if freedom.any() else 0.0
    apart = own > STANDING_OUT * max(median, least)
    usual = residual[~apart].sum() / max(freedom[~apart].sum(), 1)
    return np.where(apart, own, max(usual, least))
