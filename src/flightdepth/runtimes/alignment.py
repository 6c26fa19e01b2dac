"""Depth of a motion network, aligned with the pictures.

Near things move by many pixels between two pictures. There a network, which chooses between hypotheses a third apart,
is good to a few per cent, and optical flow to a part of a pixel in ten or twenty; far away, at edges and on blank
walls it is the other way round. So optical flow (DIS, Kroeger et al. 2016) starts from where the network says that
each point was, the rotation that it shows is taken out of both (`left_rotation`), what it finds is triangulated, and a
few small convolutions judge from both and from what is around how far to go from the network's depth to that one, and
how large the error is then (`judge`). They are told ratios and pixels only, so they serve every network that knows the
motion, at any lens (`benchmarks/judging.py` fits them).
"""

from __future__ import annotations

from collections.abc import Iterable
from threading import local

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.levels import AnyImage, grey
from flightdepth.runtimes.arrays import Maps
from flightdepth.runtimes.contract import DEPTH, OUTPUT_STRIDE, SIGMA
from flightdepth.runtimes.judge import judge
from flightdepth.runtimes.left_rotation import left_rotation, mended_depth, rotated_flow
from flightdepth.sweep import motion_field, unit_direction
from flightdepth.triangulation import flow_of_depth, inverse_depth
from flightdepth.weights.card import NetworkCard

PATCH_PX, STRIDE_PX = 8, 6  # of the flow, at full size
LEAST_SIGMA = 0.005  # of the depth
LEAST_MOVED_PX = 0.05
WIDEST = 2.0  # logarithm of one inverse depth over the other


def align(
    card: NetworkCard,
    output: dict[str, Maps],
    previous_n: Iterable[AnyImage],
    current: AnyImage,
    displacements: NDArray[np.float64],
    *,
    camera: Camera,
) -> None:
    """Mend `output` in place, of n pairs with one present picture; pairs without a displacement stay.

    card                 of the network
    output               depth_m and sigma_m, float32 [n, H/4, W/4]: metres at the D0 that the card has at the camera's
                         focal length (`at_focal`)
    previous_n, current  uint8 RGB [H, W, 3], on the network's grid
    displacements        [n, 3], of which only the direction counts
    camera               of that grid, W x H pixels
    """
    lengths_per_output = np.float32(card.at_focal(camera.fx).alpha / card.depth_max_m)
    seen = grey(current)
    for i, (previous, displacement) in enumerate(zip(previous_n, displacements, strict=True)):
        direction = unit_direction(displacement)
        if not direction.any():
            continue
        depth, sigma = output[DEPTH][i], output[SIGMA][i]
        flown = depth * lengths_per_output
        clues, depth = clues_of(grey(previous), seen, flown, sigma / depth, direction, camera=camera)
        change, spread = judge()(clues)
        aligned = depth / lengths_per_output * np.exp(change)
        output[SIGMA][i] = spread * aligned
        output[DEPTH][i] = aligned.clip(card.depth_min_m, card.depth_max_m)


