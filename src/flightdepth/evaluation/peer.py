"""What one gets without a network: optical flow and triangulation, or the best constant depth.

The network and its peers know the same: two pictures without rotation, and the displacement between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike

from flightdepth.camera import Camera
from flightdepth.levels import Image, grey
from flightdepth.runtimes.arrays import Maps
from flightdepth.triangulation import inverse_depth

# Flow of DIS is good to a few tenths of a pixel; below this shift, at a tenth of the largest depth, a pixel
# tells nothing: it lies next to the focus of expansion.
BLIND_PX = 0.5


@dataclass(frozen=True)
class ClassicalPeer:
    """OpenCV's DIS optical flow (medium preset), then least-squares triangulation along the known motion.

    Depths are clipped to `depth_min_m`..`depth_max_m`, the range that the network's output has too.
    """

    depth_min_m: float
    depth_max_m: float

    @cached_property
    def _dis(self) -> Any:
        return cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)

    def depth(self, previous: Image, current: Image, displacement: ArrayLike, camera: Camera) -> Maps:
        """Depth of `current` in metres, float32 [H, W], of stabilised uint8 RGB pictures [H, W, 3].

        A pixel that moved the wrong way, or by too little for the largest depth, is at the largest depth. A
        pixel that could not have moved (see BLIND_PX) takes the median of the others; if all are blind, as
        without a displacement, the result is NaN.
        """
        flow_hw2 = np.asarray(self._dis.calc(grey(current), grey(previous), None), dtype=np.float32)
        inverse, leverage_px = inverse_depth(flow_hw2, displacement, camera)
        with np.errstate(divide="ignore"):
            depth_m = np.where(inverse > 0, 1 / inverse, self.depth_max_m)
        depth_m = depth_m.clip(self.depth_min_m, self.depth_max_m)
        blind = leverage_px < BLIND_PX * self.depth_max_m / 10
        depth_m[blind] = np.nan if blind.all() else np.median(depth_m[~blind])
        return depth_m.astype(np.float32)


def known_pixels(maps_m: Sequence[Maps]) -> Maps:
    """All finite values of some maps, flat."""
    return np.concatenate([each[np.isfinite(each)] for each in maps_m] or [np.zeros(0, np.float32)])


def best_constant_m(truths_m: Sequence[Maps]) -> float:
    """The depth with the least L1 error over all maps: the median of their known pixels; NaN with none."""
    known = known_pixels(truths_m)
    return float(np.median(known)) if known.size else float("nan")
