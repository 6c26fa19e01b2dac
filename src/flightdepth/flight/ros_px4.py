"""PX4's own messages in ROS 2 recordings (`px4_msgs`, published over uXRCE-DDS): velocity, attitude, gimbal, place.

What their fields mean is what `ulog` knows. Only VehicleOdometry is read here alone.

Stamps are microseconds: of the ROS clock where PX4 keeps in time with its agent (parameter UXRCE_DDS_SYNCT, on by
default), else of PX4's own, which starts with its power. That one is far from the time of recording, and moved to it
by the median of what lies between the two: so by the way of a message too, some hundredths of a second.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from flightdepth.flight.autopilot import LAST_STAMP_US, Gate, Moment, Position, Record, Velocity
from flightdepth.flight.power_ups import SHORTEST_RUN, boots
from flightdepth.flight.records import LATEST_NS, NS_PER_S, BodyAttitudeSample
from flightdepth.flight.ros_messages import Twist, decoded
from flightdepth.flight.ros_places import Fix
from flightdepth.flight.ros_records import DamagedError, RosMessage
from flightdepth.flight.ulog import (
    QUATERNION,
    Columns,
    body_attitudes,
    complete_records,
    gimbal_attitudes,
    global_positions,
    timed,
    velocities,
)
from flightdepth.motion import rotations_from_quaternions

PX4_POSITION = "px4_msgs/msg/VehicleLocalPosition"
PX4_ODOMETRY = "px4_msgs/msg/VehicleOdometry"
PX4_ATTITUDE = "px4_msgs/msg/VehicleAttitude"
PX4_GIMBAL = "px4_msgs/msg/GimbalDeviceAttitudeStatus"
PX4_VELOCITY_KINDS = (PX4_POSITION, PX4_ODOMETRY)  # best first
PX4_PLACE = "px4_msgs/msg/VehicleGlobalPosition"
PX4_KINDS = (*PX4_VELOCITY_KINDS, PX4_ATTITUDE, PX4_GIMBAL, PX4_PLACE)
# Those of the messages above, in any version since PX4 1.13, but for their times.
FIELDS = (
    *("q", "quat_reset_counter"),
    *("v_xy_valid", "v_z_valid", "vx", "vy", "vz", "evh", "evv"),
    *("velocity_frame", "velocity", "velocity_variance", "velocity_covariance"),
    *("device_flags", "delta_yaw"),
    *("lat", "lon", "alt", "lat_lon_valid", "alt_valid"),
)
UNDEFINED = "messages of PX4 whose definition the recording does not hold"
DEFINE = (
    "Record as MCAP (ros2 bag record -s mcap) in a shell where px4_msgs is sourced, or turn this recording into MCAP "
    "there (ros2 bag convert)."
)
IN_STEP_NS = NS_PER_S  # a stamp this near to the time of recording is of the same clock
SAMPLED_BEFORE_US = 1_000_000  # a time of measurement longer before that of publication is not set


class OdometryFields(NamedTuple):
    """How a version of VehicleOdometry tells a velocity; `worlds` are the frames that do not turn with the body."""

    velocity: Sequence[str]
    variances: Sequence[str]
    worlds: Sequence[int]


SINCE_1_14 = OdometryFields(
    [f"velocity[{axis}]" for axis in range(3)], [f"velocity_variance[{axis}]" for axis in range(3)], [1, 2]
)
UNTIL_1_13 = OdometryFields(
    ["vx", "vy", "vz"], [f"velocity_covariance[{diagonal}]" for diagonal in (0, 6, 11)], [0, 1]
)
BODY_FRD = 3  # in both


@dataclass
class Px4Rows:
    """What a topic's messages said: the fields that are of use, a row for each message."""

    fields: tuple[str, ...] = ()
    rows: list[tuple[float, ...]] = field(default_factory=list)

    def take(self, message: RosMessage) -> None:
        """Add a message; one of other fields than the first is damage."""
        content = decoded(message)
        row = {"received_ns": min(message.log_ns, LATEST_NS), "timestamp": _stamp_us(content)}
        row |= _numbers(content)
        self.fields = self.fields or tuple(row)
        if self.fields != tuple(row):
            raise DamagedError("a message of other fields than the one before")
        self.rows.append(tuple(row.values()))

    def columns(self) -> Columns:
        """As `ulog` has them."""
        return dict(zip(self.fields, map(np.array, zip(*self.rows, strict=True)), strict=True))


