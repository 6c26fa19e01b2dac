"""DJI flight records decoded to CSV: AirData's, PhantomHelp's Flight Reader and TXTlogToCSVtool, Litchi's.

dji_columns.py reads the columns, dji_speeds.py tells the velocity. Gimbal and body angles are yaw from north
clockwise, pitch up, roll to the right, as in DJI's subtitles; the gimbal's yaw is put right by the drone's where it
follows that (gimbal_heading.py). A log covers the flight: its columns also tell when videos were recorded.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from flightdepth.errors import BadInput
from flightdepth.flight.dji_columns import FlightTable, flight_table, header_and_rows
from flightdepth.flight.dji_speeds import flown
from flightdepth.flight.gimbal_heading import followed_offset_deg
from flightdepth.flight.recordings import recordings_in
from flightdepth.flight.records import (
    NS_PER_S,
    AttitudeSample,
    BodyAttitudeSample,
    Sample,
    Telemetry,
    VelocitySample,
)
from flightdepth.motion import NED_FROM_CAMERA, Vector, quaternion_from_rotation, rotation_from_euler

LEAST_TOLD_DEG = 2.0  # a gimbal's yaw that is put right by less is not worth a word


def looks_like_dji_record(head: bytes, path: Path) -> bool:
    """A header line with the columns of one of the layouts."""
    return not path.is_dir() and header_and_rows(_text(head))[0].is_record


def read_dji_record(path: Path) -> Telemetry:
    """Read a flight record: velocities in the world frame, attitudes, and when videos were recorded.

    Time 0 is the first velocity; `recordings.at_recording` moves it to a video's first picture.
    """
    what = f"telemetry {path}"
    try:
        text = _text(path.read_bytes())
    except OSError as error:
        got = error.strerror or str(error)
        raise BadInput(what, expected="a flight record that can be read", got=got) from error
    counts: Counter[str] = Counter()
    table = flight_table(text, counts)
    found = flown(table, counts)
    if found is None or not len(found.velocities.stamps_ns):
        expected = "a flight record with speeds or two GPS positions"
        why = ", ".join(f"{count} {reason}" for reason, count in (+counts).items())
        raise BadInput(what, expected=expected, got=f"none ({why})" if why else "none")
    cameras, heading = _cameras(table)
    table_of = zip(
        found.velocities.stamps_ns.tolist(),
        found.velocities.velocity_ned,
        found.velocities.sigma.tolist(),
        strict=True,
    )
    samples: list[Sample] = [VelocitySample(stamp, ned, "world", sigma) for stamp, ned, sigma in table_of]
    zero_ns, count = samples[0].stamp_ns, len(samples)
    samples = sorted([*samples, *cameras], key=lambda sample: sample.stamp_ns)
    recordings = () if table.recording is None else recordings_in(table.stamps_ns, table.recording)
    name = f"{table.maker} {path.name}: {count} velocities {found.source}{heading}"
    if not recordings:
        name += f"; time 0 is its first velocity, {zero_ns / NS_PER_S:.3f} s of its clock"
    return Telemetry(
        name,
        tuple(samples),
        dict(+counts),
        body_attitudes=tuple(_bodies(table)),
        recordings=recordings,
    ).later_by(-zero_ns)


def _text(data: bytes) -> str:
    """UTF-8 or UTF-16 by its first bytes; in other encodings only degree signs and messages are lost."""
    encoding = "utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    return data.decode(encoding, errors="replace")


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
    rotations = [_rotation(each) @ NED_FROM_CAMERA for each in angles_deg]
    stamps_ns = table.stamps_ns[known].tolist()
    cameras = [
        AttitudeSample(stamp_ns, quaternion_from_rotation(rotation))
        for stamp_ns, rotation in zip(stamps_ns, rotations, strict=True)
    ]
    return cameras, f", gimbal attitude{heading}"


def _bodies(table: FlightTable) -> list[BodyAttitudeSample]:
    known = np.isfinite(table.body_deg).all(axis=1)
    pairs = zip(table.stamps_ns[known].tolist(), table.body_deg[known], strict=True)
    return [BodyAttitudeSample(stamp, quaternion_from_rotation(_rotation(each))) for stamp, each in pairs]


def _rotation(yaw_pitch_roll_deg: Vector) -> Vector:
    yaw, pitch, roll = np.deg2rad(yaw_pitch_roll_deg)
    return rotation_from_euler(roll, pitch, yaw)
