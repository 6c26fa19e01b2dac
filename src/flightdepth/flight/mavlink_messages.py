"""What MAVLink's messages tell of a flight, in a ground station's log and live.

The messages and their units: https://mavlink.io/en/messages/common.html
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

from flightdepth.flight.autopilot import NO_ROTATION, BodyAttitude, Moment, Position, Velocity
from flightdepth.flight.gimbal import GimbalAttitude
from flightdepth.flight.positions import UNFIXED
from flightdepth.motion import quaternion_from_euler, rotation_from_quaternion

HEARTBEAT = "HEARTBEAT"
NO_AUTOPILOT = 8  # MAV_AUTOPILOT_INVALID: the sender of this heartbeat flies nothing
ANTENNA_TRACKER = 5  # MAV_TYPE of an autopilot that only turns an antenna, and tells where it stands
# MAV_FRAME of ODOMETRY's pose and velocity.
LOCAL_NED, BODY_NED, BODY_FRD = 1, 8, 12
# Time in `time_usec` beyond a year is since 1970, so on a clock that other messages do not share.
YEAR_US = 365 * 86400 * 10**6

Message = Any


class Source(NamedTuple):
    """Who sent a message: MAVLink's numbers of the vehicle and of the device in it."""

    system: int
    component: int


def flies(heartbeat: Message) -> bool:
    """Whether who sent it is the autopilot of something that flies."""
    return bool(heartbeat.autopilot != NO_AUTOPILOT and heartbeat.type != ANTENNA_TRACKER)


def local_position(message: Message, counts: Counter[str]) -> Iterator[tuple[int, Velocity]]:
    """LOCAL_POSITION_NED."""
    yield (
        message.time_boot_ms * 10**6,
        Velocity((message.vx, message.vy, message.vz), place=(message.x, message.y, message.z)),
    )


def odometry(message: Message, counts: Counter[str]) -> Iterator[tuple[int, Velocity | BodyAttitude]]:
    """ODOMETRY: pose in `frame_id`, velocity in `child_frame_id`; q turns the latter into the former.

    The deviation is the root of the mean of the three variances: it does not depend on the axes.
    """
    numbers = [*message.q, message.vx, message.vy, message.vz]
    if message.frame_id != LOCAL_NED or message.child_frame_id not in (LOCAL_NED, BODY_NED, BODY_FRD):
        counts["odometry in frames other than local NED and body"] += 1
    elif message.time_usec > YEAR_US:
        counts["odometry on a clock of its own"] += 1
    elif not all(map(math.isfinite, numbers)) or not any(message.q):
        counts["odometry that is not numbers"] += 1
    else:
        ned: Sequence[float] = numbers[4:]
        if message.child_frame_id != LOCAL_NED:
            ned = (rotation_from_quaternion(message.q) @ ned).tolist()
        variance = sum(message.velocity_covariance[index] for index in (0, 6, 11)) / 3
        sigma = math.sqrt(variance) if 0 < variance < math.inf else None
        yield message.time_usec * 1000, Velocity(ned, sigma, (message.x, message.y, message.z))
        yield message.time_usec * 1000, BodyAttitude(message.q)


def global_position(message: Message, counts: Counter[str]) -> Iterator[tuple[int, Velocity | Position]]:
    """GLOBAL_POSITION_INT: 1e-7 degrees, mm above mean sea level, cm/s; all zero before the first fix."""
    if message.lat == message.lon == 0:
        counts[UNFIXED] += 1
        return
    stamp_ns = message.time_boot_ms * 10**6
    place = message.lat, message.lon, message.alt
    yield stamp_ns, Velocity((message.vx / 100, message.vy / 100, message.vz / 100), place=place)
    yield stamp_ns, Position(message.lat / 1e7, message.lon / 1e7, message.alt / 1000)


def attitude_quaternion(message: Message, counts: Counter[str]) -> Iterator[tuple[int, BodyAttitude]]:
    """ATTITUDE_QUATERNION: w first, from body to NED."""
    quaternion = (message.q1, message.q2, message.q3, message.q4)
    yield message.time_boot_ms * 10**6, BodyAttitude(quaternion)


def attitude(message: Message, counts: Counter[str]) -> Iterator[tuple[int, BodyAttitude]]:
    """ATTITUDE: roll, pitch and yaw in radians."""
    angles = message.roll, message.pitch, message.yaw
    if all(map(math.isfinite, angles)):
        yield message.time_boot_ms * 10**6, BodyAttitude(quaternion_from_euler(*angles))
    else:
        counts[NO_ROTATION] += 1


def system_time(message: Message, counts: Counter[str]) -> Iterator[tuple[int, Moment]]:
    """SYSTEM_TIME: 0, or since its power-up, before the autopilot's clock is set; some leave out when that was."""
    if message.time_boot_ms:
        yield message.time_boot_ms * 10**6, Moment(message.time_unix_usec * 1000)


def gimbal(message: Message, counts: Counter[str]) -> Iterator[tuple[int, GimbalAttitude]]:
    """GIMBAL_DEVICE_ATTITUDE_STATUS, as it stands."""
    value = GimbalAttitude(message.q, message.flags, message.delta_yaw, message.gimbal_device_id)
    yield message.time_boot_ms * 10**6, value


GIMBAL, GLOBAL = "GIMBAL_DEVICE_ATTITUDE_STATUS", "GLOBAL_POSITION_INT"
# The first of each that a sender sent is used.
VELOCITIES = ("LOCAL_POSITION_NED", "ODOMETRY", GLOBAL)
ATTITUDES = ("ATTITUDE_QUATERNION", "ATTITUDE", "ODOMETRY")
RANKS: dict[type, Sequence[str]] = {Velocity: VELOCITIES, BodyAttitude: ATTITUDES}
KINDS: dict[str, Callable[[Message, Counter[str]], Iterator[tuple[int, Any]]]] = {
    "LOCAL_POSITION_NED": local_position,
    "ODOMETRY": odometry,
    GLOBAL: global_position,
    "ATTITUDE_QUATERNION": attitude_quaternion,
    "ATTITUDE": attitude,
    "SYSTEM_TIME": system_time,
    GIMBAL: gimbal,
}
