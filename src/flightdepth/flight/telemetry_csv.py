"""Telemetry as a CSV file: one header line, then one line for each time.

Columns, in any order:

    stamp_ns  or  time_s                                since the video's first picture (int ns, or seconds)
    vn_m_s, ve_m_s, vd_m_s                              velocity north, east, down (world), or
    vx_camera_m_s, vy_camera_m_s, vz_camera_m_s         velocity right, down, forward (camera), or
    speed_m_s                                           its length alone: the direction is seen in the pictures, or
    none of these, but a place                          from which it comes
    sigma_m_s                                           optional: its standard deviation
    qw, qx, qy, qz                                      optional: attitude, world (NED) from camera, or
    camera_yaw_deg, camera_pitch_deg, camera_roll_deg   from north clockwise, up, right side down
    latitude_deg, longitude_deg, altitude_m             optional: where on Earth (WGS 84), above mean sea level

Other columns are ignored, and the telemetry's name says which. Lines whose time is not later than the one before
are left out and counted, and so is a last line without its end: it was cut off. Anything else that is wrong is
refused with its line, for who writes such a file can mend it.
"""

from __future__ import annotations

import csv
import math
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flightdepth.errors import BadInput
from flightdepth.files import write_atomic
from flightdepth.flight.csv_columns import (
    ALTITUDE,
    ANGLES,
    ATTITUDE,
    BY_PLACES,
    MEND,
    PLACE,
    SIGMA,
    SPEED,
    STAMP,
    TIME,
    VELOCITY,
    Columns,
)
from flightdepth.flight.file_bytes import log_bytes
from flightdepth.flight.gimbal import looking_along
from flightdepth.flight.order import rising
from flightdepth.flight.places import SEA_LEVEL
from flightdepth.flight.positions import UNFIXED, on_earth, place_track, velocities_by_fixes
from flightdepth.flight.records import (
    FASTEST_M_S,
    LATEST_NS,
    NS_PER_S,
    AttitudeSample,
    Sample,
    Telemetry,
    VelocityFrame,
    VelocitySample,
    by_time,
    none_of,
    northwards,
    seconds,
)
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
        return _read(what, path.name, csv.reader(lines, skipinitialspace=True), counts)
    except (UnicodeDecodeError, csv.Error) as error:
        raise BadInput(what, expected="a CSV file", got=f"something else ({error})", mend=MEND) from error


def looks_like_csv(head: bytes, path: Path) -> bool:
    """Whether the file's first line is text with a comma in it, and not an ArduPilot log as text."""
    line = head.split(b"\n", 1)[0].rstrip(b"\r")
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


def _read(what: str, name: str, rows: Iterable[list[str]], counts: Counter[str]) -> Telemetry:
    iterator = iter(rows)
    header = [cell.strip() for cell in next(iterator, [])]
    if not any(header):
        raise BadInput(
            what, expected="a header line and a line for each time", got="an empty file", mend=MEND
        )
    columns = Columns.of(what, header)
    stamps_ns: list[int] = []
    read: list[list[Sample]] = []
    places: list[list[float]] = []
    for line, row in enumerate(iterator, start=2):
        if not any(cell.strip() for cell in row):
            continue
        where = f"{what}, line {line}"
        cells = _cells(where, header, row)
        stamps_ns.append(_stamp(where, columns.time, cells))
        read.append(_samples(where, columns, cells, stamps_ns[-1]))
        places.append(_place(where, columns, cells))
    if not read:
        raise BadInput(what, expected="a line for each time", got="only the header")
    kept = rising(stamps_ns)
    if len(kept) < len(read):
        counts["velocities not later than the one before"] += len(read) - len(kept)
    ignored = f", ignored columns: {', '.join(columns.ignored)}" if columns.ignored else ""
    if (
        columns.frame != SPEED
        and not columns.attitude
        and any(angle in name for angle in ANGLES for name in columns.ignored)
    ):
        ignored += f" (an attitude is read from {' or '.join(map(', '.join, ATTITUDE.values()))})"
    samples = tuple(sample for index in kept for sample in read[index])
    told = {SPEED: "speed, any direction", BY_PLACES: "velocity by its positions"}
    table = np.array(places)
    if columns.frame == BY_PLACES:
        slopes = _by_places(what, np.array(stamps_ns)[kept], table[kept], counts)
        samples = by_time(slopes, samples)
    # Those that jump have been counted where the velocities are the slopes of the same.
    jumps = Counter[str]() if columns.frame == BY_PLACES else counts
    track = place_track(stamps_ns, table[:, :2], table[:, 2], SEA_LEVEL, jumps)
    return Telemetry(
        f"CSV {name}: {told.get(columns.frame, f'{columns.frame} velocity')}{ignored}",
        samples,
        dict(+counts),
        any_direction=columns.frame == SPEED,
        places=track,
    )


