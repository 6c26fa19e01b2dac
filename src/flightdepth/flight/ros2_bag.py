"""ROS 2 recordings: MCAP files, SQLite files, and the folders that hold them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from flightdepth.errors import BadInput
from flightdepth.flight.file_bytes import head_of
from flightdepth.flight.ros_mcap import MCAP_MAGIC, mcap_messages
from flightdepth.flight.ros_records import RosMessage, Wanted
from flightdepth.flight.ros_sqlite import SQLITE_MAGIC, sqlite_messages


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
    """The files of a recording in the order of the numbers in their names (bag_2 before bag_10), dates too."""
    packed = sorted(file for file in folder.glob("*.zstd") if not file.with_suffix("").exists())
    if packed:
        mend = f"Unpack them (zstd -d {packed[0].name}), then read the .db3 or .mcap files."
        raise BadInput(f"telemetry {folder}", expected="files that are not packed", got="zstd", mend=mend)
    files = [file for file in folder.iterdir() if _is_storage(file)]
    return sorted(files, key=lambda file: [int(part) for part in re.findall(r"\d{1,9}", file.stem)])


def _is_storage(file: Path) -> bool:
    return head_of(file, len(SQLITE_MAGIC)).startswith((MCAP_MAGIC, SQLITE_MAGIC))
