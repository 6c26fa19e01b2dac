"""Depth as colours: near is bright, far is dark, and what is not known looks like neither.

The scale is logarithmic, so that a step in colour is the same ratio of depths at any distance: 2 m stands out
from 3 m as 20 m does from 30 m. Colours are matplotlib's inferno, whose steps look alike to the eye and which
holds no grey, blue or green. Hatched is what has no depth: grey where nothing is known, blue where it is only
known to be farther than some bound, green where it is nearer than one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.errors import BadInput
from flightdepth.outputs.encoding import FARTHEST, UNIT_M, UNKNOWN, Map, centimetres_from_depth
from flightdepth.runtimes.arrays import Flags

Picture = NDArray[np.uint8]

HATCH_PX = 12
INFERNO_RGB = cv2.applyColorMap(np.arange(256, dtype=np.uint8), cv2.COLORMAP_INFERNO)[..., ::-1].copy()
# Inferno's ends are so near to black and white that shapes vanish there.
DARKEST, BRIGHTEST = 14, 246
TICKS_M = (1, 2, 5, 10, 20, 50, 100, 200, 500)


@dataclass(frozen=True)
class Hatch:
    """A ground colour with thin diagonal lines: how pixels without a depth look."""

    ground_rgb: tuple[int, int, int]
    line_rgb: tuple[int, int, int]
    falling: bool

    def picture(self, width: int, height: int) -> Picture:
        """RGB [height, width, 3]."""
        picture = np.full((height, width, 3), self.ground_rgb, np.uint8)
        for x in range(-height, width + height, HATCH_PX):
            top, bottom = (x, x + height) if self.falling else (x + height, x)
            cv2.line(picture, (top, 0), (bottom, height), self.line_rgb, 1, cv2.LINE_AA)
        return picture


UNKNOWN_HATCH = Hatch((104, 104, 104), (124, 124, 124), falling=True)
FARTHER_HATCH = Hatch((66, 98, 142), (108, 144, 190), falling=False)
NEARER_HATCH = Hatch((112, 176, 96), (168, 220, 150), falling=False)


@dataclass(frozen=True)
class DepthScale:
    """Metres shown as the brightest (`near_m`) and darkest colour (`far_m`); beyond either, that colour."""

    near_m: float = 1.0
    far_m: float = 200.0

    def __post_init__(self) -> None:
        if not 0 < self.near_m < self.far_m <= FARTHEST * UNIT_M:
            expected = f"0 < near < far <= {FARTHEST * UNIT_M} m"
            raise BadInput("depth scale", expected=expected, got=f"{self.near_m} to {self.far_m} m")

    @property
    def ticks_m(self) -> tuple[int, ...]:
        """Round depths within the scale."""
        return tuple(tick for tick in TICKS_M if self.near_m <= tick <= self.far_m)

    def position(self, depth_m: float) -> float:
        """0 at `far_m`, 1 at `near_m`, even in the logarithm between."""
        share = math.log(self.far_m / depth_m) / math.log(self.far_m / self.near_m)
        return min(1.0, max(0.0, share))


class Palette:
    """Colours depth maps by one scale. Tables and hatches are made once."""

    def __init__(self, scale: DepthScale) -> None:
        self.scale = scale
        depth_m = np.maximum(np.arange(FARTHEST + 1), 1) * UNIT_M
        shares = np.log(scale.far_m / depth_m) / math.log(scale.far_m / scale.near_m)
        self._table = coloured(steps_of(shares)[:, None])[:, 0]
        self._pictures: dict[tuple[Hatch, tuple[int, ...]], Picture] = {}

    def paint(
        self, centimetres: NDArray[np.uint16], farther: Flags | None = None, nearer: Flags | None = None
    ) -> Picture:
        """Colours RGB [H, W, 3] of stored depth [H, W].

        `farther`, `nearer`, bool [H, W]: which pixels without depth are known to be so, by some bound.
        """
        picture = np.take(self._table, centimetres, axis=0)
        unknown = centimetres == UNKNOWN
        self._lay(UNKNOWN_HATCH, unknown, picture)
        for hatch, told in ((FARTHER_HATCH, farther), (NEARER_HATCH, nearer)):
            if told is not None:
                self._lay(hatch, unknown & told, picture)
        return picture

    def fitted(
        self, size: tuple[int, int], depth_m: Map, farther_m: Map | None = None, nearer_m: Map | None = None
    ) -> Picture:
        """Colours RGB of a depth [H, W] and its bounds, NaN = none, at `size` (width, height).

        Of the nearest pixels, since depths must not be mixed across an edge.
        """

        def at_size(map_hw: Map) -> Map:
            return np.asarray(cv2.resize(map_hw, size, interpolation=cv2.INTER_NEAREST), np.float32)

        told = (None if each is None else np.isfinite(at_size(each)) for each in (farther_m, nearer_m))
        return self.paint(centimetres_from_depth(at_size(depth_m)), *told)

    def _lay(self, hatch: Hatch, mask: Flags, picture: Picture) -> None:
        key = (hatch, mask.shape)
        if key not in self._pictures:
            self._pictures[key] = hatch.picture(mask.shape[1], mask.shape[0])
        cv2.copyTo(self._pictures[key], mask.view(np.uint8), picture)


def steps_of(shares: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Colour steps of positions on a scale, 0 far .. 1 near; clipped."""
    return np.rint(DARKEST + np.clip(shares, 0, 1) * (BRIGHTEST - DARKEST)).astype(np.uint8)


def coloured(steps: NDArray[np.uint8]) -> Picture:
    """Colours RGB [H, W, 3] of colour steps [H, W]."""
    return np.asarray(cv2.applyColorMap(steps, INFERNO_RGB), np.uint8)
