"""Reading OpenEXR files, by the format's own library (extra `exr`)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import OpenEXR
from numpy.typing import NDArray

from flightdepth.errors import FlightDepthError

Channels = dict[str, NDArray[Any]]


def read_exr(path: Path) -> Channels:
    """Every channel by its name ("ViewLayer.Depth.Z"), [H, W], as it is stored: floats of 16 or 32 bits, or uint32.

    Raises:
        FlightDepthError: the file is cut off, none, or of several parts.
    """
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            parts = len(file.parts)
            channels: Channels = {name: channel.pixels for name, channel in file.channels().items()}
    except (RuntimeError, ValueError) as error:
        raise FlightDepthError(f"{path.name}: expected an OpenEXR file ({error})") from error
    if parts != 1:
        raise FlightDepthError(f"{path.name}: expected an OpenEXR file of one part, got {parts}")
    return channels
