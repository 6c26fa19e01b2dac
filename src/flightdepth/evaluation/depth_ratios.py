"""How depth over truth is spread over a whole flight, as a histogram: a scale moves its median, scatter widens it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

STEP = 5e-4  # of the logarithm: ratios are told to a twentieth of a per cent
MOST = 1e6  # beyond, and below its inverse, they count as that
BINS = 2 * int(np.log(MOST) / STEP)

Values = NDArray[np.float64]


class Ratios:
    """Counts ratios of depth to truth, so that no flight has to be kept in memory."""

    def __init__(self) -> None:
        self._counts = np.zeros(BINS, np.int64)

    @property
    def count(self) -> int:
        """How many there are."""
        return int(self._counts.sum())

    def add(self, ratios: Values) -> None:
        """Count ratios above 0, [N]."""
        places = np.log(ratios) / STEP + BINS / 2
        self._counts += np.bincount(places.clip(0, BINS - 1).astype(np.intp), minlength=BINS)

    def quantile(self, share: float) -> float:
        """The ratio that this share of them, 0..1, lies below; NaN without any."""
        below = np.concatenate([[0], np.cumsum(self._counts)])
        if not below[-1]:
            return float("nan")
        wanted = share * below[-1]
        place = int(np.searchsorted(below, wanted, side="right")) - 1
        place = min(place, int(np.flatnonzero(self._counts)[-1]))
        within = (wanted - below[place]) / max(1, self._counts[place])
        return float(np.exp((place + within - BINS / 2) * STEP))

    def abs_rel(self, scale: float = 1.0) -> float:
        """Mean |depth / scale - truth| / truth; NaN without any."""
        middles = np.exp((np.arange(BINS) + 0.5 - BINS / 2) * STEP)
        total = float(self._counts @ np.abs(middles / scale - 1))
        return total / self.count if self.count else float("nan")
