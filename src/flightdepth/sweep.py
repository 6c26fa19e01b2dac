"""Plane sweep: the earlier picture as it would look if all the scene stood at one depth, for several depths.

A camera that moved by `displacement` without turning saw a point at depth Z, now on the ray (x, y, 1), on the
ray (x + delta d_x, y + delta d_y) / (1 + delta d_z), with delta = |displacement| / Z and d the direction of
the displacement. Where all has one delta the earlier picture is the present one scaled and shifted: an affine
warp. Hypotheses are numbered by focal * delta, the shift in pixels that a point would make if it moved
sideways: then neither the length of the displacement nor the focal length need be known to compare pictures.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from flightdepth.camera import Camera
from flightdepth.levels import AnyImage, Image, exact_grey, grey, rounded

Field = NDArray[np.float32]


@dataclass(frozen=True)
class Level:
    """Hypotheses that are compared on pictures 1 / `scale` of the full size; shifts in full pixels."""

    scale: int
    shifts_px: tuple[float, ...]


# Fine steps near zero, where far things differ by a part of a pixel; coarse ones on smaller pictures.
LEVELS = (
    Level(1, (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0)),
    Level(2, (0.0, 2.0, 4.0, 6.0, 8.0, 10.0)),
    Level(4, (6.0, 9.0, 12.0, 16.0, 20.0, 25.0, 32.0)),
)
FIELD_SCALE = 4


@dataclass(frozen=True)
class Sweep:
    """One pair, ready for a network that knows the motion.

    current   uint8 [H, W, 3] RGB
    swept     per level, uint8 [hypotheses, H / scale, W / scale]: grey of the earlier picture, warped; where
              that lies outside the earlier picture, the grey of the current one
    field     float32 [2, H / 4, W / 4]: (d_x - x d_z, d_y - y d_z), where a pixel goes and how fast, as a share
              of the shift that a hypothesis is numbered by; 0 at the focus of expansion
    """

    current: Image
    swept: tuple[Image, ...]
    field: Field


def sweep(previous: AnyImage, current: AnyImage, displacement: ArrayLike, camera: Camera) -> Sweep:
    """Sweep `previous` along `displacement` (3,); pictures RGB [H, W, 3], sides multiples of 4.

    Only the direction counts; displacement 0 sweeps nothing. Levels are rounded, as networks learnt them: of bytes at
    each step, of float32 once, at the end.
    """
    direction = unit_direction(displacement)
    of_bytes = previous.dtype == current.dtype == np.uint8
    before, now = (grey(each) if of_bytes else exact_grey(each) for each in (previous, current))
    swept = tuple(rounded(_swept(before, now, direction, camera, level)) for level in LEVELS)
    return Sweep(rounded(current), swept, motion_field(direction, camera))


def stacked(sweeps: Iterable[Sweep]) -> tuple[NDArray[Any], ...]:
    """Of n pairs current [n, H, W, 3], each level's `swept` [n, hypotheses, h, w], field [n, 2, H / 4, W / 4]."""
    columns = zip(*((each.current, *each.swept, each.field) for each in sweeps), strict=True)
    return tuple(np.stack(column) for column in columns)


def unit_direction(displacement: ArrayLike) -> NDArray[np.float64]:
    """Direction of a displacement, shape (3,); zeros where it has none."""
    vector = np.asarray(displacement, dtype=np.float64)
    length = float(np.linalg.norm(vector))
    return vector / length if length > 0 else np.zeros(3)


def motion_field(direction: ArrayLike, camera: Camera) -> Field:
    """(d_x - x d_z, d_y - y d_z) at a quarter of the camera's size, float32 [2, H / 4, W / 4]."""
    dx, dy, dz = np.asarray(direction, dtype=np.float64)
    small = camera.resized(camera.width // FIELD_SCALE, camera.height // FIELD_SCALE)
    field = np.empty((2, small.height, small.width), np.float32)
    x, y = small.ray_axes()
    field[0], field[1] = dx - x * dz, dy - y * dz
    return field


def warp_matrix(shift_px: float, direction: NDArray[np.float64], camera: Camera) -> NDArray[np.float64]:
    """Affine matrix [2, 3] from pixels of the present picture to those of the earlier one.

    `shift_px` = fx * delta, in pixels of `camera`, whose fx it is.
    """
    dx, dy, dz = direction
    delta = shift_px / camera.fx
    scale = 1 / (1 + delta * dz)
    x = camera.cx + scale * (delta * dx * camera.fx - camera.cx)
    y = camera.cy + scale * (delta * dy * camera.fy - camera.cy)
    return np.array([[scale, 0.0, x], [0.0, scale, y]])


def _swept(
    previous: AnyImage, current: AnyImage, direction: NDArray[np.float64], camera: Camera, level: Level
) -> AnyImage:
    """Grey pictures [H, W] to one level's warped ones."""
    size = (camera.width // level.scale, camera.height // level.scale)
    if level.scale > 1:
        previous = np.asarray(cv2.resize(previous, size, interpolation=cv2.INTER_AREA), previous.dtype)
        current = np.asarray(cv2.resize(current, size, interpolation=cv2.INTER_AREA), current.dtype)
    small = camera.resized(*size)
    swept = np.empty((len(level.shifts_px), *current.shape), current.dtype)
    swept[:] = current
    for shift_px, out in zip(level.shifts_px, swept, strict=True):
        if shift_px == 0:
            out[:] = previous
            continue
        matrix = warp_matrix(shift_px / level.scale, direction, small)
        how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        cv2.warpAffine(previous, matrix, size, out, how, cv2.BORDER_TRANSPARENT)
    return swept
