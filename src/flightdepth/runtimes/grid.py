"""From any camera to the picture that a network was trained on, and its depth maps back.

A network knows one focal length in pixels. The source is undistorted, scaled until its focal length is that
one, and padded to a multiple of 64 px; maps come back at 1/4 of that size and go to the source's pixels.
"""

from __future__ import annotations

from copy import copy
from functools import cached_property
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.levels import AnyImage
from flightdepth.runtimes.arrays import Flags, Maps
from flightdepth.runtimes.edges import Blocks, EdgeSampling
from flightdepth.runtimes.lens import LensSampling, padded, view_bounds
from flightdepth.runtimes.sampling import WHOLE, PinholeSampling, pinhole_axes, shown_at

HAIR_LESS = 1 - 1e-6  # than full, so that rounding asks for no further 64 px
NARROW_PX = 256  # below it little is left of the picture; said once, by whoever talks to the user

Interpolation = Literal["bilinear", "nearest"]


class Sampling(Protocol):
    """How pixels go to the grid and maps come back, for one kind of lens."""

    camera: Camera
    valid: Flags
    extent: tuple[float, float]  # width and height of what the source shows, in pixels of the grid

    def image(self, image: AnyImage) -> AnyImage:
        """The source picture on the grid."""

    def to_source(self, map_hw: Maps, *, nearest: bool) -> Maps:
        """A map of the output grid, or of the picture's pixels, at the source's pixels."""


class NetworkGrid:
    """A source camera and the network's view of it.

    source  the camera that was given
    camera  the pinhole of the network's picture, whose sizes are multiples of 64; its focal length is
            `focal_px` but for rounding to whole pixels, well under 1 % for a picture of some size
    valid   [h, w] bool at 1/4 of that size: inside the source's view, not padding, not masked
    """

    def __init__(self, camera: Camera, focal_px: float | None, *, resampled: bool = False) -> None:
        """`focal_px` None: `camera` is a grid's, and nothing moves, whatever rounding did to its focal lengths.

        `resampled`: its pictures are what another grid made, float32 perhaps; so are those of a grid's own camera.
        """
        self.source, self.focal_px = camera, focal_px or camera.fx
        self._sampling: Sampling = (
            PinholeSampling(camera, focal_px) if camera.is_ideal else LensSampling(camera, self.focal_px)
        )
        self.camera = self._sampling.camera
        self._resampled = resampled or self.camera == camera
        self.valid = self._sampling.valid
        self._shown: Flags | None = None

    def masked(self, shown: Flags) -> NetworkGrid:
        """The same of a source whose pixels show the scene only where `shown` [H, W]; maps are NaN elsewhere."""
        seen = self._sampling.image(np.where(shown, np.uint8(255), np.uint8(0))) > 255 * WHOLE
        masked = copy(self)
        masked._shown = shown
        masked.valid = self.valid & shown_at(seen, self.valid.shape[1], self.valid.shape[0])
        if not masked.valid.any():
            raise BadInput("mask", expected="white where the network sees the scene", got="black all over")
        masked.blocks = Blocks(masked.valid)
        return masked

    def image(self, image: AnyImage) -> AnyImage:
        """The picture uint8 [H, W, 3] of the source on the grid, float32; the same array where nothing changes."""
        self.check("image", image)
        return self._sampling.image(image)

    def check(self, what: str, image: AnyImage) -> None:
        """Refuse what is not a picture of the source."""
        check_image(what, image, self.source, resampled=self._resampled)

    def to_source(self, map_hw: Maps, interpolation: Interpolation = "bilinear") -> Maps:
        """A map float32 of the output grid [h, w], or of its picture [4 h, 4 w], at the source's pixels, [H, W].

        NaN stays where it is nearest: a NaN neighbour has no part in a bilinear value and does not spread.
        NaN also where the source sees what the grid does not (beyond 60 degrees off the axis of a wide lens), and where
        it is masked.
        """
        if map_hw.shape not in (self.valid.shape, (self.camera.height, self.camera.width)):
            raise ValueError(f"expected a map {self.valid.shape}, or four times as large, got {map_hw.shape}")
        at_source = self._sampling.to_source(
            np.asarray(map_hw, dtype=np.float32), nearest=interpolation == "nearest"
        )
        if self._shown is not None:
            np.copyto(at_source, np.float32(np.nan), where=~self._shown)
        return at_source

    @cached_property
    def blocks(self) -> Blocks:
        """What maps of its output have in common, for `along_edges`."""
        return Blocks(self.valid)

    def along_edges(self, depth_m: Maps, picture: AnyImage) -> EdgeSampling:
        """A depth [h, w] in metres, NaN = unknown, and what belongs to it at the source's pixels, with edges where
        `picture` has them, the source's on the grid (`image`).
        """
        return EdgeSampling(self, depth_m, picture)

    @property
    def warning(self) -> str | None:
        """One line for the user where the grid's picture is so narrow that the result will be poor."""
        if round(self._sampling.extent[0]) >= NARROW_PX:
            return None
        return (
            f"the network sees only {self._sampling.extent[0]:.0f} px across ({self.source.width}x"
            f"{self.source.height} at focal length {self.source.fx:.0f} px, scaled to "
            f"{self.focal_px:.0f} px): expect coarse depth"
        )


def filling_focal_px(camera: Camera, focal_px: float) -> float:
    """The focal length at which `camera` fills the grid that it has at `focal_px`: finer, at the same price."""
    if camera.is_ideal:
        rooms = [axis.size / axis.extent for axis in pinhole_axes(camera, focal_px)]
    else:
        rooms = [padded(side * focal_px) / (side * focal_px) for side in shown(camera)]
    return focal_px * max(1.0, min(rooms) * HAIR_LESS)


def wide_focal_px(camera: Camera, across_px: float) -> float:
    """The focal length at which the longer side of what `camera` shows is that many pixels."""
    return across_px / max(shown(camera))


def shown(camera: Camera) -> tuple[float, float]:
    """Width and height of what a camera shows, over its focal length."""
    if camera.is_ideal:
        return camera.width / camera.fx, camera.height / camera.fy
    left, right, top, bottom = view_bounds(camera)
    return right - left, bottom - top


def check_image(what: str, image: AnyImage, camera: Camera, *, resampled: bool = False) -> None:
    """Refuse what is not a uint8 RGB picture of the camera's size; float32 will do where it is `resampled`."""
    expected, types = (camera.height, camera.width, 3), (np.uint8, np.float32)[: 1 + resampled]
    if not isinstance(image, np.ndarray) or image.dtype not in types or image.shape != expected:
        raise BadInput(what, expected=f"uint8 RGB {list(expected)}, the camera's size", got=_kind(image))


def check_mask(mask: NDArray[np.uint8] | Flags, camera: Camera) -> Flags:
    """Where a mask uint8 or bool [H, W] of the camera's size is not 0: there the source shows the scene."""
    expected = (camera.height, camera.width)
    if not isinstance(mask, np.ndarray) or mask.dtype not in (np.uint8, np.bool_) or mask.shape != expected:
        raise BadInput("mask", expected=f"uint8 or bool {list(expected)}, the camera's size", got=_kind(mask))
    return np.asarray(mask != 0)


def _kind(given: object) -> str:
    """For people: type and shape of what should be an array."""
    return f"{given.dtype} {list(given.shape)}" if isinstance(given, np.ndarray) else type(given).__name__
