"""Reading the one kind of OpenEXR file that we ask Blender to write: scan lines, not compressed, 32-bit floats.

Layout: https://openexr.com/en/latest/OpenEXRFileLayout.html
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flightdepth.errors import FlightDepthError

MAGIC = 20000630
FLOAT = 2  # type of a channel
Channels = dict[str, NDArray[np.float32]]


def read_exr(path: Path) -> Channels:
    """Every channel by its name ("ViewLayer.Depth.Z"), [H, W] each.

    Raises:
        FlightDepthError: the file is cut off or of another kind.
    """
    data = path.read_bytes()
    try:
        return _channels(data)
    except (struct.error, ValueError, KeyError) as error:
        raise FlightDepthError(f"{path.name}: expected an uncompressed 32-bit EXR file ({error})") from error


def _channels(data: bytes) -> Channels:
    if struct.unpack_from("<I", data)[0] != MAGIC:
        raise ValueError("no EXR file")
    attributes, start = _attributes(data)
    names = _channel_names(attributes["channels"])
    if attributes["compression"] != b"\0":
        raise ValueError("compressed")
    left, top, right, bottom = struct.unpack("<4i", attributes["dataWindow"])
    rows, columns = bottom - top + 1, right - left + 1
    lines = np.dtype([("row", "<i4"), ("bytes", "<i4"), ("values", "<f4", (len(names), columns))])
    # A table of offsets stands before.
    block = np.frombuffer(data, lines, count=rows, offset=start + 8 * rows)
    if sorted(block["row"]) != list(range(top, bottom + 1)):
        raise ValueError("lines are missing")
    values = np.empty((rows, len(names), columns), np.float32)
    values[block["row"] - top] = block["values"]
    return {name: values[:, place] for place, name in enumerate(names)}


def _attributes(data: bytes) -> tuple[dict[str, bytes], int]:
    """The header's values by name, and where it ends."""
    found: dict[str, bytes] = {}
    place = 8  # after the magic number and the version
    while data[place : place + 1] != b"\0":
        name, place = _text(data, place)
        _, place = _text(data, place)  # the type: known by the name
        (size,) = struct.unpack_from("<i", data, place)
        found[name] = data[place + 4 : place + 4 + size]
        place += 4 + size
        if place >= len(data):
            raise ValueError("cut off")
    return found, place + 1


def _channel_names(listed: bytes) -> list[str]:
    names, place = [], 0
    while listed[place : place + 1] != b"\0":
        name, place = _text(listed, place)
        if struct.unpack_from("<i", listed, place)[0] != FLOAT:
            raise ValueError(f"channel {name} is not 32-bit")
        names.append(name)
        place += 16  # type, linearity, subsampling
    return names


def _text(data: bytes, place: int) -> tuple[str, int]:
    end = data.index(b"\0", place)
    return data[place:end].decode(), end + 1
