"""Parrot's video metadata as `vmeta-extract` writes it (libvideo-metadata), CSV or JSON.

    version   drones                            velocity                     view of the camera
    1         Bebop, Bebop 2 before 4.0         speed_x, _y, _z              not used: its frame is not documented
    2         Bebop 2 from 4.0, Disco           speed_north, _east, _down    frame_quat_w, _x, _y, _z
    3         Anafi, Anafi Thermal              speed_north, _east, _down    frame_quat_w, _x, _y, _z
    protobuf  Anafi USA, Ai and later           drone.speed                  camera.quat

CSV is separated by spaces (`vmeta-extract --csv`) or, made of the JSON by `vmeta_json_to_csv.py`, by commas.
JSON holds {"frame": [{"time": ..., "metadata": {...}}, ...]}. `time` is microseconds since the video's start.
`picture_hfov` (version 3) or `camera.hfov` (protobuf) is each picture's field of view in degrees, cropped and
zoomed. Quaternions turn the view's axes (forward, right, down) into north-east-down, w first. Version 1 names
its speed x, y, z; Parrot's library takes them for north, east, down, and so does this reader.

A row of versions 2 and 3 whose position is unknown lacks one cell, because the library leaves one out: the
columns after it are found by `frame_quat`, which must have length 1.
"""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from flightdepth.errors import BadInput
from flightdepth.flight.file_bytes import as_text, log_bytes
from flightdepth.flight.order import in_time_order
from flightdepth.flight.places import ELLIPSOID, SEA_LEVEL, AltitudeAbove, PlaceTrack
from flightdepth.flight.positions import place_track
from flightdepth.flight.records import (
    FASTEST_M_S,
    AttitudeSample,
    BodyAttitudeSample,
    Telemetry,
    VelocitySample,
    ViewTrack,
    by_time,
)
from flightdepth.motion import (
    NED_FROM_CAMERA,
    Vector,
    is_rotation,
    quaternion_from_rotation,
    rotation_from_quaternion,
)

NS_PER_US = 1000
ROUNDED = 0.02  # of a quaternion's length: the drones round to 14 bits
TIME_LIMIT_US = 1e12  # eleven days of video
FRAME = re.compile(r'\{\s*"time"\s*:')
SHIFTED_AFTER = "location_sv_count"
# Names of the columns, with the folded names of `vmeta_json_to_csv.py` last.
SPEEDS = [
    ("speed_north", "speed_east", "speed_down"),
    ("speed_x", "speed_y", "speed_z"),
    ("metadata_speed_north", "metadata_speed_east", "metadata_speed_down"),
    ("metadata_speed_x", "metadata_speed_y", "metadata_speed_z"),
    ("metadata_drone_speed_north", "metadata_drone_speed_east", "metadata_drone_speed_down"),
]
BODIES = ["drone_quat", "metadata_drone_quat"]  # the second also from the nested drone.quat of protobuf
VIEWS = ["frame_quat", "metadata_frame_quat", "metadata_camera_quat"]
PLACES = ["location", "metadata_location", "metadata_drone_location"]
# The first that is told; the last is the only one of older libraries.
ALTITUDES: dict[str, AltitudeAbove] = {
    "altitude_egm96amsl": SEA_LEVEL,
    "altitude_wgs84ellipsoid": ELLIPSOID,
    "altitude": SEA_LEVEL,
}
FIELDS_OF_VIEW = ("picture_hfov", "metadata_picture_hfov", "metadata_camera_hfov")


def looks_like_parrot(head: bytes, path: Path) -> bool:
    """A CSV header with the library's columns, or JSON with its frames."""
    text = as_text(head).lstrip()
    if text.startswith("{"):
        return FRAME.search(text) is not None or '"session"' in text
    return _speeds(_split(text.partition("\n")[0])) is not None


def read_parrot(path: Path) -> Telemetry:
    """Read what vmeta-extract wrote: velocities in the world frame and the attitude of the camera."""
    text = as_text(log_bytes(path))
    counts: Counter[str] = Counter()
    rows = _json_rows(text, counts) if text.lstrip().startswith("{") else _csv_rows(text, counts)
    velocities: list[VelocitySample] = []
    attitudes: list[AttitudeSample] = []
    bodies: list[BodyAttitudeSample] = []
    views: dict[int, float] = {}
    places: dict[int, Vector] = {}
    for row in rows:
        if not _take(row, velocities, attitudes, bodies, counts):
            continue
        places[velocities[-1].stamp_ns] = _place(row)
        if 1 < (hfov_deg := _hfov_deg(row)) < 170:
            views[velocities[-1].stamp_ns] = hfov_deg
    if not velocities:
        raise BadInput(
            f"telemetry {path}", expected="Parrot metadata with a speed", got="none that is a number"
        )
    velocities, attitudes = in_time_order(velocities, counts), in_time_order(attitudes, counts)
    name = f"Parrot metadata {path.name}: {len(velocities)} velocities"
    name += ", attitude of the camera" if attitudes else ""
    body_attitudes = tuple(in_time_order(bodies, counts))
    track = _track(places, counts)
    return Telemetry(
        name,
        by_time(velocities, attitudes),
        dict(+counts),
        body_attitudes=body_attitudes,
        view=_view_track(views),
        places=track,
    )


