"""Errors of depth maps: of some pixels, per picture, and summed up over a test set as the paper's table has them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flightdepth.runtimes.arrays import Flags, Maps

DEPTH_EDGES_M = (0.0, 5.0, 10.0, 20.0, 40.0, 60.0, 100.0)
ANGLE_EDGES_DEG = (0.0, 30.0, 60.0, 90.0, 120.0, 150.0, 180.0)
PERCENTILES = (5, 25, 50, 75, 95)


def pooled(map_hw: Maps, shape: tuple[int, int]) -> Maps:
    """Means over equal blocks, [H, W] to `shape`, as the paper scales its truth; NaN spreads."""
    h, w = shape
    height, width = map_hw.shape
    if height % h or width % w:
        raise ValueError(f"expected {height}x{width} to be a whole multiple of {h}x{w}")
    blocks = map_hw.astype(np.float64).reshape(h, height // h, w, width // w)
    return np.asarray(blocks.mean(axis=(1, 3)), dtype=np.float32)


def travel_angle_deg(displacement: ArrayLike) -> float:
    """Angle between the displacement (3,) and the optical axis: 0 forward, 90 sideways, 180 backward."""
    x, y, z = np.asarray(displacement, dtype=np.float64)
    return float(np.degrees(np.arctan2(np.hypot(x, y), z)))


@dataclass(frozen=True)
class DepthErrors:
    """Errors of depth over some pixels with a known truth; NaN where there is no depth.

    pixels   with a truth
    known    share of them with a depth; the errors below are over these
    l1_m     mean |depth - truth|
    rmse_m   root of the mean of its square
    abs_rel  mean |depth - truth| / truth, where the truth is above 0
    delta    share with max(depth / truth, truth / depth) < 1.25
    """

    pixels: int
    known: float
    l1_m: float
    rmse_m: float
    abs_rel: float
    delta: float


def depth_sums(depth_m: Maps, truth_m: Maps, counted: Flags) -> NDArray[np.float64]:
    """What `depth_errors` takes, [7], of the pixels `counted` of two maps [h, w] in metres; depth NaN = unknown.

    Pixels, pixels with a depth, of these with a truth above 0, sums of |error|, of its square, of |error| / truth, and
    pixels within 1.25.
    """
    truth, depth = truth_m[counted].astype(np.float64), depth_m[counted].astype(np.float64)
    known = np.isfinite(depth)
    truth, depth = truth[known], depth[known]
    error, positive = np.abs(depth - truth), truth > 0
    relative = error[positive] / truth[positive]
    close = np.maximum(depth, truth) < 1.25 * np.minimum(depth, truth)
    pixels = counted.sum(), known.sum(), positive.sum()
    return np.array([*pixels, error.sum(), np.square(error).sum(), relative.sum(), close.sum()])


def depth_errors(sums: NDArray[np.float64]) -> DepthErrors:
    """Means from the sums [7] of `depth_sums`, of one picture or added up over several."""
    pixels, known, positive, error, squares, relative, close = (float(value) for value in sums)

    def share(part: float, whole: float) -> float:
        return part / whole if whole else math.nan

    return DepthErrors(
        pixels=int(pixels),
        known=share(known, pixels),
        l1_m=share(error, known),
        rmse_m=math.sqrt(share(squares, known)),
        abs_rel=share(relative, positive),
        delta=share(close, known),
    )


@dataclass(frozen=True)
class PictureErrors(DepthErrors):
    """Those of one picture, and the `depth_sums` of each depth bin, [k, 7]; the last has its upper edge."""

    bins: NDArray[np.float64]


def picture_errors(prediction_m: Maps, truth_m: Maps) -> PictureErrors:
    """Compare two maps [h, w] in metres, NaN = unknown."""
    if prediction_m.shape != truth_m.shape:
        raise ValueError(f"expected a prediction {truth_m.shape}, got {prediction_m.shape}")
    number = np.searchsorted(DEPTH_EDGES_M[1:-1], truth_m, side="right")
    number[~((truth_m >= DEPTH_EDGES_M[0]) & (truth_m <= DEPTH_EDGES_M[-1]))] = -1
    inside = (np.isfinite(truth_m), *(number == k for k in range(len(DEPTH_EDGES_M) - 1)))
    whole, *bins = (depth_sums(prediction_m, truth_m, each) for each in inside)
    return PictureErrors(**vars(depth_errors(whole)), bins=np.array(bins))


def mean(values: NDArray[Any]) -> float:
    """Mean, or NaN of nothing (without numpy's warning)."""
    return float(values.mean()) if values.size else float("nan")


def summary(pictures: Sequence[PictureErrors], displacements: Sequence[ArrayLike]) -> dict[str, Any]:
    """One test set: each metric is the mean over its pictures (those where it is defined), NaN with none.

    `rmse_m` is thus the mean of the pictures' RMSE. Depth bins pool the pixels of all pictures; angles of
    travel are the mean L1 of the pictures flown in that direction.
    """
    names = ("l1_m", "rmse_m", "abs_rel", "delta", "known")
    result: dict[str, Any] = {
        name: mean_of_known(np.array([getattr(picture, name) for picture in pictures])) for name in names
    }
    bins = np.sum([picture.bins for picture in pictures], axis=0) if pictures else None
    result["depth_bins"] = [] if bins is None else depth_bins(bins)
    angles = np.array([travel_angle_deg(displacement) for displacement in displacements])
    result["travel_angles"] = angle_bins(angles, np.array([picture.l1_m for picture in pictures]))
    return result


def mean_of_known(values: NDArray[np.float64]) -> float:
    """Mean of the finite values; NaN when there is none."""
    return mean(values[np.isfinite(values)])


def depth_bins(bins: NDArray[np.float64]) -> list[dict[str, float]]:
    """Rows {from_m, to_m, pixels, l1_m, abs_rel} from sums [k, 7]; the pixels are those with a depth."""
    ends, errors = pairwise(DEPTH_EDGES_M), map(depth_errors, bins)
    return [
        {"from_m": low, "to_m": high, "pixels": float(known), "l1_m": each.l1_m, "abs_rel": each.abs_rel}
        for (low, high), each, known in zip(ends, errors, bins[:, 1], strict=True)
    ]


def angle_bins(angles_deg: NDArray[np.float64], l1_m: NDArray[np.float64]) -> list[dict[str, float]]:
    """Rows {from_deg, to_deg, pictures, l1_m} of pictures by their angle of travel."""
    edges = ANGLE_EDGES_DEG
    number = np.clip(np.searchsorted(edges, angles_deg, side="right") - 1, 0, len(edges) - 2)
    return [
        {
            "from_deg": low,
            "to_deg": high,
            "pictures": float((number == bin_number).sum()),
            "l1_m": mean_of_known(l1_m[number == bin_number]),
        }
        for bin_number, (low, high) in enumerate(pairwise(edges))
    ]
