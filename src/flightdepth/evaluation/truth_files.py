"""Files of true depth as simulators, scanners and data sets store it: pictures of numbers, and NumPy's arrays.

ending            what it holds
.png .tif .tiff   whole numbers of 16 bits, or floats
.npy .npz         an array [H, W]; of several in an .npz the one named depth_m, as `flightdepth run` writes
.pfm              floats
.exr              floats of 16 or 32 bits, in the channels R, G and B, in Y, or as Blender names depth: V, Z,
                  View Layer.Depth.Z; FFmpeg reads it
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.errors import BadInput

ENDINGS = (".png", ".npy", ".npz", ".tif", ".tiff", ".pfm", ".exr")
NAMED = "depth_m"  # in an .npz
EXR_MAGIC, HAS_PARTS = 20000630, 0x1800  # flags of files with several parts, or samples, a pixel
COLOURS = frozenset("RGBY")
DEPTHS = frozenset("VZ")  # last parts of the names that Blender gives
AFTER_NAME = 16  # bytes in a list of channels: type, linearity, subsampling
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
    """[H, W] of [H, W, C] whose channels are all the same, as renderers write grey, but for some that are 0 throughout.

    Others as they are.
    """
    if stored.ndim == 3:
        told = stored[..., (stored != 0).any(axis=(0, 1))]  # NaN is none
        stored = told if told.shape[2] else stored
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
    decoder: Any = av.CodecContext.create("exr", "r")
    data = depth_as_grey(path.read_bytes())
    frames: list[Any] = [*decoder.decode(av.Packet(data)), *decoder.decode(None)]
    (frame,) = frames
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


def depth_as_grey(exr: bytes) -> bytes:
    """A file whose depth has a name that FFmpeg does not know, with depth called Y, and all else by no known name.

    One with the channels R, G and B or Y alone comes back as it is.

    Raises:
        ValueError: no channel tells depth, or several do, or it has several parts.
    """
    magic, version = struct.unpack_from("<II", exr)
    if magic != EXR_MAGIC:
        raise ValueError(BROKEN)
    if version & HAS_PARTS:
        raise ValueError("an EXR of several parts or samples")
    at, size, end = _exr_header(exr)
    entries = [*_channels(exr[at : at + size])]
    names = [name for name, _ in entries]
    depths = [name for name in names if name.rpartition(".")[2] in DEPTHS]
    if not depths and COLOURS & {*names}:
        return exr
    if len(depths) != 1:
        raise ValueError(f"an EXR with the channels {', '.join(names)}: one of depth is called V, Z or Y")
    listed = b"".join(
        (b"Y" if name == depths[0] else b"-" * len(name)) + b"\0" + rest for name, rest in entries
    )
    listed += b"\0"
    shorter = size - len(listed)
    (first,) = struct.unpack_from("<Q", exr, end)
    offsets = np.frombuffer(exr[end:first], "<u8") - np.uint64(shorter)
    head = exr[: at - 4] + struct.pack("<i", len(listed)) + listed + exr[at + size : end]
    return head + offsets.tobytes() + exr[first:]


def _exr_header(exr: bytes) -> tuple[int, int, int]:
    """Where its list of channels begins, how many bytes that has, and where the header ends."""
    at, found = 8, None
    while exr[at] != 0:
        name_end = exr.index(b"\0", at)
        type_end = exr.index(b"\0", name_end + 1)
        (size,) = struct.unpack_from("<i", exr, type_end + 1)
        if size < 0:
            raise ValueError(BROKEN)
        if exr[at:name_end] == b"channels":
            found = type_end + 5, size
        at = type_end + 5 + size
    if found is None:
        raise ValueError(BROKEN)
    return (*found, at + 1)


def _channels(listed: bytes) -> Iterator[tuple[str, bytes]]:
    """Names, and what follows each."""
    at = 0
    while listed[at] != 0:
        end = listed.index(b"\0", at)
        yield listed[at:end].decode("ascii", "replace"), listed[end + 1 : end + 1 + AFTER_NAME]
        at = end + 1 + AFTER_NAME


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