def _hfov_deg(row: Mapping[str, Any]) -> float:
    """Degrees, NaN where the row does not tell; what no lens has in degrees is taken for radians."""
    name = next((name for name in FIELDS_OF_VIEW if name in row), FIELDS_OF_VIEW[0])
    value = _number(row.get(name))
    return math.degrees(value) if 0 < value < math.pi else value


def _place(row: Mapping[str, Any]) -> Vector:
    """Latitude, longitude, and the altitudes of ALTITUDES; NaN where they are not told."""
    prefix = next((prefix for prefix in PLACES if f"{prefix}_latitude" in row), PLACES[0])
    names = ("latitude", "longitude", *ALTITUDES)
    return np.array([_number(row.get(f"{prefix}_{name}")) for name in names])


def _track(places: Mapping[int, Vector], counts: Counter[str]) -> PlaceTrack | None:
    table = np.stack(list(places.values()))
    column, above = next(
        ((i, above) for i, above in enumerate(ALTITUDES.values(), 2) if np.isfinite(table[:, i]).any()),
        (2, SEA_LEVEL),
    )
    return place_track(list(places), table[:, :2], table[:, column], above, counts)


def _view_track(views: Mapping[int, float]) -> ViewTrack | None:
    if not views:
        return None
    stamps = sorted(views)
    return ViewTrack(np.array(stamps, dtype=np.int64), np.array([views[stamp] for stamp in stamps]))


def _split(line: str) -> list[str]:
    return [cell.strip() for cell in line.split(",")] if "," in line else line.split()


def _speeds(columns: Sequence[str]) -> tuple[str, str, str] | None:
    if "time" not in columns:
        return None
    return next((names for names in SPEEDS if all(name in columns for name in names)), None)


def _csv_rows(text: str, counts: Counter[str]) -> Iterator[Mapping[str, Any]]:
    lines = text.splitlines()
    header = _split(lines[0]) if lines else []
    if len(lines) > 1 and not text.endswith(("\n", "\r")):
        counts["rows cut off at the end"] += 1
        lines.pop()
    for line in lines[1:]:
        if line.strip():
            yield _row(header, _split(line))


def _row(header: Sequence[str], cells: list[str]) -> Mapping[str, Any]:
    row = dict(zip(header, cells, strict=False))
    if row.get("location_valid") == "0" and SHIFTED_AFTER in header:
        at = header.index(SHIFTED_AFTER)
        shifted = dict(zip(header, [*cells[:at], "0", *cells[at:]], strict=False))
        told, moved = (is_rotation(_quaternion(each, VIEWS), ROUNDED) for each in (row, shifted))
        if moved and not told:
            return shifted
    return row


def _json_rows(text: str, counts: Counter[str]) -> Iterator[Mapping[str, Any]]:
    """Each frame on its own, so that a damaged or cut one costs only itself."""
    decoder = json.JSONDecoder()
    starts = [match.start() for match in FRAME.finditer(text)]
    for start, end in pairwise([*starts, len(text)]):
        try:
            frame, length = decoder.raw_decode(text[start:end])
            row = dict(_folded(frame))
        except (ValueError, RecursionError):
            counts["damaged or cut frames"] += 1
            continue
        yield row
        if end == len(text) and "]" not in text[start + length :]:
            counts["lists of frames cut off"] += 1


def _folded(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Nested objects as one row, their names joined as `vmeta_json_to_csv.py` joins them."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _folded(inner, f"{name}_{key}" if name else key)
    else:
        yield name, value


def _take(
    row: Mapping[str, Any],
    velocities: list[VelocitySample],
    attitudes: list[AttitudeSample],
    bodies: list[BodyAttitudeSample],
    counts: Counter[str],
) -> bool:
    """Read one row; whether it was sound."""
    names = _speeds(list(row))
    time_us = _number(row.get("time"))
    velocity = np.array([_number(row.get(name)) for name in names or SPEEDS[0]])
    view, body = _quaternion(row, VIEWS), _quaternion(row, BODIES)
    # A row that lost or gained cells shows in a view that is no rotation; all zeros are an unknown view.
    sound = is_rotation(view, ROUNDED)
    damaged = bool(np.isfinite(view).any() and view.any()) and not sound
    if damaged or not math.isfinite(time_us) or not np.isfinite(velocity).all():
        counts["rows without a time, a speed or a sound view"] += 1
        return False
    if np.abs(velocity).max() > FASTEST_M_S or not 0 <= time_us < TIME_LIMIT_US:
        counts["rows beyond reason"] += 1
        return False
    stamp_ns = round(time_us * NS_PER_US)
    velocities.append(VelocitySample(stamp_ns, velocity))
    if sound and names is not None and not names[0].endswith("_x"):
        world_from_camera = rotation_from_quaternion(view) @ NED_FROM_CAMERA
        attitudes.append(AttitudeSample(stamp_ns, quaternion_from_rotation(world_from_camera)))
    if is_rotation(body, ROUNDED):
        bodies.append(BodyAttitudeSample(stamp_ns, body))
    return True


def _quaternion(row: Mapping[str, Any], prefixes: Sequence[str]) -> Vector:
    prefix = next((prefix for prefix in prefixes if f"{prefix}_w" in row), prefixes[0])
    return np.array([_number(row.get(f"{prefix}_{axis}")) for axis in "wxyz"])


def _number(value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        return math.nan
