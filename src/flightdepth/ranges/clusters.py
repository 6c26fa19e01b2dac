"""Which depths the next pairs shall look at: k-means on the fused depth (paper, section IV.B)."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.motion import Vector
from flightdepth.ranges.fusion import best_beta
from flightdepth.ranges.network import Map
from flightdepth.weights.card import NetworkCard

# Clustering a thousand of the map's pixels moves a centroid by a few percent of its cluster's width.
MAX_SAMPLES = 1024
STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 10, 1e-3)


def centroids(
    depth_m: Map, count: int, last_m: Vector | None = None, *, logarithmic: bool = False
) -> Vector | None:
    """Depths [count], metres, rising, that represent the finite pixels of `depth_m` (any shape).

    One centroid is the mean, the paper's E(zeta). k-means starts from the pixels nearest to each of
    `last_m` [count], or from equally large groups; no random numbers. None where fewer pixels are known
    than asked for.

    `logarithmic` clusters log depth. What a pair can measure is a ratio, from beta_min to beta_max over
    beta_mean times its centroid, so clusters of equal ratios fit it; on a linear scale a few far pixels
    claim a range of their own and leave the near ones, which matter most, with too few.
    """
    known = depth_m[np.isfinite(depth_m)]
    if len(known) < count:
        return None
    if count == 1:
        return np.array([known.mean(dtype=np.float64)])
    samples = known[:: -(-len(known) // MAX_SAMPLES)]
    if not logarithmic:
        return _k_means(samples, count, last_m)
    # A network's output of exactly 0 has no logarithm; a millimetre is below any range.
    last_log = None if last_m is None else np.log(last_m)
    return np.exp(_k_means(np.log(np.maximum(samples, np.float32(1e-3))), count, last_log))


def wanted_displacements(centroids_m: Vector, card: NetworkCard, limit_m: float) -> Vector:
    """D_i = C_i / (alpha beta_mean), metres (paper, equation 4), none longer than `limit_m`."""
    return np.minimum(centroids_m / (card.alpha * best_beta(card)), limit_m)


def _k_means(samples: Map, count: int, last: Vector | None) -> Vector:
    labels = _groups(samples, count) if last is None else _nearest(samples, last)
    found = cv2.kmeans(samples[:, None], count, labels[:, None], STOP, 1, cv2.KMEANS_USE_INITIAL_LABELS)[2]
    return np.sort(found[:, 0].astype(np.float64))


def _nearest(samples: Map, last_m: Vector) -> NDArray[np.int32]:
    return np.asarray(np.abs(samples[:, None] - last_m).argmin(axis=1), dtype=np.int32)


def _groups(samples: Map, count: int) -> NDArray[np.int32]:
    labels = np.empty(len(samples), dtype=np.int32)
    labels[np.argsort(samples, kind="stable")] = np.arange(len(samples)) * count // len(samples)
    return labels
