"""Scaling between an ideal pinhole source and the grid: plain resizes, chosen so that none moves a pixel.

The grid's picture is a whole number of output cells (4 px), and the part of the source that becomes it a
whole number of source pixels, so `cv2.resize`, which maps edge to edge, is exact both ways and 10 times as
fast as a remap.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.levels import AnyImage, Levels
from flightdepth.runtimes.arrays import Flags, Maps
from flightdepth.runtimes.contract import OUTPUT_STRIDE, STRIDE

# A source of 64 px multiples whose focal length is this near passes untouched: so does a grid's own camera.
NEAR_ENOUGH = 0.01
WHOLE = 1 - 1e-4  # but for rounding
MOST_PX = 16384  # of a side of the grid, before it would take all memory


@dataclass(frozen=True)
class Axis:
    """How one axis of the source lies on the grid, in pixels.

    `used` source pixels from `start` on become `inner` grid pixels from `pad` on, out of `size`; all of the source
    would become `extent`.
    """

    start: int
    used: int
    inner: int
    pad: int
    size: int
    halvings: int
    extent: float

    @classmethod
    def fit(cls, source: int, scale: float) -> Axis:
        """Lay `source` pixels out at about `scale`: at most 3 grid px are cut off to reach a whole cell."""
        if source % STRIDE == 0 and abs(scale - 1) < NEAR_ENOUGH:
            return cls(0, source, source, 0, source, 0, source * scale)
        if source * scale > MOST_PX:
            raise BadInput(
                "camera",
                expected=f"a view of at most {MOST_PX} px at the network's focal length",
                got=f"{source * scale:.0f} px",
                mend="Is its focal length in pixels, its field of view in degrees?",
            )
        inner = int(source * scale + 0.5) // OUTPUT_STRIDE * OUTPUT_STRIDE
        if inner == 0:
            raise too_small(source * scale)
        halvings = max(0, int(math.log2(1 / scale)))
        step = 2**halvings
        used = min(round(inner / scale / step), source // step) * step
        size = math.ceil(inner / STRIDE) * STRIDE
        pad = (size - inner) // 2 // OUTPUT_STRIDE * OUTPUT_STRIDE
        return cls((source - used) // 2, used, inner, pad, size, halvings, source * scale)

    @property
    def whole(self) -> bool:
        """Whether the axis passes through unchanged."""
        return (self.start, self.pad) == (0, 0) and self.used == self.inner == self.size

    def shown(self, length: int) -> slice:
        """What shows the source of a map with `length` pixels for this axis, one or a quarter of one for each."""
        step = self.size // length
        return slice(self.pad // step, (self.pad + self.inner) // step)

    @property
    def pixels(self) -> slice:
        """The source pixels in use."""
        return slice(self.start, self.start + self.used)


def too_small(extent_px: float) -> BadInput:
    """The refusal of a camera that shows no more than so many pixels across or down at the network's focal length."""
    return BadInput(
        "camera",
        expected=f"a view of at least {OUTPUT_STRIDE} px at the network's focal length",
        got=f"{extent_px:.1f} px",
        mend="Is its focal length in pixels, its field of view in degrees?",
    )


def pinhole_axes(camera: Camera, focal_px: float | None) -> tuple[Axis, Axis]:
    """How both axes of a camera lie on its grid; `focal_px` None leaves them as they are."""
    scale_x, scale_y = (focal_px / camera.fx, focal_px / camera.fy) if focal_px else (1.0, 1.0)
    return Axis.fit(camera.width, scale_x), Axis.fit(camera.height, scale_y)


