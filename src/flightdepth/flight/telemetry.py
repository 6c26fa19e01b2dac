"""Telemetry of any known format, recognised by what is in the file, never by its name."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from flightdepth.errors import BadInput
from flightdepth.flight.dataflash import looks_like_dataflash, read_dataflash
from flightdepth.flight.dji_record import looks_like_dji_record, read_dji_record
from flightdepth.flight.dji_srt import looks_like_dji_srt, read_dji_srt
from flightdepth.flight.file_bytes import head_of, log_bytes
from flightdepth.flight.gpx import looks_like_gpx, read_gpx
from flightdepth.flight.inside import read_inside
from flightdepth.flight.parrot import looks_like_parrot, read_parrot
from flightdepth.flight.records import Telemetry
from flightdepth.flight.ros import looks_like_ros, read_ros
from flightdepth.flight.telemetry_csv import looks_like_csv, read_csv
from flightdepth.flight.tlog import looks_like_tlog, read_tlog
from flightdepth.flight.trajectory import looks_like_trajectory, read_trajectory
from flightdepth.flight.ulog import looks_like_ulog, read_ulog

HEAD_BYTES = 4096
UTF_16 = "a text in UTF-16: save it as UTF-8"
# How files begin that are not read, and what to do with them.
UNREAD = {
    b"ULogEnc": "PX4's encrypted log (.ulge): decrypt it to a .ulg",
    b"FMT,": "an ArduPilot log as text: give the .bin that it was made of",
    b"\xff\xfe": UTF_16,
    b"\xfe\xff": UTF_16,
}
# Seven or twelve numbers a line, as TartanAir and KITTI have them.
NUMBER = r"[-+]?[\d.]+(?:[eE][-+]?\d+)?"
POSES_ALONE = re.compile(rf"{NUMBER}(?:\s+{NUMBER}){{6}}(?:(?:\s+{NUMBER}){{5}})?")
LISTED = 10  # of the logs in a folder


class Format(NamedTuple):
    """A kind of log: its name for people, whether a file is one, and how it is read.

    `recognises` gets the file's first HEAD_BYTES bytes (none of a folder) and its path; it never raises.
    """

    name: str
    recognises: Callable[[bytes, Path], bool]
    read: Callable[[Path], Telemetry]


# Asked from the first to the last: those with a magic number before those that are only text.
FORMATS: tuple[Format, ...] = (
    Format("PX4 ULog", looks_like_ulog, read_ulog),
    Format("ROS recording", looks_like_ros, read_ros),
    Format("ArduPilot DataFlash", looks_like_dataflash, read_dataflash),
    Format("MAVLink tlog", looks_like_tlog, read_tlog),
    Format("GPX", looks_like_gpx, read_gpx),
    Format("DJI subtitles", looks_like_dji_srt, read_dji_srt),
    Format("DJI flight record", looks_like_dji_record, read_dji_record),
    Format("Parrot metadata", looks_like_parrot, read_parrot),
    Format("TUM trajectory", looks_like_trajectory, read_trajectory),  # whose comments may have commas
    Format("CSV", looks_like_csv, read_csv),
)


def read_telemetry(path: Path) -> Telemetry:
    """Read a log of any known format."""
    head = b"" if path.is_dir() else log_bytes(path, HEAD_BYTES)
    log_format = _format_of(head, path)
    if log_format is not None:
        return log_format.read(path)
    if head[4:8] == b"ftyp" and (inside := read_inside(path)) is not None:
        return inside  # of another copy of the video, which has lost it
    known = ", ".join(log_format.name for log_format in FORMATS)
    got = _folder(path) if path.is_dir() else _described(head, path.name)
    raise BadInput(f"telemetry {path}", expected=f"one of {known}", got=got)


def _folder(path: Path) -> str:
    """What a folder holds that is no ROS recording."""
    try:
        logs = sorted(log.name for log in path.iterdir() if is_log(log))
    except OSError as error:
        return error.strerror or str(error)
    if not logs:
        return "a folder without a log"
    others = f" and {len(logs) - LISTED} more" if len(logs) > LISTED else ""
    return f"a folder of logs: give one of them ({', '.join(logs[:LISTED])}{others})"


def _described(head: bytes, file_name: str) -> str:
    """What a file seems to be that is no log."""
    if not head:
        return "an empty file"
    for magic, name in UNREAD.items():
        if head.startswith(magic):
            return name
    if file_name.startswith("DJIFlightRecord"):
        return "DJI's encrypted flight record: AirData and PhantomHelp's viewers decode it to CSV"
    if head[4:8] == b"ftyp":
        return "a video without telemetry inside that is known"
    line = head.split(b"\n", 1)[0].strip().decode("utf-8-sig", "replace")
    return _table(line) or "something else"


def _table(line: str) -> str | None:
    """What a text that begins with this line seems to be; None where that tells nothing."""
    if POSES_ALONE.fullmatch(line):
        return "poses without times: docs/datasets.md tells how they become a log"
    for separator, name in ((";", "semicolons"), ("\t", "tabs")):
        if separator in line and line.replace("\t", " ").isprintable():
            return f"a table with {name}: a CSV log has commas between its columns, and points in its numbers"
    return None


def is_log(path: Path) -> bool:
    """Whether a file is a log of any known format, by its head; one that cannot be read is none."""
    return _format_of(head_of(path, HEAD_BYTES), path) is not None


def _format_of(head: bytes, path: Path) -> Format | None:
    return next((log_format for log_format in FORMATS if log_format.recognises(head, path)), None)