def clues_of(
    previous: AnyImage,
    current: AnyImage,
    depth: Maps,
    sigma: Maps,
    direction: NDArray[np.float64],
    *,
    camera: Camera,
) -> tuple[Maps, Maps]:
    """What tells which of two depths is right, float32 [k, h, w]; and the network's, without what a rotation made.

    previous, current  grey [H, W]
    depth, sigma       the network's, [h, w]: in displacements, and as a share of the depth
    direction          of the displacement, (3,)

    The clues: the logarithm of the inverse depth by flow over the network's, 0 where the earlier picture does not hold
    the point, since flow only guesses there; those of sigma and of the pixels moved; of the pixels by which the flow
    leaves the known line, of its roughness in the block and of how strongly grey changes along the line; 1 where the
    earlier picture holds the point.
    """
    height, width = depth.shape
    small = camera.resized(width, height)
    depth = np.maximum(depth, np.float32(1e-6))
    start = (OUTPUT_STRIDE * flow_of_depth(depth, direction, small)).astype(np.float32)
    start = np.asarray(cv2.resize(start, (camera.width, camera.height)), np.float32)
    flow = np.asarray(_FLOW.dis.calc(current, previous, start), np.float32)
    mean = _blocks(flow)
    squared = flow[..., 0] ** 2 + flow[..., 1] ** 2
    rough = np.sqrt(np.maximum(_blocks(squared) - (mean * mean).sum(2), 0))
    along_line, across_line = _contrast(current, direction, camera)
    held = _held(mean, camera)
    rotation = left_rotation(mean, across_line, held, direction, camera)
    if rotation is not None:
        mean -= rotated_flow(mean, rotation, camera)
        depth = mended_depth(depth, rotation, direction, camera)
    inverse, leverage = inverse_depth(mean / OUTPUT_STRIDE, direction, small)
    inverse, leverage_px = np.maximum(inverse, 1e-9), OUTPUT_STRIDE * leverage
    along = OUTPUT_STRIDE * flow_of_depth((1 / inverse).astype(np.float32), direction, small)
    off = np.linalg.norm(mean - along, axis=2)
    clues = np.stack(
        [
            np.log(inverse * depth).clip(-WIDEST, WIDEST) * held,
            np.log(np.maximum(sigma, LEAST_SIGMA)),
            np.log(np.maximum(leverage_px / depth, LEAST_MOVED_PX)),
            np.log1p(3 * off),
            np.log1p(3 * rough),
            np.log1p(along_line),
            held,
        ]
    )
    return np.asarray(clues, np.float32), depth


class _Flow(local):
    """DIS, one for each thread: it keeps its buffers, which is worth a third of its time, and no two may share it."""

    def __init__(self) -> None:
        self.dis = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
        self.dis.setFinestScale(0)
        self.dis.setPatchSize(PATCH_PX)
        self.dis.setPatchStride(STRIDE_PX)
        # A third of the time, for hardly anything that blocks show.
        self.dis.setVariationalRefinementIterations(0)


_FLOW = _Flow()


def _blocks(values: Maps) -> Maps:
    """Means over the blocks that belong to one pixel of output."""
    height, width = values.shape[:2]
    size = width // OUTPUT_STRIDE, height // OUTPUT_STRIDE
    return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_AREA), np.float32)


def _contrast(current: AnyImage, direction: NDArray[np.float64], camera: Camera) -> tuple[Maps, Maps]:
    """Squared change of grey, a pixel, along the line on which each point moves and across it, [h, w] each."""
    right = cv2.Scharr(current, cv2.CV_32F, 1, 0, scale=1 / 32)
    down = cv2.Scharr(current, cv2.CV_32F, 0, 1, scale=1 / 32)
    field = motion_field(direction, camera)
    x, y = field / np.maximum(np.hypot(*field), 1e-9)
    rights, downs, both = _blocks(right * right), _blocks(down * down), 2 * _blocks(right * down) * x * y
    along, across = rights * x * x + downs * y * y + both, rights * y * y + downs * x * x - both
    return np.asarray(np.maximum(along, 0), np.float32), np.asarray(np.maximum(across, 0), np.float32)


def _held(flow: Maps, camera: Camera) -> Maps:
    """1 where the earlier picture holds the middle of a block, else 0, [h, w]."""
    rows, columns = np.indices(flow.shape[:2])
    x = OUTPUT_STRIDE * columns + (OUTPUT_STRIDE - 1) / 2 + flow[..., 0]
    y = OUTPUT_STRIDE * rows + (OUTPUT_STRIDE - 1) / 2 + flow[..., 1]
    inside = np.logical_and.reduce([x >= 0, x <= camera.width - 1, y >= 0, y <= camera.height - 1])
    return np.asarray(inside, np.float32)
