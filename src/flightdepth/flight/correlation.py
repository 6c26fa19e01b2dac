"""How well what a log says fits what a video shows, at each offset between them: normalised cross-correlation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flightdepth.flight.signals import STEP_S, Signal
from flightdepth.motion import Vector

LEAST_OVERLAP_S = 6.0
OVERLAP_SHARE = 0.5  # of the shorter signal


@dataclass(frozen=True, eq=False)
class Curve:
    """Correlation at each offset STEP_S * lags; NaN where the two overlap too little. samples: of the overlap."""

    lags: NDArray[np.int64]
    values: Vector
    samples: NDArray[np.int64]


def correlations(video: tuple[int, Vector], told: Signal, within_s: float | None) -> Curve:
    """The log moved over the video: each part of it alone, so that it costs what it tells and not what it spans."""
    seen = video[1]
    start, end = told.steps
    least = round(max(LEAST_OVERLAP_S / STEP_S, OVERLAP_SHARE * min(len(seen), end - start)))
    parts = told.parts(len(seen) * STEP_S)  # no offset lays the video over two of them
    curves = [
        _moved(video, part, least, within_s)
        for part in reversed(parts)  # lags rise
        if part.told_s >= LEAST_OVERLAP_S - STEP_S
    ]
    return _joined([curve for curve in curves if len(curve.lags)])


def _joined(curves: list[Curve]) -> Curve:
    """One after the other, with an unknown value between two."""
    lags, values, samples = [np.empty(0, np.int64)], [np.empty(0)], [np.empty(0, np.int64)]
    for number, curve in enumerate(curves):
        if number > 0:
            lags.append(curve.lags[:1] - 1)
            values.append(np.array([np.nan]))
            samples.append(np.zeros(1, np.int64))
        lags.append(curve.lags)
        values.append(curve.values)
        samples.append(curve.samples)
    return Curve(np.concatenate(lags), np.concatenate(values), np.concatenate(samples))


def _moved(video: tuple[int, Vector], told: Signal, least: int, within_s: float | None) -> Curve:
    """A part of the log moved over the video, by whole steps, as far as `least` of them are in common."""
    first, seen = video
    start, log = told.on_grid()
    end = start + len(log)
    lags = np.arange(first - end + least, first + len(seen) - start - least + 1)
    lags = lags if within_s is None else lags[np.abs(lags) * STEP_S <= within_s]
    values, samples = np.full(len(lags), np.nan), np.zeros(len(lags), dtype=np.int64)
    whole = size_of(seen[np.isfinite(seen).all(axis=1)])
    for k, lag in enumerate(lags.tolist()):
        low, high = max(first, start + lag), min(first + len(seen), end + lag)
        a, b = seen[low - first : high - first], log[low - lag - start : high - lag - start]
        both = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
        if np.count_nonzero(both) >= least:
            # A fit with a small part of what the video shows says less than one with all of it.
            share = min(size_of(a[both]) / whole, 1.0)
            values[k], samples[k] = (
                share * _correlation(a[both], b[both], axes=told.axes),
                np.count_nonzero(both),
            )
    return Curve(lags, values, samples)


def _correlation(a: Vector, b: Vector, *, axes: bool) -> float:
    """Of [n, c] values, means taken off. Between unknown axes the best rotation is meant: the nuclear norm."""
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    size = np.linalg.norm(a) * np.linalg.norm(b)
    if size < 1e-12:
        return 0.0
    product = a.T @ b
    return float((np.trace(product) if axes else np.linalg.norm(product, "nuc")) / size)


def size_of(values: Vector) -> float:
    """Length of a signal [n, c] without its mean."""
    return float(np.linalg.norm(values - values.mean(axis=0)))
