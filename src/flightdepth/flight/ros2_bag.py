"""ROS 2 recordings: MCAP files, SQLite files, and the folders that hold them.

MCAP after its specification (mcap.dev/spec): records of a code, a length and data, some inside chunks. The
`mcap` package parses each record; what is read and how much of it is decided here, because a recording that
was cut off has no index. SQLite after rosbag2's tables `topics` and `messages`, and `message_definitions`, which
ROS 2 before Iron does not write.
"""

from __future__ import annotations

import io
import os
import re
import shutil
import sqlite3
import struct
import tempfile
import zlib
from collections import Counter
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import quote

from flightdepth.errors import BadInput
from flightdepth.flight.file_bytes import head_of
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
)

MCAP_MAGIC = b"\x89MCAP0\r\n"
SQLITE_MAGIC = b"SQLite format 3\0"
SQLITE_HEADER = 100
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
SCHEMA, CHANNEL, MESSAGE, CHUNK, DATA_END = 3, 4, 5, 6, 15
RECORD = struct.Struct("<BQ")
MSG_ENCODINGS = ("ros2msg", "ros1msg")  # of definitions
MESSAGE_LIMIT = 1 << 28


@dataclass
class Channels:
    """What has been said so far: numbers to (kind, definition), and to (topic, kind, encoding, definition)."""

    schemas: dict[int, tuple[str, str]] = field(default_factory=dict)
    channels: dict[int, tuple[str, str, str, str]] = field(default_factory=dict)


def looks_like_ros2(head: bytes, path: Path) -> bool:
    """An MCAP or SQLite file, or a folder with some."""
    if not path.is_dir():
        return head.startswith((MCAP_MAGIC, SQLITE_MAGIC))
    try:
        names = {file.name for file in path.iterdir()}
    except OSError:
        return False
    return "metadata.yaml" in names or any(_is_storage(path / name) for name in names)


def ros2_messages(path: Path, wanted: Wanted, counts: Counter[str]) -> Iterator[RosMessage]:
    """The messages of the wanted types, in the order of the file or files."""
    for file in storage_files(path) if path.is_dir() else [path]:
        reader = mcap_messages if head_of(file, len(MCAP_MAGIC)) == MCAP_MAGIC else sqlite_messages
        yield from reader(file, wanted, counts)


def storage_files(folder: Path) -> list[Path]:
    """The files of a recording in the order of the numbers in their names (bag_2 before bag_10)."""
    packed = sorted(folder.glob("*.zstd"))
    if packed:
        mend = f"Unpack them (zstd -d {packed[0].name}), then read the .db3 or .mcap files."
        raise BadInput(f"telemetry {folder}", expected="files that are not packed", got="zstd", mend=mend)
    files = [file for file in folder.iterdir() if _is_storage(file)]
    return sorted(files, key=lambda file: [int(part) for part in re.findall(r"\d{1,9}", file.stem)][-1:])


def _is_storage(file: Path) -> bool:
    return head_of(file, len(SQLITE_MAGIC)).startswith((MCAP_MAGIC, SQLITE_MAGIC))


def mcap_messages(path: Path, wanted: Wanted, counts: Counter[str]) -> Iterator[RosMessage]:
    """The messages of an MCAP file, ROS 2 (cdr) or ROS 1 inside."""
    file, size = open_recording(path)
    known = Channels()
    with file:
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
    return RosMessage(topic, kind, encoding, message.log_time, message.data, definition)


def _parsed(name: str, data: bytes, *arguments: int) -> Any:
    """A record through the `mcap` package, whose errors are of many kinds."""
    stream = required("mcap.data_stream").ReadDataStream(io.BytesIO(data))
    record = getattr(required("mcap.records"), name)
    end_of_file = required("mcap.exceptions").McapError
    try:
        return record.read(stream, *arguments)
    except (end_of_file, struct.error, UnicodeDecodeError, OverflowError, ValueError) as error:
        raise DamagedError(f"a {name} that cannot be read ({error})") from error


