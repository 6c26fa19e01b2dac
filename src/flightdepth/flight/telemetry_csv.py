"""Telemetry as a CSV file: one header line, then one line for each time.

Columns, in any order:

    stamp_ns  or  time_s                                since the video's first picture, or 1970 (int ns, or seconds)
    vn_m_s, ve_m_s, vd_m_s                              velocity north, east, down (world), or
    vx_camera_m_s, vy_camera_m_s, vz_camera_m_s         velocity right, down, forward (camera), or
    speed_m_s                                           its length alone: the direction is seen in the pictures, or
    north_m, east_m, down_m                             none of these, but positions from which it comes, or
    none of all these, but a place                      from which it comes
    sigma_m_s                                           optional: its standard deviation
    qw, qx, qy, qz                                      optional: attitude, world (NED) from camera, or
    camera_yaw_deg, camera_pitch_deg, camera_roll_deg   from north clockwise, up, right side down
    latitude_deg, longitude_deg, altitude_m             optional: where on Earth (WGS 84), above mean sea level
    utc_ns                                              optional: universal time, int ns since 1970

Other columns are ignored, and the telemetry's name says which. Lines whose time is not later than the one before
are left out and counted, and so is a last line without its end: it was cut off. Anything else that is wrong is
refused with its line, for who writes such a file can mend it.
"""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from flightdepth.errors import BadInput
from flightdepth.files import write_atomic
from flightdepth.flight.csv_columns import (
    ALONG,
    ANGLES,
    ATTITUDE,
    BY_PLACES,
    MEND,
    SIGMA,
    SPEED,
    STAMP,
    VELOCITY,
    Columns,
)
from flightdepth.flight.csv_rows import Row
from flightdepth.flight.file_bytes import log_bytes
from flightdepth.flight.metric_positions import samples_along
from flightdepth.flight.order import rising_counted
from flightdepth.flight.places import SEA_LEVEL
from flightdepth.flight.positions import place_track, velocities_by_fixes
from flightdepth.flight.records import (
    MAX_GAP_S,
    AttitudeSample,
    Sample,
    Telemetry,
    VelocitySample,
    by_time,
    none_of,
)
from flightdepth.flight.universal_time import UniversalTime, can_be
from flightdepth.motion import Vector


def read_csv(path: Path) -> Telemetry:
    """Read a telemetry CSV; anything wrong is named with its line."""
    what = f"telemetry {path}"
    try:
        lines = log_bytes(path).decode("utf-8-sig").splitlines(keepends=True)
        counts: Counter[str] = Counter()
        if len(lines) > 2 and not lines[-1].endswith(("\n", "\r")):
            lines.pop()
            counts["last lines without an end: cut off"] += 1
        columns, rows = _table(what, lines)
    except (UnicodeDecodeError, csv.Error) as error:
        raise BadInput(what, expected="a CSV file", got=f"something else ({error})", mend=MEND) from error
    return _telemetry(what, path.name, columns, rows, counts)


def looks_like_csv(head: bytes, path: Path) -> bool:
    """Whether the file's first line is text with a comma in it, and not an ArduPilot log as text."""
    line = next(iter(head.splitlines()), b"")
    of_ardupilot = line.startswith(b"FMT,")
    text = b"\0" not in line and line.decode("utf-8-sig", "replace").isprintable()
    return b"," in line and text and not of_ardupilot


def write_csv(path: Path, samples: Iterable[Sample]) -> None:
    """Write velocities of one frame, and attitudes that share their stamps; `read_csv` gives them back."""
    ordered = list(samples)
    velocities = [sample for sample in ordered if isinstance(sample, VelocitySample)]
    attitudes = {s.stamp_ns: s.world_from_camera for s in ordered if isinstance(s, AttitudeSample)}
    frames = {velocity.frame for velocity in velocities}
    what = f"telemetry {path}"
    if len(frames) != 1:
        raise BadInput(what, expected="velocities of one frame", got=str(sorted(frames)))
    if attitudes and set(attitudes) != {velocity.stamp_ns for velocity in velocities}:
        raise BadInput(what, expected="an attitude at each velocity's stamp, or none", got="some")
    has_sigma = any(velocity.sigma is not None for velocity in velocities)
    optional = [*([SIGMA] if has_sigma else []), *(ATTITUDE["quaternion"] if attitudes else [])]
    lines = [",".join([STAMP, *VELOCITY[frames.pop()], *optional])]
    lines += [_line(velocity, has_sigma, attitudes.get(velocity.stamp_ns)) for velocity in velocities]
    write_atomic(path, ("\n".join(lines) + "\n").encode())


