"""Pictures and maps as an ideal lens would have filmed them, for programs that know no other."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.outputs.encoding import Map
from flightdepth.outputs.palette import Picture
from flightdepth.runtimes.lens import BAND_ROWS, WIDEST_RAD, Table, distort, fixed_point, in_view

LONGEST = 64.0  # times the lens's own focal length
HALVINGS = 24  # of the span of focal lengths that is searched
LATTICE = 33  # rays across and down that must all be in view

Pixels = TypeVar("Pixels", Picture, Map)


@lru_cache(maxsize=8)
def ideal_view(camera: Camera) -> Camera:
    """The widest ideal lens, of the same size and axis, whose whole picture the camera saw; of an ideal one itself.

    The axis of any other stands in the picture's middle, since not all programs know a principal point. It sees no
    farther than 60 degrees to each side, as networks do.
    """
    if camera.is_ideal:
        return camera.without_distortion()
    reach = max(camera.width / camera.fx, camera.height / camera.fy) / 2
    shortest, longest = reach / math.tan(WIDEST_RAD), LONGEST
    if not all_in_view(centred(camera, longest), camera):
        raise BadInput(
            "camera",
            expected="a lens that sees what lies on its axis",
            got=f"{camera.cx:.1f}, {camera.cy:.1f} px",
        )
    if all_in_view(centred(camera, shortest), camera):
        return centred(camera, shortest)
    for _ in range(HALVINGS):
        middle = math.sqrt(shortest * longest)
        if all_in_view(centred(camera, middle), camera):
            longest = middle
        else:
            shortest = middle
    return centred(camera, longest)


def centred(camera: Camera, times: float) -> Camera:
    """An ideal lens of the same size, its axis in the middle, of so many times the focal length."""
    middle = (camera.width - 1) / 2, (camera.height - 1) / 2
    return Camera(camera.width, camera.height, camera.fx * times, camera.fy * times, *middle)


def all_in_view(ideal: Camera, camera: Camera) -> bool:
    """Whether a camera saw all that an ideal one sees."""
    across, down = (np.linspace(0, side - 1, LATTICE) for side in (ideal.width, ideal.height))
    x, y = np.meshgrid((across - ideal.cx) / ideal.fx, (down - ideal.cy) / ideal.fy)
    return bool(in_view(np.stack([x, y], axis=-1), camera).all())


def picture_through(ideal: Camera, picture: Picture, camera: Camera) -> Picture:
    """A picture [h, w, 3] of `camera`, whatever its size, as `ideal` sees it, [H, W, 3]."""
    height, width = picture.shape[:2]
    return _remapped(picture, _table(ideal, camera.resized(width, height)), cv2.INTER_LINEAR)


def map_through(ideal: Camera, map_hw: Map, camera: Camera) -> Map:
    """A map of `camera` as `ideal` sees it, [H, W]: of each pixel the nearest value, none of two mixed.

    Depth stays as it is, since both have the same axis.
    """
    return _remapped(map_hw, _table(ideal, camera), cv2.INTER_NEAREST)


def _remapped(pixels: Pixels, table: Table | None, how: int) -> Pixels:
    if table is None:
        return pixels
    found: NDArray[np.generic] = np.asarray(cv2.remap(pixels, *table, how, borderMode=cv2.BORDER_REPLICATE))
    return found.astype(pixels.dtype, copy=False)


@lru_cache(maxsize=2)  # of pictures and of maps; of 4K one takes 50 MB
def _table(ideal: Camera, camera: Camera) -> Table | None:
    """Where each pixel of an ideal camera lies in the picture of another; None where that is itself."""
    if camera.is_ideal and camera.without_distortion() == ideal:
        return None
    size, (x, y) = (ideal.height, ideal.width), ideal.ray_axes()
    coarse, fine = np.empty((*size, 2), np.int16), np.empty(size, np.uint16)
    for top in range(0, ideal.height, BAND_ROWS):
        band = slice(top, top + BAND_ROWS)
        rays = np.stack(np.broadcast_arrays(x, y[band]), axis=-1)
        coarse[band], fine[band] = fixed_point(distort(rays, camera).astype(np.float32))
    return coarse, fine
