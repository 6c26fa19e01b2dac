"""Trajectories in TUM's format, as SLAM, visual odometry, data sets and evo write them: where the camera was.

A line a pose: time, position x y z in metres, attitude qx qy qz qw, world from camera; # begins a comment. OpenVINS
may write twelve numbers of covariance behind. The camera's axes are right, down, forward. The world's may be any: z up,
as in ROS, or those of the first camera.
"""

from __future__ import annotations

from collections import Counter
from decimal import Decimal
from pathlib import Path

import numpy as np

from flightdepth.errors import BadInput
from flightdepth.flight.file_bytes import as_text, log_bytes
from flightdepth.flight.metric_positions import FARTHEST_M, samples_along
from flightdepth.flight.order import rising_counted
from flightdepth.flight.records import (
    LATEST_NS,
    MAX_GAP_S,
    NS_PER_S,
    AttitudeSample,
    Telemetry,
    by_time,
    none_of,
    time_0_is,
)
from flightdepth.flight.universal_time import UniversalTime, can_be
from flightdepth.motion import (
    NED_FROM_CAMERA,
    NED_FROM_ENU,
    Vector,
    is_rotation,
    quaternion_from_rotation,
    quaternion_products,
    rotation_angle_rad,
    rotation_from_quaternion,
    rotations_from_quaternions,
)

POSE, COVARIANCE = 8, 12  # numbers of a line
# Times since 1970 are seconds, and beyond these milli-, micro- and nanoseconds.
UNITS_NS = ((Decimal(10**17), 1), (Decimal(10**14), 10**3), (Decimal(10**11), 10**6), (Decimal(0), NS_PER_S))
SAME_RAD = np.radians(5)
DAMAGED = "lines damaged or cut off"


def looks_like_trajectory(head: bytes, path: Path) -> bool:
    """Whether the first line that is no comment is a pose: numbers between blanks, four of them a rotation."""
    lines = (line for line in as_text(head).splitlines() if not _is_empty(line))
    return _pose(next(lines, "")) is not None


def read_trajectory(path: Path) -> Telemetry:
    """Read poses of the camera: positions and velocities along them in the world frame, and attitudes.

    Times since 1970 tell universal time, and time 0 is the first pose then; others count from the first picture.
    """
    counts: Counter[str] = Counter()
    told = [_pose(line) for line in as_text(log_bytes(path)).splitlines() if not _is_empty(line)]
    poses = [pose for pose in told if pose is not None]
    counts[DAMAGED] += len(told) - len(poses)
    kept = rising_counted([stamp_ns for stamp_ns, _ in poses], counts, "poses")
    samples, down, zero_ns = [], "", 0
    if kept:
        stamps_ns = np.array([poses[place][0] for place in kept], dtype=np.int64)
        zero_ns = int(stamps_ns[0]) if can_be(int(stamps_ns[0])) else 0
        stamps_ns -= zero_ns
        rows = np.array([poses[place][1] for place in kept])
        quaternions = rows[:, [6, 3, 4, 5]] / np.linalg.norm(rows[:, 3:], axis=1, keepdims=True)
        down, ned_from_world = world_axes(quaternions)
        samples = samples_along(stamps_ns, rows[:, :3] @ ned_from_world.T)
    if not samples:
        expected = f"two poses or more within {MAX_GAP_S:g} s"
        raise BadInput(f"telemetry {path}", expected=expected, got=none_of(counts))
    turned = quaternion_products(quaternion_from_rotation(ned_from_world), quaternions)
    attitudes = [AttitudeSample(at, each) for at, each in zip(stamps_ns.tolist(), turned, strict=True)]
    name = f"trajectory {path.name}: {len(kept)} poses of the camera, {down} down"
    if zero_ns:
        name += time_0_is(zero_ns)
    utc = UniversalTime.of(zero_ns, "computer")
    by_stamp = by_time(samples, attitudes)
    return Telemetry(name, by_stamp, dict(+counts), true_north=False, time_0_told=not zero_ns, utc=utc)


def world_axes(quaternions: Vector) -> tuple[str, Vector]:
    """What of the world points down, and its rotation (3, 3) to north, east, down.

    By cameras [n, 4], world from right-down-forward, which stand upright. A world in which the first lies as in its
    own axes is that camera's, taken to look level. Of others z is up, as in ROS, with y for north; or down, with x.
    """
    if rotation_angle_rad(rotation_from_quaternion(quaternions[0])) < SAME_RAD:
        return "y", NED_FROM_CAMERA
    turns = rotations_from_quaternions(quaternions)
    downwards = float((turns[:, 2, 1] + turns[:, 2, 2]).sum())  # along z, of what is below and what is ahead
    return ("z", np.eye(3)) if downwards > 0 else ("-z", NED_FROM_ENU)


def _is_empty(line: str) -> bool:
    return not line.strip() or line.lstrip().startswith("#")


def _pose(line: str) -> tuple[int, list[float]] | None:
    """Nanoseconds, and x y z qx qy qz qw; None where the line is no pose."""
    cells = line.split()
    if len(cells) not in (POSE, POSE + COVARIANCE):
        return None
    try:
        told = Decimal(cells[0])
        if not abs(told) < LATEST_NS:  # True for NaN too
            return None
        stamp_ns = round(told * next(unit_ns for least, unit_ns in UNITS_NS if abs(told) >= least))
        numbers = [float(cell) for cell in cells[1:POSE]]
    except (ArithmeticError, ValueError):
        return None
    sound = all(abs(number) < FARTHEST_M for number in numbers) and abs(stamp_ns) < LATEST_NS
    return (stamp_ns, numbers) if sound and is_rotation(numbers[3:]) else None
