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


def flow_of_depth(depth_m: Maps, displacement: ArrayLike, camera: Camera) -> Values:
    """Pixels [H, W, 2] from where a point of depth [H, W] is seen to where it was seen; an ideal pinhole."""
    dx, dy, dz = np.asarray(displacement, dtype=np.float64)
    rays, inverse = camera.rays(), 1 / depth_m
    scale = inverse / np.maximum(1 + dz * inverse, LEAST_AHEAD)
    return np.stack(
        [camera.fx * (dx - dz * rays[..., 0]) * scale, camera.fy * (dy - dz * rays[..., 1]) * scale], axis=-1
    )


def inverse_depth(flow_hw2: Maps | Values, displacement: ArrayLike, camera: Camera) -> tuple[Values, Values]:
    """Inverse depth 1/Z [H, W] in 1/m by least squares, and the pixels of flow that 1/Z = 1/m would cause.

    Multiplied out, the equation above is linear in w = 1/Z: a w = b with a = f (d_x - x' d_z, d_y - y' d_z) and
    b = f (x' - x, y' - y), the flow; so w = a.b / a.a. An ideal pinhole.
    """
    dx, dy, dz = np.asarray(displacement, dtype=np.float64)
    rays = camera.rays()
    a_x = camera.fx * (dx - (rays[..., 0] + flow_hw2[..., 0] / camera.fx) * dz)
    a_y = camera.fy * (dy - (rays[..., 1] + flow_hw2[..., 1] / camera.fy) * dz)
    square = a_x**2 + a_y**2
    along = a_x * flow_hw2[..., 0] + a_y * flow_hw2[..., 1]
    return np.divide(along, square, out=np.zeros_like(square), where=square > 0), np.sqrt(square)
