"""How sure a mean or a median is: 95 % intervals by drawing again (Efron 1979), seeded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

DRAWS = 2000
AT_ONCE = 4_000_000  # values drawn: all draws of a long flight's tracks would fill the memory


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
    rng, rows = np.random.default_rng(0), max(1, AT_ONCE // values.size)
    counts = [min(rows, DRAWS - first) for first in range(0, DRAWS, rows)]
    drawn = np.concatenate([statistic(rng.choice(values, (count, values.size)), axis=1) for count in counts])
    low, high = np.percentile(drawn, [2.5, 97.5])
    return float(statistic(values)), float(low), float(high)
