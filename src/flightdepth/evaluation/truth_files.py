"""Files of true depth as simulators, scanners and data sets store it: pictures of numbers, and NumPy's arrays.

ending            what it holds
.png .tif .tiff   whole numbers of 16 bits, or floats
.npy .npz         an array [H, W]; of several in an .npz the one named depth_m, as `flightdepth run` writes
.pfm              floats
.exr              floats of 16 or 32 bits, in the channels R, G and B, in Y, or as Blender names depth: V, Z,
                  View Layer.Depth.Z
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.errors import BadInput
from flightdepth.levels import picture_in

ENDINGS = (".png", ".npy", ".npz", ".tif", ".tiff", ".pfm", ".exr")
NAMED = "depth_m"  # in an .npz
COLOURS = frozenset("RGBY")
DEPTHS = frozenset("VZ")  # last parts of the names that Blender gives
HEAD_BYTES = 256  # of a .pfm
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
    if stored.ndim != 2 or not stored.size or not _tells_depth(stored.dtype):
        raise _unreadable(path, f"{stored.dtype} {list(stored.shape)}")
    return stored


def one_channel(stored: Stored) -> Stored:
    """[H, W] of [H, W, C] whose channels are all the same, as renderers write grey, but for some that are 0 throughout.

    Others as they are.
    """
    if stored.ndim == 3 and stored.size:
        told = stored[..., (stored != 0).any(axis=(0, 1))]  # NaN is none
        stored = told if told.shape[2] else stored
    if (
        stored.ndim == 3
        and stored.size
        and all(
            np.array_equal(stored[..., 0], stored[..., i], equal_nan=stored.dtype.kind == "f")
            for i in range(1, stored.shape[2])
        )
    ):
        return np.asarray(stored[..., 0])
    return stored


def _tells_depth(kind: np.dtype[Any]) -> bool:
    return kind.kind == "f" or (kind.kind in "iu" and kind.itemsize > 1)


def _picture(path: Path) -> Stored:
    picture = picture_in(path.read_bytes(), cv2.IMREAD_UNCHANGED)
    if picture is None:
        raise ValueError(BROKEN)
    return np.asarray(picture)


def _pfm(path: Path) -> Stored:
    """OpenCV divides by the scale in the file's head, after its kind, width and height."""
    scale = abs(float(path.read_bytes()[:HEAD_BYTES].split()[3]))
    return _picture(path) * np.float32(scale)


def _npy(path: Path) -> Stored:
    return np.asarray(np.load(io.BytesIO(path.read_bytes()), allow_pickle=False))


def _npz(path: Path) -> Stored:
    arrays = np.load(io.BytesIO(path.read_bytes()), allow_pickle=False)
    if isinstance(arrays, np.ndarray):
        raise ValueError("an .npy under this name")
    with arrays:
        names = list(arrays)
        if NAMED not in names and len(names) != 1:
            raise ValueError(f"{len(names)} arrays, none named {NAMED}")
        return np.asarray(arrays[NAMED if NAMED in names else names[0]])


def _exr(path: Path) -> Stored:
    """[H, W] of the channel that has the name of depth, else [H, W, C] of the colours."""
    from flightdepth.renderers.exr import read_exr

    channels = read_exr(path)
    depths = [name for name in channels if name.rpartition(".")[2] in DEPTHS]
    chosen = depths or [name for name in channels if name in COLOURS]
    if len(depths) > 1 or not chosen:
        raise ValueError(
            f"an EXR with the channels {', '.join(sorted(channels))}: one of depth is called V, Z or Y"
        )
    stored = [channels[name] for name in chosen]
    return stored[0] if depths else np.stack(stored, axis=-1)


_READERS = {".npy": _npy, ".npz": _npz, ".exr": _exr, ".pfm": _pfm}
_READERS |= dict.fromkeys((".png", ".tif", ".tiff"), _picture)


def _short(error: Exception) -> str:
    """What went wrong, in a line."""
    if isinstance(error, OSError) and error.strerror:  # FFmpeg's too
        return error.strerror
    told = isinstance(error, ValueError) and not isinstance(error, UnicodeError)
    return " ".join(str(error).split()) if told else BROKEN


def _unreadable(path: Path, got: str) -> BadInput:
    return BadInput(f"truth {path}", expected="a map [H, W] of floats or 16-bit numbers", got=got)
