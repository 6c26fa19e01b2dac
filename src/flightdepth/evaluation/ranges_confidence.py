"""Whether confidence keeps its word: the chance that depth is right within RIGHT_WITHIN of the truth."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from flightdepth.evaluation.arrays import Maps
from flightdepth.ranges.fusion import RIGHT_WITHIN

Floats = NDArray[np.float64]

BINS = 10


class Reliability:
    """Counts pixels by what their confidence said and whether their depth was right."""

    def __init__(self) -> None:
        # Per tenth of confidence: pixels, sum of confidence, right ones.
        self.sums: Floats = np.zeros((BINS, 3))

    def add(self, depth_m: Maps, confidence: Maps, truth_m: Maps) -> None:
        """One frame's maps [h, w]; pixels without depth or truth do not count."""
        known = np.isfinite(depth_m) & np.isfinite(truth_m)
        said = confidence[known].astype(np.float64)
        right = np.abs(depth_m[known] - truth_m[known]) <= RIGHT_WITHIN * truth_m[known]
        tenth = np.minimum((said * BINS).astype(np.intp), BINS - 1)
        columns = (np.ones_like(said), said, right.astype(np.float64))
        self.sums += np.stack([np.bincount(tenth, column, BINS) for column in columns], axis=1)


def reliability(sums: Floats) -> dict[str, Any]:
    """From sums [BINS, 3]: a row per tenth {said, right, pixels}, None where empty; the calibration errors.

    expected_error  mean |said - right| over the tenths, weighed by pixels (ECE): 0 keeps its word
    signed_error    mean of said - right: above 0 confidence promises too much
    """
    pixels = sums[:, 0]
    known = pixels > 0
    said, right = (np.divide(sums[:, i], pixels, out=np.zeros(BINS), where=known) for i in (1, 2))
    share = pixels / max(float(pixels.sum()), 1.0)
    rows = [
        {"said": float(s), "right": float(r), "pixels": float(p)} if p else None
        for s, r, p in zip(said, right, pixels, strict=True)
    ]
    return {
        "tenths": rows,
        "expected_error": float((share * np.abs(said - right)).sum()) if known.any() else float("nan"),
        "signed_error": float((share * (said - right)).sum()) if known.any() else float("nan"),
    }
