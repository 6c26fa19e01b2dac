"""What moved too far for a network's sweep, from smaller pictures, where it moved less.

A picture of half the size shows the same scene at half the focal length: a point moves by half as many pixels, for a
quarter of the price. Output belongs to a shift in pixels, so it is worth focal length over focal length there.
"""

from __future__ import annotations

import cv2
import numpy as np

from flightdepth.camera import Camera
from flightdepth.runtimes.arrays import Flags, Maps
from flightdepth.runtimes.contract import DEPTH, SIGMA, STRIDE
from flightdepth.runtimes.grid import NetworkGrid, filling_focal_px
from flightdepth.weights.card import NetworkCard

# Points that moved farther, in pixels, are better seen in smaller pictures (docs/log.md). The widest hypothesis is 32;
# what lies a little beyond is mended by each look after the first, whose hypotheses stand a third apart.
REACH_PX, FURTHER_LOOK = 28.0, 1.3
FEW = 0.01  # a smaller share of such pixels is not worth a look


def coarser_grid(card: NetworkCard, camera: Camera) -> NetworkGrid | None:
    """The view of a grid's pictures at half their size, or as near to it as fills a grid; None: there is none."""
    if not card.knows_direction or min(camera.width, camera.height) < 2 * STRIDE:
        return None
    return NetworkGrid(camera, filling_focal_px(camera, camera.fx / 2), resampled=True)


def beyond_reach(card: NetworkCard, depth_m: Maps, valid: Flags) -> list[int]:
    """Which of n pairs' outputs [n, h, w] say, where `valid` [h, w], that enough of the picture moved too far."""
    near = (depth_m < _nearest_m(card)) & valid
    return [int(i) for i in np.flatnonzero(near.mean(axis=(1, 2)) > FEW)]


def take_near(
    card: NetworkCard, output: dict[str, Maps], far: list[int], coarse: dict[str, Maps], grid: NetworkGrid
) -> None:
    """Write into `output` what `coarse`, on `grid`, says of the pixels of the pairs `far` that moved too far."""
    height, width = output[DEPTH].shape[1:]
    finer = np.float32(grid.camera.fx / grid.source.fx)
    for k, i in enumerate(far):
        depth_m, sigma_m = (
            finer * cv2.resize(grid.to_source(coarse[name][k]), (width, height), interpolation=cv2.INTER_AREA)
            for name in (DEPTH, SIGMA)
        )
        near = depth_m < _nearest_m(card)
        np.copyto(output[DEPTH][i], depth_m, where=near)
        np.copyto(output[SIGMA][i], sigma_m, where=near)


def reach_px(card: NetworkCard) -> float:
    """How far a point may have moved between pictures of a size that the network sees."""
    return float(REACH_PX * FURTHER_LOOK ** (card.looks - 1))


def _nearest_m(card: NetworkCard) -> float:
    """Output, metres at D0, of a point that moved as far as the reach: focal D0 / depth pixels."""
    return card.focal_px * card.D0_m / reach_px(card)
