"""Photographs with EXIF tags: the TIFF block by hand, the JPEG through OpenCV."""

import struct
from pathlib import Path

import cv2
import numpy as np


def entry(tag, kind, count, value):
    return struct.pack("<HHL", tag, kind, count) + value


def exif(equivalent_mm, model=b"FC7303\0"):
    """Model and FocalLengthIn35mmFilm, little-endian; None leaves the focal length out."""
    count = 1 if equivalent_mm is None else 2
    start = 8 + 2 + 12 * count + 4
    entries = [entry(0x110, 2, len(model), struct.pack("<L", start))]
    after = model + bytes(len(model) % 2)
    if equivalent_mm is not None:
        entries.append(entry(0x8769, 4, 1, struct.pack("<L", start + len(after))))
        after += struct.pack("<H", 1) + entry(0xA405, 3, 1, struct.pack("<HH", equivalent_mm, 0)) + bytes(4)
    return b"II*\0" + struct.pack("<LH", 8, count) + b"".join(entries) + bytes(4) + after


def photograph(path: Path, equivalent_mm=24, size=(192, 108)) -> Path:
    image = np.zeros((size[1], size[0], 3), np.uint8)
    block = np.frombuffer(exif(equivalent_mm), np.uint8)
    assert cv2.imwriteWithMetadata(str(path), image, [cv2.IMAGE_METADATA_EXIF], [block])
    return path
