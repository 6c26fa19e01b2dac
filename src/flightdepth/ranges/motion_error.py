"""What an uncertain motion adds to the error bar of depth.

A static point of inverse depth w = 1 / Z on the ray (x, y, 1) was seen at (x + w d_x, y + w d_y) / (1 + w d_z). A turn
that is left unknown moves it along its line too, and is taken for parallax; a wrong direction changes by how much a
depth moves it. Both make w wrong by a share that grows towards the focus of expansion, and for a turn with depth.
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
from flightdepth.sweep import unit_direction
from flightdepth.triangulation import LEAST_AHEAD

NEAREST_TO_FOCUS = 1e-3  # on the plane z = 1
LEAST_DEPTH = 1e-3  # displacements


def widened(prediction: Prediction, pairs: Iterable[Pair], camera: Camera) -> Prediction:
    """The same with error bars that hold what each pair's motion leaves open; as it is where a network tells none."""
    if prediction.sigma_m is None:
        return prediction
    sigma_m = [
        own
        if pair.covariance is None
        else with_motion_error(own, depth_m, pair.displacement_m, pair.covariance, camera)
        for own, depth_m, pair in zip(prediction.sigma_m, prediction.depth_m, pairs, strict=True)
    ]
    return replace(prediction, sigma_m=np.stack(sigma_m))


def with_motion_error(
    sigma_m: Map, depth_m: Map, displacement_m: Vector, covariance: Vector, camera: Camera
) -> Map:
    """The network's deviations [h, w] and those of the motion together; `covariance` as `Remainder.left_open` tells."""
    rows = depth_errors(depth_m, displacement_m, camera).reshape(len(covariance), -1)
    variance = np.maximum(np.einsum("km,kl,lm->m", rows, covariance.astype(np.float32), rows), 0)
    motion_m = np.sqrt(variance).reshape(depth_m.shape) * depth_m
    return np.asarray(np.hypot(sigma_m, motion_m), np.float32)


def depth_errors(depth_m: Map, displacement_m: Vector, camera: Camera) -> Map:
    """By which share of itself depth [h, w] grows, for each of six small errors of a motion, float32 [6, h, w].

    The errors: the earlier picture turned by a radian more about x, y and z than it should have been, and a radian
    more of x, y and z in the direction of the displacement (3,). An ideal pinhole, seen at any size.
    """
    height, width = depth_m.shape
    rays = camera.resized(width, height).rays().astype(np.float32)
    x, y = rays[..., 0], rays[..., 1]
    dx, dy, dz = unit_direction(displacement_m).astype(np.float32)
    length_m = np.float32(np.linalg.norm(displacement_m))
    inverse = 1 / np.maximum(depth_m / max(length_m, np.float32(1e-9)), np.float32(LEAST_DEPTH))
    along_x, along_y = dx - x * dz, dy - y * dz
    reach = np.maximum(np.hypot(along_x, along_y), np.float32(NEAREST_TO_FOCUS))
    scale = 1 / np.maximum(1 + dz * inverse, np.float32(LEAST_AHEAD))
    before_x, before_y = x + along_x * inverse * scale, y + along_y * inverse * scale
    along_x, along_y = along_x / reach, along_y / reach
    # A turn w adds w x ray, brought back to z = 1; another direction e adds e x scale / Z, and both are along the line
    # what reach x scale^2 times an error of 1 / Z would be.
    toward = before_x * along_x + before_y * along_y
    turns = [
        -before_y * toward - along_y,
        before_x * toward + along_x,
        before_x * along_y - before_y * along_x,
    ]
    per_direction = 1 / (reach * scale)
    per_turn = -per_direction / (inverse * scale)
    return np.stack(
        [turn * per_turn for turn in turns] + [way * per_direction for way in (along_x, along_y, -toward)]
    )
