"""ROS 1 bags, version 2.0, read record by record (wiki.ros.org/Bags/Format/2.0).

A record is a header (fields "name=value", each after its length) and data, both after their lengths,
little-endian. Chunks hold connections and messages. The index at the end tells the connections again, so that a damaged
chunk costs its own messages alone; a recording that was cut off has none, and needs none.
"""

from __future__ import annotations

import io
import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from flightdepth.errors import BadInput
from flightdepth.flight.records import NS_PER_S
from flightdepth.flight.ros_records import (
    CUT,
    DAMAGED_CHUNKS,
    DAMAGED_RECORDS,
    DamagedError,
    RosMessage,
    Wanted,
    decompressed,
    open_recording,
    read_exactly,
    ros_kind,
)

MAGIC = b"#ROSBAG V2.0\n"
MESSAGE, BAG, CHUNK, CONNECTION = 2, 3, 5, 7
LENGTH = struct.Struct("<L")
Fields = dict[bytes, bytes]


@dataclass(frozen=True)
class Connection:
    """Where the messages of one number come from."""

    topic: str
    kind: str
    definition: str


def looks_like_ros1(head: bytes, path: Path) -> bool:
    """The magic line of any version."""
    return head.startswith(b"#ROSBAG V")


def ros1_messages(path: Path, wanted: Wanted, counts: Counter[str]) -> Iterator[RosMessage]:
    """The messages of the wanted types, in the order of the file."""
    file, size = open_recording(path)
    connections: dict[int, Connection] = {}
    with file:
        magic = file.read(len(MAGIC))
        if magic != MAGIC:
            got = magic.decode("latin-1").strip()
            raise BadInput(f"telemetry {path}", expected="a ROS bag of version 2.0", got=got)
        try:
            for fields, data in _records(file, size - len(MAGIC)):
                if _number(fields, b"op") == BAG:
                    connections |= _indexed(file, size, _number(fields, b"index_pos"))
                if _number(fields, b"op") == BAG and _number(fields, b"index_pos") == 0:
                    counts[CUT] += 1  # never closed; whole chunks are there all the same
                if _number(fields, b"op") == CHUNK:
                    yield from _chunk(fields, data, connections, wanted, counts)
        except DamagedError:
            counts[CUT] += 1


def _indexed(file: BinaryIO, size: int, index_pos: int) -> dict[int, Connection]:
    """The connections that the index tells, as far as it is whole; the file stays where it was."""
    here, connections = file.tell(), dict[int, Connection]()
    if not here <= index_pos < size:
        return connections
    file.seek(index_pos)
    try:
        for fields, data in _records(file, size - index_pos):
            if _number(fields, b"op") == CONNECTION:
                connections[_number(fields, b"conn")] = _connection(fields, data)
    except DamagedError:
        pass
    file.seek(here)
    return connections


def _chunk(
    fields: Fields, data: bytes, connections: dict[int, Connection], wanted: Wanted, counts: Counter[str]
) -> Iterator[RosMessage]:
    try:
        compression = fields.get(b"compression", b"").decode("latin-1")
        raw = decompressed(data, compression, _number(fields, b"size"))
        for inner, content in _records(io.BytesIO(raw), len(raw)):
            message = _message(inner, content, connections, wanted, counts)
            if message is not None:
                yield message
    except DamagedError:
        counts[DAMAGED_CHUNKS] += 1


def _message(
    fields: Fields, data: bytes, connections: dict[int, Connection], wanted: Wanted, counts: Counter[str]
) -> RosMessage | None:
    kind, number = _number(fields, b"op"), _number(fields, b"conn")
    if kind == CONNECTION:
        connections[number] = _connection(fields, data)
    if kind != MESSAGE:
        return None
    connection = connections.get(number)
    if connection is None or len(fields.get(b"time", b"")) != 8:
        counts[DAMAGED_RECORDS] += 1
        return None
    if not wanted(connection.kind):
        return None
    seconds, nanoseconds = struct.unpack("<LL", fields[b"time"])
    log_ns = seconds * NS_PER_S + nanoseconds
    return RosMessage(connection.topic, connection.kind, "ros1", log_ns, data, connection.definition)


def _connection(fields: Fields, data: bytes) -> Connection:
    described = _fields(data)
    return Connection(
        fields.get(b"topic", b"").decode("utf-8", errors="replace"),
        ros_kind(described.get(b"type", b"").decode("latin-1")),
        described.get(b"message_definition", b"").decode("utf-8", errors="replace"),
    )


def _records(file: BinaryIO, left: int) -> Iterator[tuple[Fields, bytes]]:
    while left > 0:
        header, left = _sized(file, left)
        data, left = _sized(file, left)
        yield _fields(header), data


def _sized(file: BinaryIO, left: int) -> tuple[bytes, int]:
    (length,) = LENGTH.unpack(read_exactly(file, LENGTH.size, left))
    return read_exactly(file, length, left - LENGTH.size), left - LENGTH.size - length


def _fields(header: bytes) -> Fields:
    fields: Fields = {}
    offset = 0
    while offset + LENGTH.size <= len(header):
        (length,) = LENGTH.unpack_from(header, offset)
        name, equals, value = header[offset + LENGTH.size : offset + LENGTH.size + length].partition(b"=")
        if not equals:
            raise DamagedError("a field without a value")
        fields[name] = value
        offset += LENGTH.size + length
    return fields


def _number(fields: Fields, name: bytes) -> int:
    """A little-endian number, -1 where there is none."""
    return int.from_bytes(fields[name][:8], "little") if name in fields else -1
