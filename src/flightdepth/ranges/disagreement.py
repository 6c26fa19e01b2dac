"""Whether error bars hold in this flight: do ranges of one picture differ by more than their bars foretell?

A network's error bar holds for pictures like those that it was measured on. Compression, noise and whatever else a
camera does make errors larger than it thinks, and nobody tells how much of that a video has. But a frame is seen
through several ranges, whose errors are partly their own: where they differ by more than usual, all bars grow.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import combinations

import numpy as np

from flightdepth.ranges.fusion import LEAST_SIGMA, WORST_SIGMA, ends
from flightdepth.runtimes.prediction import Prediction
from flightdepth.weights.card import NetworkCard

# The median difference of two ranges over what their bars foretell, where the bars hold. Errors that are nobody's but
# their own would have .67; those of two ranges go together in part (`benchmarks/filmed_bars.py`).
USUAL = 0.45
MOST = 3.0  # times as wide: more would only hide what else is wrong
FEWEST = 100  # pixels that both ranges measured
MEMORY_S = 1.0  # what a video does to pictures changes slowly, what one frame tells of it scatters


class FlownBars:
    """The error bars of one flight, as wide as its ranges have shown that they must be."""

    def __init__(self) -> None:
        self._log_ratio: float | None = None  # of what ranges disagree by, over the usual, in the last second
        self._last_ns = 0

    @property
    def times(self) -> float:
        """How many times as wide bars are as the network and the motion make them, 1 to MOST."""
        return min(max(math.exp(self._log_ratio or 0.0), 1.0), MOST)

    def widened(self, stamp_ns: int, prediction: Prediction, card: NetworkCard) -> Prediction:
        """The frame's maps with the bars that it and those before ask for; as they are without error bars."""
        if prediction.sigma_m is None:
            return prediction
        self._learn(stamp_ns, disagreement(prediction, card))
        return replace(prediction, sigma_m=prediction.sigma_m * np.float32(self.times))

    def _learn(self, stamp_ns: int, found: float | None) -> None:
        if not found:
            return
        log_ratio = math.log(found / USUAL)
        if self._log_ratio is not None:
            kept = math.exp((self._last_ns - stamp_ns) / 1e9 / MEMORY_S)
            log_ratio += kept * (self._log_ratio - log_ratio)
        self._log_ratio, self._last_ns = log_ratio, stamp_ns


def disagreement(prediction: Prediction, card: NetworkCard) -> float | None:
    """By how much the n ranges of a frame differ, over what their error bars foretell.

    The median of |log(Z_i / Z_j)| / (s_i^2 + s_j^2)^0.5, with the bars s as shares of the depths, over all pixels that
    two ranges measured; None where these are few.
    """
    beta, depth_m, sigma_m = prediction.beta, prediction.depth_m, prediction.sigma_m
    if sigma_m is None:
        return None
    lower, upper = ends(card)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.maximum(sigma_m / depth_m, np.float32(LEAST_SIGMA))
        measured = prediction.valid & (lower < beta) & (beta < upper) & (share < WORST_SIGMA)
        log_m = np.log(depth_m)
    found = [np.empty(0, np.float32)]
    for one, other in combinations(range(len(beta)), 2):
        both = measured[one] & measured[other]
        apart = log_m[one][both] - log_m[other][both]
        found.append(np.abs(apart) / np.hypot(share[one][both], share[other][both]))
    every = np.concatenate(found)
    return float(np.median(every)) if len(every) >= FEWEST else None
