"""The small rotation that is left between two pictures of a pair, from the flow that depth is aligned by.

Where a point goes along its line depends on its depth; across it a point goes only where the motion is a little off.
Each block of the flow tells how far it left its line, and least squares with Cauchy weights give the rotation, with
two angles of the direction beside it. Tracked corners leave half as much again: the flow starts from the network's
depth, already in place. Where the blocks say little about a turn (about one that moves points along their lines, or
through a long lens) priors of what corners leave hold it near zero.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.epipolar import aside, lines, quick_median
from flightdepth.runtimes.arrays import Maps
from flightdepth.triangulation import depth_errors, flow_of_depth

Values = NDArray[np.float64]

CONTRAST = 10.0  # squared change of grey across the line, a pixel, that gives a block half the weight
FEWEST_BLOCKS, CLEAR_WEIGHT = 100, 0.3  # those with less weight do not count
LEFT_RAD, ASTRAY_RAD = np.radians(0.03), np.radians(0.5)  # what is usually left of rotation, of direction
TOGETHER = 9.0  # blocks err together: a rotation that much more than from independent ones
LEAST_NOISE_PX = 0.02
STEPS = 5
LEAST_MATCHED_PX = 0.5
MOST_TAKEN = 0.5  # logarithm of the depth that a rotation may be said to have made


def left_rotation(
    flow: Maps, contrast: Maps, held: Maps, direction: NDArray[np.float64], camera: Camera
) -> Values | None:
    """Rotation vector (3,) by which the earlier picture's rays are turned too far, radians; None of few blocks.

    flow       pixels of `camera` from the current picture's blocks to the earlier one's, [h, w, 2]
    contrast   squared change of grey across each block's line, [h, w]
    held       1 where the earlier picture holds the block, [h, w]
    direction  of the displacement, (3,), a unit vector
    """
    weights = (contrast / (contrast + np.float32(CONTRAST)) * held).ravel().astype(np.float64)
    clear = np.flatnonzero(weights > CLEAR_WEIGHT)
    if len(clear) < FEWEST_BLOCKS:
        return None
    weights = weights[clear]
    now, before = (rays[:, clear] for rays in _rays(flow, camera))
    table = lines(now, before, direction, aside(direction))[:, : len(clear)]
    rows, off = table[:5], table[5]
    prior = np.diag([LEFT_RAD**-2.0] * 3 + [ASTRAY_RAD**-2.0] * 2)
    mending = np.zeros(5)
    for _ in range(STEPS):
        left = off + mending @ rows
        noise = max(1.4826 * quick_median(np.abs(left)), LEAST_NOISE_PX / camera.fx)
        trusted = rows * (weights / ((TOGETHER * noise) ** 2 * (1 + (left / noise) ** 2)))
        mending = np.linalg.solve(trusted @ rows.T + prior, -trusted @ off)
    return -mending[:3]


def rotated_flow(flow: Maps, rotation: Values, camera: Camera) -> Maps:
    """What of a flow [h, w, 2] a rotation of the earlier picture's rays made, pixels."""
    x, y, _ = _rays(flow, camera)[1]
    wx, wy, wz = rotation
    toward = wx * y - wy * x
    made = [camera.fx * (wy - wz * y - x * toward), camera.fy * (wz * x - wx - y * toward)]
    return np.stack(made, axis=-1).reshape(flow.shape).astype(np.float32)


def mended_depth(depth: Maps, rotation: Values, direction: NDArray[np.float64], camera: Camera) -> Maps:
    """Depth [h, w], in displacements, without what a rotation of the earlier picture's rays made of it, to first order.

    A point that moved by less than LEAST_MATCHED_PX is far because nothing was matched, whatever the camera did.
    """
    height, width = depth.shape
    small = camera.resized(width, height)
    moved_px = camera.width / width * np.linalg.norm(flow_of_depth(depth, direction, small), axis=2)
    share = np.einsum("k,khw->hw", rotation, depth_errors(depth, direction, small)[:3])
    share = np.where(moved_px > LEAST_MATCHED_PX, share.clip(-MOST_TAKEN, MOST_TAKEN), 0)
    return np.asarray(depth * np.exp(-share), np.float32)


def _rays(flow: Maps, camera: Camera) -> tuple[Values, Values]:
    """Rays of the blocks and of where they are in the earlier picture, (3, N) each, z = 1."""
    height, width = flow.shape[:2]
    now = np.ones((3, height, width))
    now[0], now[1] = camera.resized(width, height).ray_axes()
    before = now.copy()
    before[0] += flow[..., 0] / camera.fx
    before[1] += flow[..., 1] / camera.fy
    return now.reshape(3, -1), before.reshape(3, -1)
