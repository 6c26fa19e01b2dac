"""What the study measures beside errors: whether confidence keeps its word, where errors come from, flicker."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.motion import Vector
from flightdepth.ranges.fusion import RIGHT_WITHIN
from flightdepth.runtimes.arrays import Maps
from flightdepth.weights.card import NetworkCard

Floats = NDArray[np.float64]

BINS = 10  # of confidence
# A pixel's truth lies inside the range of a pair, nearer than every pair's, or else beyond.
PLACES = ("inside", "nearer", "beyond")


class Reliability:
    """Counts pixels by their confidence, the chance that depth is right within RIGHT_WITHIN, and whether it was."""

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


def moved(depth_m: Maps, displacement: Vector, camera: Camera) -> Maps:
    """A depth map [h, w] as the next frame sees it, `displacement` (3,) metres later; NaN where nothing falls.

    Each pixel's point goes to the nearest pixel of the next map, of several the nearest point.
    """
    h, w = depth_m.shape
    view = camera.resized(w, h)
    points = view.rays()[np.isfinite(depth_m)] * depth_m[np.isfinite(depth_m), None] - displacement
    points = points[points[:, 2] > 0]
    x = np.rint(view.fx * points[:, 0] / points[:, 2] + view.cx)
    y = np.rint(view.fy * points[:, 1] / points[:, 2] + view.cy)
    inside = (x >= 0) & (x < w) & (y >= 0) & (y < h)
    there = np.full((h, w), np.inf, np.float32)
    place = y[inside].astype(np.intp), x[inside].astype(np.intp)
    np.minimum.at(there, place, points[inside, 2].astype(np.float32))
    there[np.isinf(there)] = np.nan
    return there


def flicker(before_m: Maps, now_m: Maps, displacement: Vector, camera: Camera) -> float:
    """Median |depth(t) moved by the motion - depth(t + 1)| / depth(t + 1); NaN where no pixel has both."""
    change = np.abs(moved(before_m, displacement, camera) - now_m) / now_m
    known = change[np.isfinite(change)]
    return float(np.median(known)) if known.size else float("nan")
