"""From depth to where a point lies in the earlier picture, and from there back to depth.

With r = (x, y, 1) the ray of a pixel of the current picture and d the displacement, X_previous = Z r + d is seen at
(x', y') = (x + d_x / Z, y + d_y / Z) / (1 + d_z / Z).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flightdepth.camera import Camera

Maps = NDArray[np.float32]
Values = NDArray[np.float64]

LEAST_AHEAD = 0.05  # of a point's depth: what counts as left of it when a camera has flown past
NEAREST_TO_FOCUS = 1e-3  # on the plane z = 1: closer to the focus of expansion a line has no direction
LEAST_DEPTH = 1e-3  # displacements


def flow_of_depth(depth_m: Maps, displacement: ArrayLike, camera: Camera) -> Values:
    """Pixels [H, W, 2] from where a point of depth [H, W] is seen to where it was seen; an ideal pinhole."""
    dx, dy, dz = np.asarray(displacement, dtype=np.float64)
    (x, y), inverse = camera.ray_axes(), 1 / depth_m
    scale = inverse / np.maximum(1 + dz * inverse, LEAST_AHEAD)
    return np.stack([camera.fx * (dx - dz * x) * scale, camera.fy * (dy - dz * y) * scale], axis=-1)


def inverse_depth(flow_hw2: Maps | Values, displacement: ArrayLike, camera: Camera) -> tuple[Values, Values]:
    """Inverse depth 1/Z [H, W] in 1/m by least squares, and the pixels of flow that 1/Z = 1/m would cause.

    Multiplied out, the equation above is linear in w = 1/Z: a w = b with a = f (d_x - x' d_z, d_y - y' d_z) and
    b = f (x' - x, y' - y), the flow; so w = a.b / a.a. An ideal pinhole.
    """
    dx, dy, dz = np.asarray(displacement, dtype=np.float64)
    x, y = camera.ray_axes()
    a_x = camera.fx * (dx - (x + flow_hw2[..., 0] / camera.fx) * dz)
    a_y = camera.fy * (dy - (y + flow_hw2[..., 1] / camera.fy) * dz)
    square = a_x**2 + a_y**2
    along = a_x * flow_hw2[..., 0] + a_y * flow_hw2[..., 1]
    return np.divide(along, square, out=np.zeros_like(square), where=square > 0), np.sqrt(square)


def depth_errors(depth_m: Maps, displacement_m: ArrayLike, camera: Camera) -> Maps:
    """By which share of itself depth [h, w] grows, for each of six small errors of a motion, float32 [6, h, w].

    The errors: the earlier picture turned by a radian more about x, y and z than it should have been, and a radian
    more of x, y and z in the direction of the displacement (3,). An ideal pinhole, seen at any size.
    """
    height, width = depth_m.shape
    x, y = (axis.astype(np.float32) for axis in camera.resized(width, height).ray_axes())
    moved_m = np.asarray(displacement_m, np.float32)
    length_m = np.linalg.norm(moved_m)
    dx, dy, dz = moved_m / max(length_m, np.float32(1e-9))
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
