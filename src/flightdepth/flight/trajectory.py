"""Trajectories in TUM's format, as SLAM, visual odometry, data sets and evo write them: where the camera was.

A line a pose: time in seconds, position x y z in metres, attitude qx qy qz qw, world from camera; # begins a comment.
The camera's axes are right, down, forward. The world's may be any: z up, as in ROS, or those of the first camera.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np

from flightdepth.errors import BadInput
from flightdepth.flight.file_bytes import as_text, log_bytes
from flightdepth.flight.metric_positions import velocities_along
from flightdepth.flight.order import rising
from flightdepth.flight.records import (
    LATEST_NS,
    MAX_GAP_S,
    NS_PER_S,
    AttitudeSample,
    Telemetry,
    by_time,
    none_of,
)
from flightdepth.flight.universal_time import UniversalTime, can_be
from flightdepth.motion import (
    NED_FROM_CAMERA,
    NED_FROM_ENU,
    Vector,
    quaternion_from_rotation,
    rotation_angle_rad,
    rotations_from_quaternions,
)

NUMBERS = 8  # a line
SAME_RAD = np.radians(5)
DAMAGED, LATE = "lines damaged or cut off", "poses not later than the one before"
LEAST_LENGTH, LARGEST_LENGTH = 0.9, 1.1  # of a quaternion; TUM's own are rounded to four digits


def looks_like_trajectory(head: bytes, path: Path) -> bool:
    """Whether the first line that is no comment is eight numbers with blanks between them, the last four a rotation."""
    if path.is_dir():
        return False
    lines = (
        line for line in as_text(head).splitlines() if line.strip() and not line.lstrip().startswith("#")
    )
    return _pose(next(lines, "")) is not None


def read_trajectory(path: Path) -> Telemetry:
    """Read poses of the camera: velocities along them in the world frame, and attitudes.

    Times since 1970 tell universal time, and time 0 is the first pose then; others count from the first picture.
    """
    counts: Counter[str] = Counter()
    lines = [line for line in as_text(log_bytes(path)).splitlines() if line.strip()]
    told = [_pose(line) for line in lines if not line.lstrip().startswith("#")]
    poses = [pose for pose in told if pose is not None]
    counts[DAMAGED] += len(told) - len(poses)
    kept = rising([stamp_ns for stamp_ns, _ in poses])
    counts[LATE] += len(poses) - len(kept)
    if not kept:
        raise _tells_no_way(path, counts)
    stamps_ns = np.array([poses[place][0] for place in kept], dtype=np.int64)
    rows = np.array([poses[place][1] for place in kept])
    quaternions = rows[:, [6, 3, 4, 5]] / np.linalg.norm(rows[:, 3:], axis=1, keepdims=True)
    turns = rotations_from_quaternions(quaternions)
    down, ned_from_world = world_axes(turns)
    velocities = velocities_along(stamps_ns, rows[:, :3] @ ned_from_world.T, counts)
    if not velocities:
        raise _tells_no_way(path, counts)
    attitudes = [
        AttitudeSample(stamp_ns, quaternion_from_rotation(turn))
        for stamp_ns, turn in zip(stamps_ns.tolist(), ned_from_world @ turns, strict=True)
    ]
    zero_ns = int(stamps_ns[0]) if can_be(int(stamps_ns[0])) else 0
    name = f"trajectory {path.name}: {len(stamps_ns)} poses of the camera, {down} down"
    if zero_ns:
        name += f"; its time 0 is {zero_ns / NS_PER_S:.3f} s of its clock"
    samples = by_time(velocities, attitudes)
    log = Telemetry(name, samples, dict(+counts), true_north=False, time_0_told=not zero_ns)
    return replace(log.later_by(-zero_ns), utc=UniversalTime.of(zero_ns, "computer"))


def world_axes(turns: Vector) -> tuple[str, Vector]:
    """What of the world points down, and its rotation (3, 3) to north, east, down.

    By cameras [n, 3, 3], world from right-down-forward, which stand upright. A world in which the first lies as in its
    own axes is that camera's, taken to look level. Of others z is up, as in ROS, with y for north; or down, with x.
    """
    if rotation_angle_rad(turns[0]) < SAME_RAD:
        return "y", NED_FROM_CAMERA
    downwards = float((turns[:, 2, 1] + turns[:, 2, 2]).sum())  # along z, of what is below and what is ahead
    return ("z", np.eye(3)) if downwards > 0 else ("-z", NED_FROM_ENU)


def _tells_no_way(path: Path, counts: Counter[str]) -> BadInput:
    expected = f"two poses or more within {MAX_GAP_S:g} s"
    return BadInput(f"telemetry {path}", expected=expected, got=none_of(counts))


def _pose(line: str) -> tuple[int, list[float]] | None:
    """Nanoseconds, and x y z qx qy qz qw; None where the line is no pose."""
    cells = line.split()
    if len(cells) != NUMBERS:
        return None
    try:
        stamp_ns = round(Decimal(cells[0]) * NS_PER_S)
        numbers = [float(cell) for cell in cells[1:]]
    except (InvalidOperation, ValueError, OverflowError):
        return None
    sound = all(map(math.isfinite, numbers)) and abs(stamp_ns) < LATEST_NS
    return (stamp_ns, numbers) if sound and LEAST_LENGTH < math.hypot(*numbers[3:]) < LARGEST_LENGTH else None
