"""ROS 2's SQLite files, after rosbag2's tables `topics` and `messages`, and `message_definitions`, which ROS 2 before
Iron does not write.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any
from urllib.parse import quote

from flightdepth.flight.ros_records import (
    CUT,
    DAMAGED_RECORDS,
    DamagedError,
    RosMessage,
    Wanted,
    open_recording,
    unpacked,
)

SQLITE_MAGIC = b"SQLite format 3\0"
SQLITE_HEADER = 100
MESSAGE_LIMIT = 1 << 28


def sqlite_messages(path: Path, wanted: Wanted, counts: Counter[str]) -> Iterator[RosMessage]:
    """The messages of a rosbag2 SQLite file, in the order in which they were written."""
    cut_before = counts[CUT]
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
        counts[CUT] = cut_before + 1  # each file once


def _sqlite_message(
    row: tuple[Any, Any, Any], topics: dict[int, tuple[str, str, str]], counts: Counter[str]
) -> RosMessage | None:
    number, log_ns, data = row
    try:
        if isinstance(data, bytes) and isinstance(log_ns, int) and number in topics:
            topic, kind, definition = topics[number]
            return RosMessage(topic, kind, "cdr", log_ns, unpacked(data), definition)
    except DamagedError:
        pass
    counts[DAMAGED_RECORDS] += 1
    return None


def _connected(path: Path) -> sqlite3.Connection:
    """The file as it stands, without locks, files of SQLite's own beside it, or the undoing of what was not finished.

    All of these may want to write. Only what a recorder that died left in a log beside it (-wal) needs them.
    """
    log = path.with_name(f"{path.name}-wal")
    how = "mode=ro" if log.is_file() and log.stat().st_size else "mode=ro&immutable=1"
    connection = sqlite3.connect(f"file:{quote(str(path.absolute()))}?{how}", uri=True)
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
        counts[CUT] += 1
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
