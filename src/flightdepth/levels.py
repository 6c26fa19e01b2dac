"""Pictures and their levels, 0 to 255.

Of what is far, a part of a level is all that moves between two pictures. So what resamples a picture of bytes, or makes
it brighter, gives float32, which is rounded once: where a network or a search for corners takes it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.errors import FlightDepthError

# RGB [H, W, 3] or grey [H, W].
Image = NDArray[np.uint8]
Levels = NDArray[np.float32]
AnyImage = NDArray[Any]  # of either kind

GREY = (0.299, 0.587, 0.114)  # shares of red, green and blue (ITU-R BT.601), as cv2.COLOR_RGB2GRAY
PARTS = 256  # of a level, in a packed picture


def picture_in(data: bytes | NDArray[np.uint8], flags: int) -> NDArray[Any] | None:
    """The picture of a file's bytes as `cv2.imdecode` gives it (BGR); None where it reads none, or refuses its size."""
    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), flags) if len(data) else None
    except cv2.error:
        return None


def rgb(decoded: Any) -> Image:
    """RGB [H, W, 3] of a video's decoded picture, on one thread.

    PyAV sets up a converter for each picture, and the threads that it takes by default wait for cores that a network
    keeps busy.
    """
    return np.asarray(decoded.reformat(format="rgb24", threads=1).to_ndarray(), np.uint8)


def picture_file(kind: str, image: AnyImage, settings: Sequence[int]) -> bytes:
    """A picture as `cv2.imencode` writes it (BGR or one channel); `kind` is the ending of such files."""
    done, data = cv2.imencode(kind, image, settings)
    if not done:
        raise FlightDepthError(f"could not encode a {image.shape[1]}x{image.shape[0]} picture as {kind}")
    return data.tobytes()


def jpeg(picture: Image, quality: int) -> bytes:
    """JPEG of RGB [H, W, 3], quality 0..100."""
    return picture_file(".jpg", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), (cv2.IMWRITE_JPEG_QUALITY, quality))


def grey(image: AnyImage) -> Image:
    """RGB [H, W, 3] as [H, W]."""
    return rounded(np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), image.dtype))


def exact_grey(image: AnyImage) -> Levels:
    """RGB [H, W, 3] as [H, W], not rounded."""
    return np.asarray(cv2.cvtColor(image.astype(np.float32, copy=False), cv2.COLOR_RGB2GRAY), np.float32)


def rounded(image: AnyImage) -> Image:
    """Of any shape, as bytes; bytes as they are."""
    return np.asarray(np.rint(np.clip(image, 0, 255)) if image.dtype != np.uint8 else image, np.uint8)


def packed(image: AnyImage) -> AnyImage:
    """Of any shape, to be kept: float32 as uint16, 256 to a level, in half the memory; bytes as they are."""
    return (
        image if image.dtype == np.uint8 else (image * np.float32(PARTS) + np.float32(0.5)).astype(np.uint16)
    )


def unpacked(image: AnyImage) -> AnyImage:
    """What was packed, to within 1/512 of a level."""
    return image if image.dtype == np.uint8 else image * np.float32(1 / PARTS)


def within_levels(image: AnyImage) -> AnyImage:
    """Of any shape; what lies beyond black or white is black or white."""
    return np.clip(image, 0, 255)
