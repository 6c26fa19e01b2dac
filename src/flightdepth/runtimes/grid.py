"""From any camera to the picture that a network was trained on, and its depth maps back.

A network knows one focal length in pixels. The source is undistorted, scaled until its focal length is that
one, and padded to a multiple of 64 px; maps come back at 1/4 of that size and go to the source's pixels.
"""

from __future__ import annotations

from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.runtimes.lens import LensSampling
from flightdepth.runtimes.sampling import PinholeSampling

NARROW_PX = 256  # below it little is left of the picture; said once, by whoever talks to the user

Interpolation = Literal["bilinear", "nearest"]


class Sampling(Protocol):
    """How pixels go to the grid and maps come back, for one kind of lens."""

    camera: Camera
    valid: NDArray[np.bool_]
    width: int

    def image(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The source picture on the grid."""
        ...

    def to_source(self, map_hw: NDArray[np.float32], *, nearest: bool) -> NDArray[np.float32]:
        """A map of the output grid at the source's pixels."""
        ...


class NetworkGrid:
    """A source camera and the network's view of it.

    source  the camera that was given
    camera  the pinhole of the network's picture, whose sizes are multiples of 64; its focal length is
            `focal_px` but for rounding to whole pixels, well under 1 % for a picture of some size
    valid   [h, w] bool at 1/4 of that size: inside the source's view, not padding
    """

    def __init__(self, camera: Camera, focal_px: float) -> None:
        self.source = camera
        self.focal_px = focal_px
        ideal = camera.model == "pinhole" and not any(camera.distortion)
        self._sampling: Sampling = (PinholeSampling if ideal else LensSampling)(camera, focal_px)
        self.camera = self._sampling.camera
        self.valid = self._sampling.valid

    def image(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The picture uint8 [H, W, 3] of the source on the grid; the same array where nothing changes."""
        check_image("image", image, self.source)
        return self._sampling.image(image)

    def to_source(
        self, map_hw: NDArray[np.float32], interpolation: Interpolation = "bilinear"
    ) -> NDArray[np.float32]:
        """A map float32 [h, w] of the output grid at the source's pixels and lens, float32 [H, W].

        NaN stays where it is nearest: a NaN neighbour has no part in a bilinear value and does not spread.
        NaN also where the source sees what the grid does not (beyond 60 degrees off the axis of a wide lens).
        """
        if map_hw.shape != self.valid.shape:
            raise ValueError(f"expected a map {self.valid.shape}, got {map_hw.shape}")
        return self._sampling.to_source(
            np.asarray(map_hw, dtype=np.float32), nearest=interpolation == "nearest"
        )

    @property
    def warning(self) -> str | None:
        """One line for the user where the grid's picture is so narrow that the result will be poor."""
        if self._sampling.width >= NARROW_PX:
            return None
        return (
            f"the network sees only {self._sampling.width} px across ({self.source.width}x"
            f"{self.source.height} at focal length {self.source.fx:.0f} px, scaled to "
            f"{self.focal_px:.0f} px): expect coarse depth; "
            "a network trained at a longer focal length would do better"
        )


def check_image(what: str, image: NDArray[np.uint8], camera: Camera) -> None:
    """Refuse what is not a uint8 RGB picture of the camera's size."""
    expected = (camera.height, camera.width, 3)
    if not isinstance(image, np.ndarray) or image.dtype != np.uint8 or image.shape != expected:
        got = f"{image.dtype} {list(image.shape)}" if isinstance(image, np.ndarray) else type(image).__name__
        raise BadInput(what, expected=f"uint8 RGB {list(expected)}, the camera's size", got=got)
