"""MCAP files (mcap.dev/spec): records of a code, a length and data, some inside chunks.

The `mcap` package parses each record; what is read and how much of it is decided here, because a recording that was cut
off has no index. Where there is one, its summary tells the channels again, so that a damaged chunk costs its own
messages alone.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

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
    required,
    ros_kind,
    unpacked,
)

MCAP_MAGIC = b"\x89MCAP0\r\n"
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, DATA_END = 2, 3, 4, 5, 6, 15
RECORD = struct.Struct("<BQ")
END = struct.Struct("<BQQQL8s")  # the footer and the magic behind it; the third is where the summary begins
MSG_ENCODINGS = ("ros2msg", "ros1msg")  # of definitions


@dataclass
class Channels:
    """What has been said so far: numbers to (kind, definition), and to (topic, kind, encoding, definition)."""

    schemas: dict[int, tuple[str, str]] = field(default_factory=dict)
    channels: dict[int, tuple[str, str, str, str]] = field(default_factory=dict)


def mcap_messages(path: Path, wanted: Wanted, counts: Counter[str]) -> Iterator[RosMessage]:
    """The messages of an MCAP file, ROS 2 (cdr) or ROS 1 inside."""
    file, size = open_recording(path)
    with file:
        known = _summary(file, size)
        file.seek(len(MCAP_MAGIC))
        try:
            for code, data in _records(file, size - len(MCAP_MAGIC)):
                if code == DATA_END:
                    return
                inner = _chunk_records(data, counts) if code == CHUNK else [(code, data)]
                for inner_code, inner_data in inner:
                    message = _mcap_message(inner_code, inner_data, known, wanted, counts)
                    if message is not None:
                        yield message
        except DamagedError:
            pass
        counts[CUT] += 1  # whoever closes a file writes DATA_END


def _summary(file: BinaryIO, size: int) -> Channels:
    """The channels that the summary tells, as far as it is whole."""
    known = Channels()
    if size < len(MCAP_MAGIC) + END.size:
        return known
    file.seek(size - END.size)
    code, _, start, _, _, magic = END.unpack(read_exactly(file, END.size, END.size))
    if code != FOOTER or magic != MCAP_MAGIC or not len(MCAP_MAGIC) < start < size:
        return known
    file.seek(start)
    try:
        for kind, data in _records(file, size - END.size - start):
            if kind in (SCHEMA, CHANNEL):
                _mcap_message(kind, data, known, lambda _: False, Counter())
    except DamagedError:
        pass
    return known


def _records(file: BinaryIO, left: int) -> Iterator[tuple[int, bytes]]:
    while left > 0:
        code, length = RECORD.unpack(read_exactly(file, RECORD.size, left))
        left -= RECORD.size + length
        yield code, read_exactly(file, length, left + length)


def _chunk_records(data: bytes, counts: Counter[str]) -> Iterator[tuple[int, bytes]]:
    try:
        chunk = _parsed("Chunk", data)
        raw = decompressed(chunk.data, chunk.compression, chunk.uncompressed_size)
        if chunk.uncompressed_crc and zlib.crc32(raw) != chunk.uncompressed_crc:
            raise DamagedError("a wrong checksum")
        yield from _records(io.BytesIO(raw), len(raw))
    except DamagedError:
        counts[DAMAGED_CHUNKS] += 1


def _mcap_message(
    code: int, data: bytes, known: Channels, wanted: Wanted, counts: Counter[str]
) -> RosMessage | None:
    try:
        if code == SCHEMA:
            schema = _parsed("Schema", data)
            text = schema.data.decode("utf-8", "replace") if schema.encoding in MSG_ENCODINGS else ""
            known.schemas[schema.id] = ros_kind(schema.name), text
        elif code == CHANNEL:
            channel = _parsed("Channel", data)
            kind, definition = known.schemas.get(channel.schema_id, ("", ""))
            known.channels[channel.id] = (channel.topic, kind, channel.message_encoding, definition)
        elif code == MESSAGE:
            return _chosen(_parsed("Message", data, len(data)), known, wanted)
    except DamagedError:
        counts[DAMAGED_RECORDS] += 1
    return None


def _chosen(message: Any, known: Channels, wanted: Wanted) -> RosMessage | None:
    if message.channel_id not in known.channels:
        raise DamagedError("a message of an unknown channel")
    topic, kind, encoding, definition = known.channels[message.channel_id]
    if encoding not in ("cdr", "ros1") or not wanted(kind):
        return None
    return RosMessage(topic, kind, encoding, message.log_time, unpacked(message.data), definition)


def _parsed(name: str, data: bytes, *arguments: int) -> Any:
    """A record through the `mcap` package, whose errors are of many kinds."""
    stream = required("mcap.data_stream").ReadDataStream(io.BytesIO(data))
    record = getattr(required("mcap.records"), name)
    end_of_file = required("mcap.exceptions").McapError
    try:
        return record.read(stream, *arguments)
    except (end_of_file, struct.error, UnicodeDecodeError, OverflowError, ValueError) as error:
        raise DamagedError(f"a {name} that cannot be read ({error})") from error
