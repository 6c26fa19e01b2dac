"""What a ROS recording holds, whatever its container: messages as bytes, each with its topic and type.

The containers are read from start to end, not by their index: a recording that was cut off, or never
closed, has none. Every declared length is checked against what is really there before it is read.
"""

from __future__ import annotations

import bz2
import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from flightdepth.errors import BadInput, MissingExtra

CHUNK_LIMIT = 1 << 30  # recorders write chunks of about 1 MiB
PIECE = 1 << 20
CUT = "recordings cut off"
DAMAGED_CHUNKS = "damaged chunks"
DAMAGED_RECORDS = "damaged records"
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"


@dataclass(frozen=True)
class RosMessage:
    """One message: `kind` as ROS 2 writes types ("nav_msgs/msg/Odometry"), `serial` "ros1" or "cdr".

    `definition` is the text of its type's .msg file, empty where the recording does not hold it.
    """

    topic: str
    kind: str
    serial: str
    log_ns: int
    data: bytes
    definition: str = ""


Wanted = Callable[[str], bool]  # of a `kind`: messages of other types are passed over unread


class DamagedError(ValueError):
    """Bytes that break a container's layout; readers count them."""


def ros_kind(name: str) -> str:
    """A type's name as ROS 2 writes it: nav_msgs/Odometry becomes nav_msgs/msg/Odometry."""
    package, slash, rest = name.partition("/")
    return f"{package}/msg/{rest}" if slash and "/" not in rest else name


def decompressed(data: bytes, compression: str, size: int) -> bytes:
    """The `size` bytes that a chunk declares to hold; never allocates more than it really holds."""
    if size > CHUNK_LIMIT:
        raise DamagedError(f"a chunk of {size} bytes")
    if compression in ("", "none"):
        raw = data
    elif compression in _READERS:
        raw = _read_up_to(_READERS[compression](data), size + 1)
    else:
        raise DamagedError(f"compression {compression[:20]!r}")
    if len(raw) != size:
        raise DamagedError(f"a chunk of {len(raw)} bytes that should be {size}")
    return raw


def unpacked(data: bytes) -> bytes:
    """A message that may be packed on its own (rosbag2's compression mode "message")."""
    if not data.startswith(ZSTD_MAGIC):
        return data
    zstandard = required("zstandard")
    try:
        size = zstandard.frame_content_size(data)
    except zstandard.ZstdError as error:
        raise DamagedError(f"a message that cannot be unpacked ({error})") from error
    return decompressed(data, "zstd", size)


def _bz2_stream(data: bytes) -> Any:
    return bz2.BZ2File(io.BytesIO(data))


def _lz4_stream(data: bytes) -> Any:
    return required("lz4.frame").LZ4FrameFile(io.BytesIO(data))


def _zstd_stream(data: bytes) -> Any:
    decompressor = required("zstandard").ZstdDecompressor(max_window_size=1 << 27)
    return decompressor.stream_reader(io.BytesIO(data))


_READERS: dict[str, Callable[[bytes], Any]] = {"bz2": _bz2_stream, "lz4": _lz4_stream, "zstd": _zstd_stream}


def _read_up_to(stream: Any, limit: int) -> bytes:
    parts: list[bytes] = []
    length = 0
    try:
        while length < limit and (part := stream.read(min(PIECE, limit - length))):
            parts.append(part)
            length += len(part)
    except Exception as error:  # each library raises its own kind, and lz4 a bare RuntimeError
        raise DamagedError(f"a chunk that cannot be unpacked ({error})") from error
    return b"".join(parts)


def read_exactly(file: BinaryIO, length: int, left: int) -> bytes:
    """`length` bytes of which `left` can still be there."""
    if length > left:
        raise DamagedError(f"{length} bytes declared, {left} left")
    return file.read(length)


def open_recording(path: Path) -> tuple[BinaryIO, int]:
    """A file and its size."""
    try:
        return path.open("rb"), path.stat().st_size
    except OSError as error:
        got = error.strerror or str(error)
        raise BadInput(f"telemetry {path}", expected="a recording that can be read", got=got) from error


def required(module: str) -> Any:
    """A module of the `ros` extra."""
    import importlib

    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise MissingExtra("Reading ROS recordings", "ros") from error