def _line(velocity: VelocitySample, has_sigma: bool, attitude: Vector | None) -> str:
    cells = [str(velocity.stamp_ns), *map(repr, velocity.velocity.tolist())]
    if has_sigma:
        cells.append("" if velocity.sigma is None else repr(float(velocity.sigma)))
    if attitude is not None:
        cells.extend(map(repr, attitude.tolist()))
    return ",".join(cells)


def _table(what: str, lines: Iterable[str]) -> tuple[Columns, list[Row]]:
    """The header, and the lines below it that are not blank."""
    reader = csv.reader(lines, skipinitialspace=True)
    header = [cell.strip() for cell in next(reader, [])]
    if not any(header):
        raise BadInput(
            what, expected="a header line and a line for each time", got="an empty file", mend=MEND
        )
    columns = Columns.of(what, header)
    rows = [
        Row.of(f"{what}, line {reader.line_num}", columns, cells)
        for cells in reader
        if any(cell.strip() for cell in cells)
    ]
    if not rows:
        raise BadInput(what, expected="a line for each time", got="only the header")
    return columns, rows


def _telemetry(
    what: str, name: str, columns: Columns, rows: Sequence[Row], counts: Counter[str]
) -> Telemetry:
    stamps_ns, places = [row.stamp_ns for row in rows], np.array([row.place for row in rows])
    kept = rising_counted(stamps_ns, counts, "velocities")
    samples = tuple(sample for index in kept for sample in rows[index].samples)
    if columns.frame in (ALONG, BY_PLACES):
        at_ns = np.array(stamps_ns)[kept]
        along: Sequence[Sample]
        if columns.frame == ALONG:
            expected = f"two positions or more within {MAX_GAP_S:g} s"
            along = samples_along(at_ns, np.array([row.metres for row in rows])[kept])
        else:
            expected = "a velocity, or positions that tell one"
            of = places[kept]
            along = velocities_by_fixes(at_ns, of[:, :2], of[:, 2], counts).samples()
        if not along:
            raise BadInput(what, expected=expected, got=none_of(counts))
        samples = by_time(along, samples)
    # Those that jump have been counted where the velocities are the slopes of the same.
    jumps = None if columns.frame == BY_PLACES else counts
    track = place_track(stamps_ns, places[:, :2], places[:, 2], SEA_LEVEL, jumps)
    told = [(row.stamp_ns, row.utc_ns) for row in rows if row.utc_ns is not None]
    log = Telemetry(
        f"CSV {name}: {_described(columns)}",
        samples,
        dict(+counts),
        any_direction=columns.frame == SPEED,
        places=track,
        utc=UniversalTime.by_readings(told, "column"),
    )
    first_ns = stamps_ns[kept[0]]
    of_1970 = can_be(first_ns)
    return log.counted_from(first_ns, UniversalTime(first_ns, "computer")) if of_1970 else log


def _described(columns: Columns) -> str:
    """What a file tells, and the columns in which it is not looked for."""
    by_positions = columns.frame in (ALONG, BY_PLACES)
    told = "speed, any direction" if columns.frame == SPEED else f"{columns.frame} velocity"
    text = f"velocity {columns.frame}" if by_positions else told
    if columns.ignored:
        text += f", ignored columns: {', '.join(columns.ignored)}"
    angles = any(angle in name for angle in ANGLES for name in columns.ignored)
    if angles and columns.frame != SPEED and not columns.attitude:
        text += f" (an attitude is read from {' or '.join(map(', '.join, ATTITUDE.values()))})"
    return text