def _cells(where: str, header: Sequence[str], row: Sequence[str]) -> dict[str, str]:
    if len(row) != len(header):
        raise BadInput(where, expected=f"{len(header)} cells", got=str(len(row)))
    return dict(zip(header, row, strict=True))


def _by_places(
    what: str, stamps_ns: NDArray[np.int64], places: Vector, counts: Counter[str]
) -> list[VelocitySample]:
    """Velocities from places [n, 3] at rising stamps [n]."""
    fixed = on_earth(places[:, :2])
    counts[UNFIXED] += int((~fixed).sum())
    found = velocities_by_fixes(stamps_ns[fixed], places[fixed, :2], places[fixed, 2], counts)
    if not len(found):
        raise BadInput(what, expected="a velocity, or positions that tell one", got=none_of(counts))
    return found.samples()


def _samples(where: str, columns: Columns, cells: dict[str, str], stamp_ns: int) -> list[Sample]:
    """What a line itself tells of velocity and attitude."""
    velocity = None if columns.frame == BY_PLACES else _velocity(where, columns, cells)
    sigma = _optional(where, columns, cells, SIGMA)
    try:
        samples: list[Sample] = []
        if velocity is not None:
            frame: VelocityFrame = "camera" if columns.frame == "camera" else "world"
            samples.append(VelocitySample(stamp_ns, velocity, frame, sigma))
        if columns.attitude:
            numbers = _numbers(where, cells, ATTITUDE[columns.attitude])
            told = columns.attitude == "angles"
            samples.append(AttitudeSample(stamp_ns, looking_along(*numbers) if told else _unit(numbers)))
    except BadInput as error:
        raise BadInput(f"{where}: {error}") from error
    return samples


def _velocity(where: str, columns: Columns, cells: dict[str, str]) -> Vector:
    velocity = _numbers(where, cells, VELOCITY[columns.frame])
    if columns.frame == SPEED:
        if velocity[0] < 0:
            raise BadInput(where, expected="a speed of 0 m/s or more", got=f"{velocity[0]:g}")
        velocity = northwards(velocity[0])
    if (speed := float(np.linalg.norm(velocity))) > FASTEST_M_S:
        raise BadInput(
            where, expected=f"at most {FASTEST_M_S:g} m/s", got=f"{speed:.0f}", mend="Velocities are in m/s."
        )
    return velocity


def _place(where: str, columns: Columns, cells: dict[str, str]) -> list[float]:
    """Latitude, longitude, altitude; NaN where they are not told."""
    told = [_optional(where, columns, cells, name) for name in (*PLACE, ALTITUDE)]
    place = [math.nan if number is None else number for number in told]
    if abs(place[0]) > 90 or abs(place[1]) > 180:
        got = ", ".join(f"{number:g}" for number in place[:2])
        raise BadInput(where, expected="a latitude within 90 degrees and a longitude within 180", got=got)
    return place


def _unit(quaternion: Vector) -> Vector:
    if not 0.9 < np.linalg.norm(quaternion) < 1.1:
        got = ", ".join(f"{number:g}" for number in quaternion)
        raise BadInput("attitude", expected="a quaternion qw, qx, qy, qz of length 1", got=got)
    return quaternion


def _stamp(where: str, column: str, cells: dict[str, str]) -> int:
    try:
        stamp_ns = int(cells[STAMP]) if column == STAMP else _number(where, cells, TIME) * NS_PER_S
    except ValueError as error:
        raise BadInput(where, expected=f"{STAMP} as a whole number", got=repr(cells[STAMP])) from error
    if abs(stamp_ns) > LATEST_NS:
        raise BadInput(where, expected=f"a time within {seconds(LATEST_NS)}", got=cells[column].strip())
    return round(stamp_ns)


def _numbers(where: str, cells: dict[str, str], names: Sequence[str]) -> Vector:
    return np.array([_number(where, cells, name) for name in names])


def _optional(where: str, columns: Columns, cells: dict[str, str], name: str) -> float | None:
    return _number(where, cells, name) if name in columns.optional and cells[name].strip() else None


def _number(where: str, cells: dict[str, str], name: str) -> float:
    try:
        number = float(cells[name])
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise BadInput(where, expected=f"a finite number for {name}", got=repr(cells[name].strip()))
    return number