def _stamp_us(content: Any) -> int:
    """Of the measurement where the message tells it, else of its publication."""
    told_us, sampled_us = (getattr(content, name, None) for name in ("timestamp", "timestamp_sample"))
    if not isinstance(told_us, int):
        raise DamagedError("a message without a time")
    if isinstance(sampled_us, int) and 0 <= told_us - sampled_us <= SAMPLED_BEFORE_US:
        told_us = sampled_us
    return min(told_us, LAST_STAMP_US)


def _numbers(content: Any) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name in FIELDS:
        value = getattr(content, name, None)
        if isinstance(value, np.ndarray):
            found |= {f"{name}[{index}]": part for index, part in enumerate(value.tolist())}
        elif value is not None:
            found[name] = value
    return found


def px4_gate(
    kind: str, columns: Columns, ahead_ns: int, bodies: Sequence[BodyAttitudeSample], counts: Counter[str]
) -> tuple[Gate, list[Fix]]:
    """What is sound of a topic, on the ROS clock, which is `ahead_ns` ahead of the recording's; and its positions.

    `bodies` are the drone's attitudes, from whose heading a gimbal's yaw may count.
    """
    gate, fixes = Gate(counts, bodies=list(bodies)), []
    records = complete_records(MEANINGS[kind], on_ros_clock(columns, ahead_ns), counts)
    for stamp_ns, value, _ in sorted(records, key=lambda record: record.stamp_ns):
        if isinstance(value, Position):
            fixes.append(Fix(stamp_ns, *value))
        elif not isinstance(value, Moment):
            gate.take(stamp_ns, value)
    return gate, fixes


def on_ros_clock(columns: Columns, ahead_ns: int) -> Columns:
    """The columns with the times of a topic's messages on the ROS clock, LAST_STAMP_US where they are damaged."""
    stamps_ns, received_ns = columns["timestamp"] * 1000, columns["received_ns"] + ahead_ns
    in_step = np.abs(received_ns - stamps_ns) <= IN_STEP_NS
    placed_ns = np.where(in_step, stamps_ns, LAST_STAMP_US * 1000)
    others = np.flatnonzero(~in_step)
    for boot in boots(stamps_ns[others], Counter(), received_ns[others]):
        rows = others[boot]
        if len(rows) >= SHORTEST_RUN or not in_step.any():
            placed_ns[rows] = stamps_ns[rows] + int(np.median(received_ns[rows] - stamps_ns[rows]))
    return columns | {"timestamp": placed_ns // 1000}


def odometry(columns: Columns, counts: Counter[str]) -> Iterator[Record]:
    """VehicleOdometry: velocity in a frame that it names, attitude as VehicleAttitude's.

    A world whose heading is arbitrary (FRD) counts as north-east-down, as the map of any visual odometry.
    """
    names = SINCE_1_14 if SINCE_1_14.velocity[0] in columns else UNTIL_1_13
    told, attitudes = (
        np.stack([columns[name] for name in each], axis=1).astype(np.float64)
        for each in (names.velocity, QUATERNION)
    )
    turned = columns["velocity_frame"] == BODY_FRD
    attitudes = attitudes[turned] / np.linalg.norm(attitudes[turned], axis=1, keepdims=True)
    told[turned] = np.einsum("kij,kj->ki", rotations_from_quaternions(attitudes), told[turned])
    known = turned | np.isin(columns["velocity_frame"], names.worlds)
    counts["velocities of unknown axes"] += int(np.count_nonzero(~known))
    untold = np.full(len(told), np.nan)
    variances = np.mean([columns.get(name, untold) for name in names.variances], axis=0)
    sigmas = np.sqrt(np.where(variances > 0, variances, np.nan))  # 0 where nobody set them
    yield from timed(columns, map(Velocity, told.tolist(), sigmas.tolist()), counts, known)
    yield from body_attitudes(columns, counts)


MEANINGS: dict[str, Callable[[Columns, Counter[str]], Iterator[Record]]] = {
    PX4_POSITION: velocities,
    PX4_ODOMETRY: odometry,
    PX4_ATTITUDE: body_attitudes,
    PX4_GIMBAL: gimbal_attitudes,
    PX4_PLACE: global_positions,
}


def twists_of(gate: Gate) -> list[Twist]:
    """The velocities, in the world."""
    return [Twist(each.stamp_ns, each.velocity, each.frame, each.sigma) for each in gate.velocities]
