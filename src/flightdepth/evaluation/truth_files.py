"""Files of true depth as simulators, scanners and data sets store it: pictures of numbers, and NumPy's arrays.

ending            what it holds
.png .tif .tiff   whole numbers of 16 bits, or floats
.npy .npz         an array [H, W]; of several in an .npz the one named depth_m, as `flightdepth run` writes
.pfm              floats
.exr              floats of 16 or 32 bits, in the channels R, G and B or in Y; FFmpeg reads it
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.errors import BadInput

ENDINGS = (".png", ".npy", ".npz", ".tif", ".tiff", ".pfm", ".exr")
NAMED = "depth_m"  # in an .npz
BROKEN = "something else, or a part of it"
Stored = NDArray[Any]


def read_stored(path: Path) -> Stored:
    """The numbers of a file of true depth, [H, W], as they stand there: whole (16 bits or more) or floating.

    Raises:
        BadInput: it cannot be read, or holds no single map of such numbers.
    """
    try:
        stored = np.squeeze(_READERS[path.suffix.lower()](path))
    except Exception as error:  # NumPy, zipfile and FFmpeg raise a dozen kinds where a file is trash
        raise _unreadable(path, _short(error)) from error
    stored = one_channel(stored)
    if stored.ndim != 2 or not _tells_depth(stored.dtype):
        raise _unreadable(path, f"{stored.dtype} {list(stored.shape)}")
    return stored


def one_channel(stored: Stored) -> Stored:
    """[H, W] of [H, W, C] whose channels are all the same, as renderers write grey; others as they are."""
    if stored.ndim == 3 and all(
        np.array_equal(stored[..., 0], stored[..., i], equal_nan=stored.dtype.kind == "f")
        for i in range(1, stored.shape[2])
    ):
        return np.asarray(stored[..., 0])
    return stored


def _tells_depth(kind: np.dtype[Any]) -> bool:
    return kind.kind == "f" or (kind.kind in "iu" and kind.itemsize > 1)


def _picture(path: Path) -> Stored:
    data = np.frombuffer(path.read_bytes(), np.uint8)
    picture = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if len(data) else None
    if picture is None:
        raise ValueError(BROKEN)
    return np.asarray(picture)


def _npy(path: Path) -> Stored:
    return np.asarray(np.load(io.BytesIO(path.read_bytes()), allow_pickle=False))


def _npz(path: Path) -> Stored:
    with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as arrays:
        if isinstance(arrays, np.ndarray):
            raise ValueError("an .npy under this name")
        names = list(arrays)
        if NAMED not in names and len(names) != 1:
            raise ValueError(f"{len(names)} arrays, none named {NAMED}")
        return np.asarray(arrays[NAMED if NAMED in names else names[0]])


def _exr(path: Path) -> Stored:
    """[H, W, C]. OpenCV's own reader is off unless the environment says otherwise."""
    with av.open(str(path.absolute())) as file:
        (frame,) = file.decode(video=0)
    name = frame.format.name
    if not name.endswith(("f32le", "f16le")):
        raise ValueError(f"numbers of the kind {name}")
    kind = np.dtype("<f4" if name.endswith("f32le") else "<f2")
    colours = [
        plane for plane, of in zip(frame.planes, frame.format.components, strict=True) if not of.is_alpha
    ]
    planes = [
        np.frombuffer(bytes(plane), kind).reshape(plane.height, -1)[:, : plane.width] for plane in colours
    ]
    return np.stack(planes, axis=-1)


_READERS = {".npy": _npy, ".npz": _npz, ".exr": _exr}
_READERS |= dict.fromkeys((".png", ".tif", ".tiff", ".pfm"), _picture)


def _short(error: Exception) -> str:
    """What went wrong, in a line."""
    if isinstance(error, OSError) and error.strerror:  # FFmpeg's too
        return error.strerror
    told = isinstance(error, ValueError) and not isinstance(error, UnicodeError)
    return " ".join(str(error).split()) if told else BROKEN


def _unreadable(path: Path, got: str) -> BadInput:
    return BadInput(f"truth {path}", expected="a map [H, W] of floats or 16-bit numbers", got=got)
