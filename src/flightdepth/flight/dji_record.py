"""DJI flight records decoded to CSV: AirData's, PhantomHelp's Flight Reader and TXTlogToCSVtool, Litchi's.

dji_header.py knows the columns, dji_columns.py reads them, dji_speeds.py tells the velocity. Gimbal and body angles
are yaw from north clockwise, pitch up, roll to the right, as in DJI's subtitles; the gimbal's yaw is put right by the
drone's where it follows that (gimbal_heading.py). A log covers the flight: its columns also tell when videos were
recorded.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from flightdepth.errors import BadInput
from flightdepth.flight.dji_columns import FlightTable, flight_table
from flightdepth.flight.dji_header import header_and_rows
from flightdepth.flight.dji_speeds import flown
from flightdepth.flight.file_bytes import as_text, log_bytes
from flightdepth.flight.gimbal import looking_along, turned
from flightdepth.flight.gimbal_heading import followed_offset_deg
from flightdepth.flight.places import SEA_LEVEL
from flightdepth.flight.positions import place_track
from flightdepth.flight.recordings import recordings_in
from flightdepth.flight.records import (
    NS_PER_S,
    AttitudeSample,
    BodyAttitudeSample,
    Telemetry,
    by_time,
    none_of,
)
from flightdepth.flight.universal_time import UniversalTime

LEAST_TOLD_DEG = 2.0  # a gimbal's yaw that is put right by less is not worth a word


def looks_like_dji_record(head: bytes, path: Path) -> bool:
    """A header line with the columns of one of the layouts."""
    return header_and_rows(as_text(head))[0].is_record


def read_dji_record(path: Path) -> Telemetry:
    """Read a flight record: velocities in the world frame, attitudes, and when videos were recorded.

    Time 0 is the first velocity; `recordings.at_recording` moves it to a video's first picture.
    """
    counts: Counter[str] = Counter()
    table = flight_table(as_text(log_bytes(path)), counts)
    found, source = flown(table, counts)
    if not len(found):
        expected = "a flight record with speeds or two GPS positions"
        raise BadInput(f"telemetry {path}", expected=expected, got=none_of(counts))
    cameras, heading = _cameras(table)
    zero_ns = int(found.stamps_ns[0])
    recordings = () if table.recording is None else recordings_in(table.stamps_ns, table.recording)
    name = f"{table.maker} {path.name}: {len(found)} velocities {source}{heading}"
    if not recordings:
        name += f"; time 0 is its first velocity, {zero_ns / NS_PER_S:.3f} s of its clock"
    return Telemetry(
        name,
        by_time(found.samples(), cameras),
        dict(+counts),
        body_attitudes=tuple(_bodies(table)),
        recordings=recordings,
        time_0_told=bool(recordings),
        utc=UniversalTime.by_readings(table.moments, "app"),
        # Not counted: those that jump have been.
        places=place_track(table.stamps_ns, table.places_deg, table.altitudes_m, SEA_LEVEL),
    ).later_by(-zero_ns)


def _cameras(table: FlightTable) -> tuple[list[AttitudeSample], str]:
    """The camera's attitudes by the gimbal, and a word on its heading; none where it tells nothing but zeros."""
    yaw, pitch, roll = table.gimbal_deg.T
    known = np.isfinite(yaw) & np.isfinite(pitch)
    if not (np.nan_to_num(table.gimbal_deg[known]) != 0).any():
        return [], ""
    heading = ""
    offset_deg = None
    if table.follows is not False:
        offset_deg = followed_offset_deg(table.stamps_ns / NS_PER_S, yaw, table.body_deg[:, 0])
    if offset_deg is not None:
        yaw = yaw + offset_deg
        middle_deg = float(np.median(offset_deg))
        if abs(middle_deg) > LEAST_TOLD_DEG:
            heading = f", its yaw turned by {middle_deg:+.0f} deg to the drone's, which it follows"
    angles_deg = np.stack([yaw, pitch, np.nan_to_num(roll)], axis=1)[known]
    pairs = zip(table.stamps_ns[known].tolist(), angles_deg, strict=True)
    cameras = [AttitudeSample(stamp_ns, looking_along(*angles)) for stamp_ns, angles in pairs]
    return cameras, f", gimbal attitude{heading}"


def _bodies(table: FlightTable) -> list[BodyAttitudeSample]:
    known = np.isfinite(table.body_deg).all(axis=1)
    pairs = zip(table.stamps_ns[known].tolist(), table.body_deg[known], strict=True)
    return [BodyAttitudeSample(stamp_ns, turned(*angles)) for stamp_ns, angles in pairs]
