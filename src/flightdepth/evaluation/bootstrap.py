"""How sure a mean or a median is: 95 % intervals by drawing again (Efron 1979), seeded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

DRAWS = 2000


def interval(values: Sequence[float]) -> dict[str, float | int]:
    """Mean of the finite values, one a frame, with its 95 % bootstrap interval over frames; NaN of none.

    Frames that follow each other look alike, so the interval is somewhat too narrow.
    """
    known = np.array([value for value in values if np.isfinite(value)])
    mean, low, high = with_ends(known, np.mean)
    return {"mean": mean, "low": low, "high": high, "frames": int(known.size)}


def with_ends(values: NDArray[np.float64], statistic: Callable[..., Any]) -> tuple[float, float, float]:
    """A statistic of values [N], and the ends of its 95 % bootstrap interval; NaN of none."""
    if not values.size:
        return float("nan"), float("nan"), float("nan")
    drawn = statistic(np.random.default_rng(0).choice(values, (DRAWS, values.size)), axis=1)
    low, high = np.percentile(drawn, [2.5, 97.5])
    return float(statistic(values)), float(low), float(high)
