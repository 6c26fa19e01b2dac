"""The small rotation that is left between two pictures of a pair, from the flow that depth is aligned by.

Where a point goes along its line depends on its depth, where it goes across does not: for a camera that does not turn
it stays on the line. A rotation w (radians) that nobody knew of moves all points across theirs, each as its ray tells,
so that some thousand blocks give w by least squares: to half of what tracked corners leave, since the flow starts from
the network's depth, already in place. Blocks without contrast across the line say nothing, those that move by
themselves or lie at an edge little (Cauchy weights).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera

Maps = NDArray[np.float32]
Values = NDArray[np.float64]

CONTRAST = 10.0  # squared change of grey across the line, a pixel, that gives half the weight
FEWEST_BLOCKS, CLEAR_WEIGHT = 100, 0.3
NEAREST_TO_FOCUS = 0.05  # on the plane z = 1
STEPS = 5
LEAST_NOISE_PX = 0.02
# Squared deviations from which on a rotation is taken out: chi^2 of 3 parameters, 95 %, for blocks that err together,
# which deviate 2.8 times as far as independent ones. With 12 instead, pairs that did not turn lose what others gain.
CLEAR = 60.0


def left_rotation(
    flow: Maps, contrast: Maps, held: Maps, direction: NDArray[np.float64], camera: Camera
) -> Values | None:
    """Rotation vector (3,) that turned the earlier picture's rays, radians; None where it does not stand out.

    flow       pixels of `camera` from the current picture's blocks to the earlier one's, [h, w, 2]
    contrast   squared change of grey across each block's line, [h, w]
    held       1 where the earlier picture holds the block, [h, w]
    direction  of the displacement, (3,)
    """
    weights = (contrast / (contrast + np.float32(CONTRAST)) * held).ravel()
    clear = weights > CLEAR_WEIGHT
    if np.count_nonzero(clear) < FEWEST_BLOCKS:
        return None
    rows, off = _across(flow, direction, camera)
    rotation, noise = np.zeros(3), 0.0
    for _ in range(STEPS):
        left = off - np.einsum("k,km->m", rotation, rows)
        noise = max(1.4826 * float(np.median(np.abs(left[clear]))), LEAST_NOISE_PX / camera.fx)
        trusted = rows * (weights / (1 + (left / noise) ** 2))
        information = np.einsum("km,lm->kl", trusted, rows) + 1e-9 * np.eye(3)
        rotation = np.linalg.solve(information, np.einsum("km,m->k", trusted, off))
    return rotation if rotation @ information @ rotation > CLEAR * noise**2 else None


def rotated_flow(flow: Maps, rotation: Values, camera: Camera) -> Maps:
    """What of a flow [h, w, 2] a rotation of the earlier picture's rays made, pixels."""
    x, y = _before(flow, camera)
    wx, wy, wz = rotation
    toward = wx * y - wy * x
    return np.asarray(
        np.stack([camera.fx * (wy - wz * y - x * toward), camera.fy * (wz * x - wx - y * toward)], axis=-1),
        np.float32,
    )


def _before(flow: Maps, camera: Camera) -> tuple[Values, Values]:
    """Rays of the earlier picture on the plane z = 1, [h, w] each."""
    height, width = flow.shape[:2]
    rays = camera.resized(width, height).rays()
    return rays[..., 0] + flow[..., 0] / camera.fx, rays[..., 1] + flow[..., 1] / camera.fy


def _across(flow: Maps, direction: NDArray[np.float64], camera: Camera) -> tuple[Values, Values]:
    """What three turns add to the distance from the line (3, N), and that distance (N,), on the plane z = 1."""
    height, width = flow.shape[:2]
    rays = camera.resized(width, height).rays()
    along_x, along_y = direction[0] - rays[..., 0] * direction[2], direction[1] - rays[..., 1] * direction[2]
    reach = np.maximum(np.hypot(along_x, along_y), NEAREST_TO_FOCUS)
    nx, ny = -along_y / reach, along_x / reach
    x, y = _before(flow, camera)
    off = (x - rays[..., 0]) * nx + (y - rays[..., 1]) * ny
    toward = x * nx + y * ny
    rows = np.stack([-ny - y * toward, nx + x * toward, x * ny - y * nx])
    return rows.reshape(3, -1), off.ravel()
