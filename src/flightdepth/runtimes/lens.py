"""Remaps between a distorted source (OpenCV's polynomial or fisheye models) and the grid's ideal pinhole."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.levels import AnyImage
from flightdepth.runtimes.arrays import Flags, Maps
from flightdepth.runtimes.contract import OUTPUT_STRIDE, STRIDE
from flightdepth.runtimes.sampling import halved, too_small, without_nan

# A pinhole picture grows with the tangent; no network saw more than 45 degrees off the axis at its edges.
WIDEST_RAD = math.radians(60)
# Beyond the calibrated field a polynomial folds back: there, distorting and undistorting does not return.
ROUND_TRIP_PX = 0.5
LATTICE = 257  # rays across and down along which the view's bounds are looked for
# They reach so many times as far as the view would without distortion: a long lens sees few of those up to WIDEST_RAD.
LOOKED_AROUND = 8
BAND_ROWS = 256  # of the source, looked at together: for a whole picture that takes 100 bytes a pixel
PRECISE = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 20, 1e-6)

Points = NDArray[np.float64]
Table = tuple[NDArray[np.integer[Any]], NDArray[np.integer[Any]]]


class LensSampling:
    """Remaps for a source with distortion; see `grid.Sampling`. The tables are computed once per camera."""

    def __init__(self, camera: Camera, focal_px: float) -> None:
        left, right, top, bottom = (bound * focal_px for bound in view_bounds(camera))
        self.extent = right - left, bottom - top
        undistorted_px = focal_px * min(camera.width / camera.fx, camera.height / camera.fy)
        if undistorted_px < OUTPUT_STRIDE:
            raise too_small(undistorted_px)
        width, height = map(padded, self.extent)
        # The view's middle becomes the picture's middle, so padding is shared between both sides.
        cx = (width - 1) / 2 - (left + right) / 2
        cy = (height - 1) / 2 - (top + bottom) / 2
        self.camera = Camera(width, height, focal_px, focal_px, cx, cy)
        cells = self.camera.resized(width // OUTPUT_STRIDE, height // OUTPUT_STRIDE)
        self.valid = in_view(cells.rays()[..., :2], camera)
        self._halvings = max(0, int(math.log2(camera.fx / focal_px / 0.75)))
        self._to_grid = self._grid_table(camera)
        self._to_source, self._unseen = self._source_tables(camera)

    def image(self, image: AnyImage) -> AnyImage:
        """Halve until no more than 1.5 source pixels fall on one of the grid, then undistort by remap."""
        small = halved(image, self._halvings)
        sampled = cv2.remap(small, *self._to_grid, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(sampled, dtype=np.float32)

    def to_source(self, map_hw: Maps, *, nearest: bool) -> Maps:
        """Sample the map where each source pixel looks; NaN where the grid does not look."""
        if nearest:
            return self._sample(map_hw, cv2.INTER_NEAREST) + self._unseen
        filled, unknown = without_nan(map_hw)
        sampled = self._sample(filled, cv2.INTER_LINEAR)
        sampled += self._unseen
        if unknown is not None:
            sampled += self._sample(unknown, cv2.INTER_NEAREST)
        return sampled

    def _sample(self, map_hw: Maps, how: int) -> Maps:
        table = self._to_source[map_hw.shape[0]]
        sampled = cv2.remap(map_hw, *table, how, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(sampled, dtype=np.float32)

    def _grid_table(self, camera: Camera) -> Table:
        pixels = distort(self.camera.rays()[..., :2], camera)
        return fixed_point(((pixels + 0.5) / 2**self._halvings - 0.5).astype(np.float32))

    def _source_tables(self, camera: Camera) -> tuple[dict[int, Table], Maps]:
        """By their height, for maps of the output's size and for ones of the picture's."""
        size, steps = (camera.height, camera.width), (1, OUTPUT_STRIDE)
        tables = {step: (np.empty((*size, 2), np.int16), np.empty(size, np.uint16)) for step in steps}
        unseen = np.empty(size, np.float32)
        folds = not returns(border(camera), camera).all()
        for top in range(0, camera.height, BAND_ROWS):
            band = slice(top, min(top + BAND_ROWS, camera.height))
            columns, rows = np.meshgrid(np.arange(camera.width), np.arange(band.start, band.stop))
            source = np.stack([columns, rows], axis=-1).astype(np.float64)
            pixels = undistort(source, camera) * self.camera.fx + (self.camera.cx, self.camera.cy)
            seen = inside(pixels, self.camera)
            if folds:
                seen &= returns(source, camera)
            unseen[band] = np.where(seen, np.float32(0), np.float32(np.nan))
            for step, (coarse, fine) in tables.items():
                there = np.where(seen[..., None], (pixels + 0.5) / step - 0.5, 0).astype(np.float32)
                coarse[band], fine[band] = fixed_point(there)
        return {self.camera.height // step: table for step, table in tables.items()}, unseen


def fixed_point(points: NDArray[np.float32]) -> Table:
    """OpenCV's fast tables for `cv2.remap`, in 1/32 px, of points [H, W, 2]."""
    coarse, fine = cv2.convertMaps(points[..., 0], points[..., 1], cv2.CV_16SC2)
    return np.asarray(coarse, dtype=np.int16), np.asarray(fine, dtype=np.uint16)


