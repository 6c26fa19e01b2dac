"""What an uncertain motion adds to the error bar of depth.

A static point of inverse depth w = 1 / Z on the ray (x, y, 1) was seen at (x + w d_x, y + w d_y) / (1 + w d_z). A turn
that is left unknown moves it along its line too, and is taken for parallax; a wrong direction changes by how much a
depth moves it. Both make w wrong by a share that grows towards the focus of expansion, and for a turn with depth.
A wrong length of the displacement makes every depth wrong by its own share.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from flightdepth.camera import Camera
from flightdepth.motion import Vector
from flightdepth.ranges.network import Map
from flightdepth.ranges.pairs import Pair
from flightdepth.runtimes.prediction import Prediction
from flightdepth.triangulation import depth_errors


def widened(prediction: Prediction, pairs: Iterable[Pair], camera: Camera) -> Prediction:
    """The same with error bars that hold what each pair's motion leaves open; as it is where a network tells none."""
    if prediction.sigma_m is None:
        return prediction
    sigma_m = [
        _with_pairs_error(own, depth_m, pair, camera)
        for own, depth_m, pair in zip(prediction.sigma_m, prediction.depth_m, pairs, strict=True)
    ]
    return replace(prediction, sigma_m=np.stack(sigma_m))


def _with_pairs_error(sigma_m: Map, depth_m: Map, pair: Pair, camera: Camera) -> Map:
    if pair.covariance is not None:
        sigma_m = with_motion_error(sigma_m, depth_m, pair.displacement_m, pair.covariance, camera)
    if pair.length_sigma_m:
        share = np.float32(pair.length_sigma_m / pair.length_m)
        sigma_m = np.asarray(np.hypot(sigma_m, share * depth_m), np.float32)
    return sigma_m


def with_motion_error(
    sigma_m: Map, depth_m: Map, displacement_m: Vector, covariance: Vector, camera: Camera
) -> Map:
    """The network's deviations [h, w] and those of the motion together; `covariance` as `Remainder.left_open` tells."""
    rows = depth_errors(depth_m, displacement_m, camera).reshape(len(covariance), -1)
    variance = np.maximum(np.einsum("km,kl,lm->m", rows, covariance.astype(np.float32), rows), 0)
    motion_m = np.sqrt(variance).reshape(depth_m.shape) * depth_m
    return np.asarray(np.hypot(sigma_m, motion_m), np.float32)