class PinholeSampling:
    """Resizes for a source without distortion; see `grid.Sampling`. `focal_px` None leaves it as it is."""

    def __init__(self, camera: Camera, focal_px: float | None) -> None:
        self._source = camera
        self._x, self._y = x, y = pinhole_axes(camera, focal_px)
        self.extent = x.extent, y.extent
        self._same = x.whole and y.whole
        used = camera.without_distortion().cropped(x.start, y.start, x.used, y.used)
        padded = used.resized(x.inner, y.inner).cropped(-x.pad, -y.pad, x.size, y.size)
        self.camera = camera.without_distortion() if self._same else padded
        self.valid = np.zeros((y.size // OUTPUT_STRIDE, x.size // OUTPUT_STRIDE), dtype=np.bool_)
        self.valid[y.shown(y.size // OUTPUT_STRIDE), x.shown(x.size // OUTPUT_STRIDE)] = True

    def image(self, image: AnyImage) -> AnyImage:
        """Crop to the pixels in use, shrink without aliasing, pad with the border's pixels."""
        x, y = self._x, self._y
        if self._same:
            return image
        inner = shrink(image[y.pixels, x.pixels], x.inner, y.inner, min(x.halvings, y.halvings))
        right, bottom = x.size - x.inner - x.pad, y.size - y.inner - y.pad
        padded = cv2.copyMakeBorder(inner, y.pad, bottom, x.pad, right, cv2.BORDER_REPLICATE)
        return np.asarray(padded, dtype=np.float32)

    def to_source(self, map_hw: Maps, *, nearest: bool) -> Maps:
        """Enlarge what shows the source, then repeat the outermost pixels into what was cut off."""
        x, y = self._x, self._y
        whole = np.empty((self._source.height, self._source.width), dtype=np.float32)
        shown = map_hw[y.shown(map_hw.shape[0]), x.shown(map_hw.shape[1])]
        enlarge(np.ascontiguousarray(shown), whole[y.pixels, x.pixels], nearest=nearest)
        whole[: y.start] = whole[y.start]
        whole[y.start + y.used :] = whole[y.start + y.used - 1]
        whole[:, : x.start] = whole[:, x.start, None]
        whole[:, x.start + x.used :] = whole[:, x.start + x.used - 1, None]
        return whole


def shrink(image: AnyImage, width: int, height: int, halvings: int) -> AnyImage:
    """Resize [H, W, 3] without aliasing, to float32: exact 2x2 means first (fast), then area means for the rest."""
    image = halved(image, halvings)
    shrinks = image.shape[1] > width or image.shape[0] > height
    how = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(image, (width, height), interpolation=how), dtype=np.float32)


def shown_at(shown: Flags, width: int, height: int) -> Flags:
    """Which pixels of a resized picture show the scene, of `shown` [H, W]: those that all of what they hold does."""
    share = cv2.resize(shown.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(share > WHOLE)


def halved(image: AnyImage, times: int) -> Levels:
    """Means over 2x2 pixels of [H, W, 3], so many times over; an odd last row or column is left out.

    All but the last are rounded to whole levels where they were: in float32 large pictures would take several times as
    long.
    """
    for left in range(times, 0, -1):
        height, width = image.shape[0] // 2, image.shape[1] // 2
        image = image.astype(np.float32, copy=False) if left == 1 else image
        even = image[: 2 * height, : 2 * width]
        image = np.asarray(cv2.resize(even, (width, height), interpolation=cv2.INTER_AREA), dtype=image.dtype)
    return image.astype(np.float32, copy=False)


def enlarge(map_hw: Maps, target: Maps, *, nearest: bool) -> None:
    """Resize a map into `target` (a view will do); NaN exactly where the nearest cell is NaN."""
    size = (target.shape[1], target.shape[0])
    if nearest:
        cv2.resize(map_hw, size, dst=target, interpolation=cv2.INTER_NEAREST_EXACT)
        return
    filled, unknown = without_nan(map_hw)
    cv2.resize(filled, size, dst=target, interpolation=cv2.INTER_LINEAR)
    if unknown is not None:
        target += cv2.resize(unknown, size, interpolation=cv2.INTER_NEAREST_EXACT)


def without_nan(map_hw: Maps) -> tuple[Maps, Maps | None]:
    """The map with each NaN replaced by the mean of its known neighbours, and what to add for them: 0, or NaN.

    Bilinear sampling looks one cell far, so one step of filling keeps NaN out of its neighbours.
    """
    known = ~np.isnan(map_hw)
    if known.all():
        return map_hw, None
    window = (3, 3)
    weight = cv2.boxFilter(known.astype(np.float32), -1, window, normalize=False)
    total = cv2.boxFilter(np.where(known, map_hw, np.float32(0)), -1, window, normalize=False)
    filled = np.where(known, map_hw, total / np.maximum(weight, np.float32(1)))
    return filled.astype(np.float32), np.where(known, np.float32(0), np.float32(np.nan))
