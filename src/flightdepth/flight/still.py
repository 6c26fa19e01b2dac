"""One picture file, decoded by FFmpeg. One that was cut off is none.

Trash within a PNG is found, by its checksums; within a JPEG often, within others seldom: they have none.
"""

from __future__ import annotations

import re
import struct
from typing import Any

import av
from av.error import FFmpegError

from flightdepth.flight.display_matrix import Turn

SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".ppm", ".pgm"})
JPEG = "mjpeg"
# FFmpeg's decoder by the first bytes: names lie now and then, and a text that a name calls a picture is none.
DECODERS = {
    re.compile(rb"\x89PNG\r\n\x1a\n"): "png",
    re.compile(rb"\xff\xd8\xff"): JPEG,
    re.compile(rb"BM"): "bmp",
    re.compile(rb"II\*\0|MM\0\*"): "tiff",
    re.compile(rb"RIFF....WEBP", re.DOTALL): "webp",
    re.compile(rb"P[2356]\s"): "ppm",
}
# What a JPEG lacks FFmpeg by itself fills with grey, and says nothing. Of a TIFF it would refuse tags unknown to it.
STRICT = {"err_detect": "explode"}
START_OF_SCAN, END_OF_IMAGE = b"\xda", b"\xff\xd9"
# EXIF is a TIFF: in JPEG's APP1, in PNG's eXIf, or the whole file.
EXIF = re.compile(rb"(?:^|Exif\0\0|eXIf)(?=II\*\0|MM\0\*)")
EXIF_WITHIN = 1 << 16  # before the picture itself, which takes long to search
ORIENTATION = 0x0112
EQUIVALENT = "focallengthin35mmfilm"  # FFmpeg's name of a tag, in small letters
# As the first row and the first column of what is stored are to be shown (EXIF 2.3, 4.6.4 A): 1 is upright.
TURNS = {
    2: Turn(0, mirrored=True),
    3: Turn(2, mirrored=False),
    4: Turn(2, mirrored=True),
    5: Turn(1, mirrored=True),
    6: Turn(3, mirrored=False),
    7: Turn(3, mirrored=True),
    8: Turn(1, mirrored=False),
}


def decoded(data: bytes) -> Any | None:
    """The picture of a file's bytes, as PyAV gives it; None where they are no picture, or not all of one."""
    name = next((name for magic, name in DECODERS.items() if magic.match(data)), None)
    if name is None or (name == JPEG and _is_cut_off(data)):
        return None
    decoder: Any = av.CodecContext.create(name, "r")
    decoder.options = STRICT if name == JPEG else {}
    decoder.thread_count = 1  # one picture gives no work to more
    try:
        return next(iter([*decoder.decode(av.Packet(data)), *decoder.decode(None)]), None)
    except FFmpegError:
        return None


def exif_tags(picture: Any) -> dict[str, str]:
    """What EXIF says of a decoded picture, by FFmpeg's names in small letters."""
    return {name.rpartition("/")[2].lower(): value.strip() for name, value in picture.metadata.items()}


def _is_cut_off(jpeg: bytes) -> bool:
    """Whether no end follows the picture's own scan: a thumbnail before it has another, and so has what may follow."""
    at = 2
    while jpeg[at : at + 1] == b"\xff":
        marker = jpeg[at + 1 : at + 2]
        if marker == START_OF_SCAN:
            return jpeg.find(END_OF_IMAGE, at) < 0
        at += 1 if marker == b"\xff" else 2 + int.from_bytes(jpeg[at + 2 : at + 4], "big")
    return False  # nor can it be decoded


def turn_in(data: bytes) -> Turn:
    """What makes the picture of a file's bytes stand upright, by its EXIF tags.

    PyAV 18 cannot read the matrix of a decoded picture that has EXIF tags.
    """
    upright = Turn(0, mirrored=False)
    found = EXIF.search(data, 0, EXIF_WITHIN)
    if found is None:
        return upright
    tiff = memoryview(data)[found.end() :]
    order = "<" if data[found.end()] == ord("I") else ">"
    try:
        (start,) = struct.unpack_from(f"{order}I", tiff, 4)
        (count,) = struct.unpack_from(f"{order}H", tiff, start)
        for entry in range(count):
            tag, _, _, value = struct.unpack_from(f"{order}HHIH", tiff, start + 2 + 12 * entry)
            if tag == ORIENTATION:
                return TURNS.get(value, upright)
    except struct.error:  # tags that are cut off
        pass
    return upright