def sqlite_messages(path: Path, wanted: Wanted, counts: Counter[str]) -> Iterator[RosMessage]:
    """The messages of a rosbag2 SQLite file, in the order in which they were written."""
    try:
        with _whole_pages(path, counts) as whole, closing(_connected(whole)) as connection:
            topics = _topics(connection, wanted)
            marks = ",".join("?" * len(topics))
            rows = connection.execute(
                f"SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({marks}) ORDER BY id",
                tuple(topics),
            )
            for row in rows:
                message = _sqlite_message(row, topics, counts)
                if message is not None:
                    yield message
    # SQLite quotes damaged names in its messages, and Python cannot decode some.
    except (sqlite3.Error, UnicodeDecodeError):
        counts[CUT] = 1


def _sqlite_message(
    row: tuple[Any, Any, Any], topics: dict[int, tuple[str, str, str]], counts: Counter[str]
) -> RosMessage | None:
    number, log_ns, data = row
    try:
        if isinstance(data, bytes) and isinstance(log_ns, int) and number in topics:
            topic, kind, definition = topics[number]
            return RosMessage(topic, kind, "cdr", log_ns, _unpacked(data), definition)
    except DamagedError:
        pass
    counts[DAMAGED_RECORDS] += 1
    return None


def _connected(path: Path) -> sqlite3.Connection:
    connection = sqlite3.connect(f"file:{quote(str(path.absolute()))}?mode=ro", uri=True)
    connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MESSAGE_LIMIT)
    # Without this SQLite refuses a file shorter than its header says; nothing is written in mode "ro".
    connection.execute("PRAGMA writable_schema = ON")
    return connection


@contextmanager
def _whole_pages(path: Path, counts: Counter[str]) -> Iterator[Path]:
    """The file, or a copy without the page in which it was cut off: SQLite reads the lost part as zeros."""
    file, size = open_recording(path)
    with file:
        head = file.read(SQLITE_HEADER)
    page_size = int.from_bytes(head[16:18], "big")
    page_size = 65536 if page_size == 1 else max(page_size, 512)
    if size < page_size * int.from_bytes(head[28:32], "big"):
        counts[CUT] = 1
    if size % page_size == 0:
        yield path
        return
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "whole.db3"
        shutil.copyfile(path, copy)
        os.truncate(copy, size - size % page_size)
        yield copy


def _topics(connection: sqlite3.Connection, wanted: Wanted) -> dict[int, tuple[str, str, str]]:
    """Of each number the name, kind and definition."""
    definitions = _definitions(connection)
    rows = connection.execute("SELECT id, name, type FROM topics WHERE serialization_format = 'cdr'")
    named = [(number, name, kind) for number, name, kind in rows if isinstance(kind, str)]
    return {
        number: (str(name), kind, definitions.get(kind, "")) for number, name, kind in named if wanted(kind)
    }


def _definitions(connection: sqlite3.Connection) -> dict[str, str]:
    """Of each type that the file defines."""
    columns = "topic_type, encoded_message_definition"
    found: dict[str, str] = {}
    with suppress(sqlite3.Error, UnicodeDecodeError):  # no such table, or a damaged one
        rows = connection.execute(f"SELECT {columns} FROM message_definitions WHERE encoding = 'ros2msg'")
        found.update((kind, text) for kind, text in rows if isinstance(text, str))
    return found


def _unpacked(data: bytes) -> bytes:
    """A message that was packed on its own (rosbag2's compression mode "message")."""
    if not data.startswith(ZSTD_MAGIC):
        return data
    zstandard = required("zstandard")
    try:
        size = zstandard.frame_content_size(data)
    except zstandard.ZstdError as error:
        raise DamagedError(f"a message that cannot be unpacked ({error})") from error
    return decompressed(data, "zstd", size)
