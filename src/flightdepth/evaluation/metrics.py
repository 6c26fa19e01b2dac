"""Errors of depth maps, per picture and summed up over a test set, as the paper's table has them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flightdepth.runtimes.arrays import Maps

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
class PictureErrors:
    """Errors of one picture over the pixels where prediction and truth are both known; NaN when there is none.

    l1_m      mean |prediction - truth|
    rmse_m    root of the mean square
    abs_rel   mean |prediction - truth| / truth, where the truth is above 0
    delta     share of pixels with max(prediction / truth, truth / prediction) < 1.25
    known     share of the truth's pixels for which there is a prediction
    bins      [k, 3] per depth bin: pixels, sum of |error| in metres, sum of |error| / truth
    """

    l1_m: float
    rmse_m: float
    abs_rel: float
    delta: float
    known: float
    bins: NDArray[np.float64]


def picture_errors(prediction_m: Maps, truth_m: Maps) -> PictureErrors:
    """Compare two maps [h, w] in metres, NaN = unknown."""
    if prediction_m.shape != truth_m.shape:
        raise ValueError(f"expected a prediction {truth_m.shape}, got {prediction_m.shape}")
    with_truth = np.isfinite(truth_m)
    both = with_truth & np.isfinite(prediction_m)
    prediction, truth = prediction_m[both].astype(np.float64), truth_m[both].astype(np.float64)
    error = np.abs(prediction - truth)
    positive = truth > 0
    relative = error[positive] / truth[positive]
    larger = np.maximum(prediction, truth)
    close = larger < 1.25 * np.minimum(prediction, truth)
    return PictureErrors(
        l1_m=mean(error),
        rmse_m=float(np.sqrt(mean(error**2))),
        abs_rel=mean(relative),
        delta=mean(close),
        known=mean(both[with_truth]),
        bins=bin_sums(truth, error),
    )


def bin_sums(truth_m: NDArray[np.float64], error_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """[k, 3] pixels, sum of errors and sum of relative errors per bin of the truth [N]; the last has its upper edge."""
    relative = np.divide(error_m, truth_m, out=np.zeros_like(error_m), where=truth_m > 0)
    columns = (np.ones_like(error_m), error_m, relative)
    return np.stack([np.histogram(truth_m, DEPTH_EDGES_M, weights=each)[0] for each in columns], axis=1)


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
    """Rows {from_m, to_m, pixels, l1_m, abs_rel} from sums [k, 3]."""
    rows = []
    for (low, high), (pixels, error, relative) in zip(pairwise(DEPTH_EDGES_M), bins, strict=True):
        per_pixel = 1 / pixels if pixels else float("nan")
        row = {"from_m": low, "to_m": high, "pixels": pixels, "l1_m": error * per_pixel}
        rows.append(row | {"abs_rel": relative * per_pixel})
    return [{key: float(value) for key, value in row.items()} for row in rows]


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
