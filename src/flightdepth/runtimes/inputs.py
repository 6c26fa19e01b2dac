"""Pictures on the network's grid to the arrays that its graph takes."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.levels import AnyImage, rounded
from flightdepth.runtimes.contract import CURRENT, FIELD, PAIRS, SWEEPS, Arrays
from flightdepth.sweep import stacked, sweep


def paired_inputs(previous_n: Sequence[AnyImage], current: AnyImage) -> Arrays:
    """For a DepthNet: each earlier picture [H, W, 3] beside the current one."""
    pairs = np.empty((len(previous_n), *current.shape[:2], 6), dtype=np.uint8)
    current = rounded(current)
    for pair, previous in zip(pairs, previous_n, strict=True):
        # Five times as fast as assigning to slices of three channels.
        cv2.merge([rounded(previous), current], pair)
    return {PAIRS: pairs}


def swept_inputs(
    previous_n: Sequence[AnyImage], current: AnyImage, displacements: NDArray[np.float64], camera: Camera
) -> Arrays:
    """For a MotionNet: each earlier picture swept along its displacement, [n, 3]."""
    pairs = zip(previous_n, displacements, strict=True)
    swept = stacked(sweep(previous, current, moved, camera) for previous, moved in pairs)
    return dict(zip((CURRENT, *SWEEPS, FIELD), swept, strict=True))
