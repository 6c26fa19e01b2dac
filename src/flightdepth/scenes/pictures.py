"""Pictures read from files, whole or not at all."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.levels import picture_in

Image = NDArray[np.uint8]

JPEG_START, JPEG_END = b"\xff\xd8\xff", b"\xd9"
# Neither a byte 0xff of the picture's own, which a zero follows, nor a mark to restart at; neither has a segment.
JPEG_MARKER = re.compile(rb"\xff([\x02-\xcf\xd8-\xfe])")


def read_picture(path: Path) -> Image | None:
    """A picture of 8 bits, uint8 RGB [H, W, 3]; None where there is none that OpenCV can read to its end."""
    try:
        # OpenCV on Windows opens no file whose name holds other than its own letters.
        data = path.read_bytes()
    except OSError:
        return None
    bgr = picture_in(data, cv2.IMREAD_COLOR)
    if bgr is None or not is_whole(data):
        return None
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), dtype=np.uint8)


def is_whole(data: bytes) -> bool:
    """False for the beginning of a JPEG file, whose rest OpenCV makes grey; it refuses that of other files itself.

    From marker to marker (ITU-T T.81, B.1.1), as a preview in the head has an end of its own, and a camera may write
    more behind the picture's.
    """
    if not data.startswith(JPEG_START):
        return True
    place = len(b"\xff\xd8")
    while found := JPEG_MARKER.search(data, place):
        if found[1] == JPEG_END:
            return True
        place = found.end() + int.from_bytes(data[found.end() : found.end() + 2])
    return False
