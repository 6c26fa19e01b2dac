"""Where errors come from: whether any pair of a frame could have seen a pixel's true depth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flightdepth.evaluation.arrays import Maps
from flightdepth.weights.card import NetworkCard

Floats = NDArray[np.float64]

# A pixel's truth lies inside the range of a pair, nearer than every pair's, or else beyond.
PLACES = ("inside", "nearer", "beyond")


class Coverage:
    """Sums relative errors by where the truth lay among the ranges of the frame's pairs.

    A pair flown D* apart can answer from beta_min alpha D* to alpha D* (paper, equation 5): a network's output cannot
    say more, however good it is.
    """

    def __init__(self, card: NetworkCard) -> None:
        self._card = card
        # Pixels with a truth, with a depth, sum of |error| / truth.
        self.sums: Floats = np.zeros((len(PLACES), 3))

    def add(self, depth_m: Maps, truth_m: Maps, displacements_m: Floats) -> None:
        """One frame's maps [h, w] and the displacements really flown, [n]."""
        known = np.isfinite(truth_m) & (truth_m > 0)
        truth, depth = truth_m[known].astype(np.float64), depth_m[known].astype(np.float64)
        most_m = self._card.alpha * displacements_m[:, None]
        least_m = self._card.beta_min * most_m
        inside = ((truth >= least_m) & (truth <= most_m)).any(axis=0)
        nearer = ~inside & (truth < least_m.min())
        error = np.nan_to_num(np.abs(depth - truth) / truth, nan=0.0)
        places = inside, nearer, ~inside & ~nearer
        self.sums += [[at.sum(), np.isfinite(depth[at]).sum(), error[at].sum()] for at in places]


def coverage(several: Sequence[Floats]) -> dict[str, Any]:
    """From sums [3, 3] of sequences, means over them: by place its `share` of the pixels, its `part` of the mean
    relative error (the parts add up to it) and its own `abs_rel`, None where no pixel lay there.
    """
    sums = np.stack(several)
    pixels = sums[:, :, 0] / np.maximum(sums[:, :, 0].sum(axis=1, keepdims=True), 1)
    parts = sums[:, :, 2] / np.maximum(sums[:, :, 1].sum(axis=1, keepdims=True), 1)
    known, error = sums[:, :, 1].sum(axis=0), sums[:, :, 2].sum(axis=0)
    return {
        place: {
            "share": float(pixels[:, k].mean()),
            "part": float(parts[:, k].mean()),
            "abs_rel": float(error[k] / known[k]) if known[k] else None,
        }
        for k, place in enumerate(PLACES)
    }