def padded(extent_px: float) -> int:
    """The least multiple of 64 px that holds it."""
    return max(1, math.ceil(extent_px / STRIDE)) * STRIDE


@lru_cache(maxsize=8)
def view_bounds(camera: Camera) -> tuple[float, float, float, float]:
    """Left, right, top, bottom of what the source sees at z = 1, at most 60 degrees off the axis.

    Found by looking along a lattice of rays: undistorting the border instead would fail beyond 90 degrees.
    """
    reach = max(
        *((camera.cx + 0.5) / camera.fx, (camera.width - 0.5 - camera.cx) / camera.fx),
        *((camera.cy + 0.5) / camera.fy, (camera.height - 0.5 - camera.cy) / camera.fy),
    )
    limit = min(math.tan(WIDEST_RAD), LOOKED_AROUND * reach)
    across = np.linspace(-limit, limit, LATTICE)
    x, y = np.meshgrid(across, across)
    rays = np.stack([x, y], axis=-1)
    seen = rays[in_view(rays, camera)]
    if len(seen) < 4:
        raise BadInput(
            "camera distortion", expected="coefficients that can be inverted", got=str(camera.distortion)
        )
    step = 2 * limit / (LATTICE - 1)
    (left, top), (right, bottom) = seen.min(axis=0) - step, seen.max(axis=0) + step
    return float(left), float(right), float(top), float(bottom)


def in_view(rays: Points, camera: Camera) -> Flags:
    """Whether the source sees each ray [..., 2] (x, y at z = 1), rather than folding its model onto it."""
    pixels = distort(rays, camera)
    # NaN, where undistorting does not converge, compares as false: not in view.
    missed_px = np.linalg.norm(undistort(pixels, camera) - rays, axis=-1) * camera.fx
    return np.asarray(inside(pixels, camera) & (missed_px < ROUND_TRIP_PX), dtype=np.bool_)


def returns(pixels: Points, camera: Camera) -> Flags:
    """Whether each source pixel [..., 2] has a ray that falls on it, rather than lying beyond where the model folds."""
    missed_px = np.linalg.norm(distort(undistort(pixels, camera), camera) - pixels, axis=-1)
    return np.asarray(missed_px < ROUND_TRIP_PX, dtype=np.bool_)


def border(camera: Camera) -> Points:
    """A picture's outermost pixels, [N, 2]: if all of them have rays, so has what lies between."""
    rows, columns = np.indices((camera.height, camera.width), sparse=True)
    outer = np.isin(rows, (0, camera.height - 1)) | np.isin(columns, (0, camera.width - 1))
    return np.argwhere(outer)[:, ::-1].astype(np.float64)


def inside(pixels: Points, camera: Camera) -> Flags:
    """Whether each point [..., 2] lies in the picture, whose outermost pixels reach half a pixel further."""
    x, y = pixels[..., 0], pixels[..., 1]
    within = (x > -0.5) & (y > -0.5) & (x < camera.width - 0.5) & (y < camera.height - 0.5)
    return np.asarray(within, dtype=np.bool_)


def distort(rays: Points, camera: Camera) -> Points:
    """Source pixel [..., 2] that each ray [..., 2] (x, y at z = 1) falls on."""
    flat = np.ascontiguousarray(rays.reshape(-1, 1, 2))
    if camera.model == "fisheye":
        pixels = cv2.fisheye.distortPoints(flat, camera.matrix, coefficients(camera))
    elif camera.is_ideal:  # as OpenCV has it, in a fraction of the time
        pixels = flat * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    else:
        points = np.concatenate([flat, np.ones_like(flat[..., :1])], axis=-1)
        still = np.zeros(3)
        pixels, _ = cv2.projectPoints(points, still, still, camera.matrix, coefficients(camera))
    return np.asarray(pixels, dtype=np.float64).reshape(rays.shape)


def undistort(pixels: Points, camera: Camera) -> Points:
    """Ray [..., 2] (x, y at z = 1) of each source pixel [..., 2], by OpenCV's fixed-point iteration."""
    flat = np.ascontiguousarray(pixels.reshape(-1, 1, 2))
    if camera.model == "fisheye":
        rays = cv2.fisheye.undistortPoints(flat, camera.matrix, coefficients(camera))
    else:
        rays = cv2.undistortPointsIter(
            flat, camera.matrix, coefficients(camera), np.eye(3), np.eye(3), PRECISE
        )
    return np.asarray(rays, dtype=np.float64).reshape(pixels.shape)


@lru_cache(maxsize=1)
def pixel_rays(camera: Camera, step: int) -> Points:
    """Directions with z = 1 of every `step`-th pixel of every `step`-th row, [h, w, 3], through the lens.

    Not finite beyond what a lens's calibration reaches.
    """
    columns, rows = np.meshgrid(np.arange(0, camera.width, step), np.arange(0, camera.height, step))
    rays = undistort(np.stack([columns, rows], axis=-1).astype(np.float64), camera)
    return np.concatenate([rays, np.ones((*rays.shape[:2], 1))], axis=-1)


def coefficients(camera: Camera) -> NDArray[np.float64]:
    """OpenCV's coefficients; none given means zeros, which for a fisheye is the equidistant lens."""
    return np.array(camera.distortion or (0.0, 0.0, 0.0, 0.0), dtype=np.float64)
