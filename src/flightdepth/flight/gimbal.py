"""The camera's attitude from a gimbal's report, or from the body that carries the camera.

A gimbal's frame and a body's frame are both x forward (the way the camera looks), y right, z down, so
`motion.NED_FROM_CAMERA` also turns camera axes into theirs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from enum import IntFlag
from typing import NamedTuple

import numpy as np

from flightdepth.flight.records import AttitudeSample, BodyAttitudeSample, Telemetry, by_time
from flightdepth.motion import (
    NED_FROM_CAMERA,
    Vector,
    quaternion_from_euler,
    quaternion_from_rotation,
    quaternion_products,
    rotation_from_euler,
    unit_quaternion,
)

# A quaternion: a camera's axes to those of its gimbal, or of a body that it looks ahead of.
BODY_FROM_CAMERA = quaternion_from_rotation(NED_FROM_CAMERA)


class GimbalFlags(IntFlag):
    """Bits of MAVLink's GIMBAL_DEVICE_FLAGS that say what a gimbal's yaw counts from."""

    NEUTRAL = 2
    YAW_LOCK = 16
    YAW_IN_VEHICLE_FRAME = 32
    YAW_IN_EARTH_FRAME = 64


class GimbalAttitude(NamedTuple):
    """What MAVLink's GIMBAL_DEVICE_ATTITUDE_STATUS says, message 285 of its common set.

    quaternion     (w, x, y, z): roll and pitch against the horizon; yaw against north or the body's heading
    flags          bits of GimbalFlags
    delta_yaw_rad  the body's heading, if it is known: q_earth = q_delta_yaw * q_vehicle. 0 is not: a sender that does
                   not know the field leaves it so (PX4's and others)
    device         number of the gimbal behind a component that reports several
    """

    quaternion: Sequence[float]
    flags: int
    delta_yaw_rad: float = math.nan
    device: int = 0


def camera_attitude(gimbal: GimbalAttitude, heading_rad: float | None) -> Vector | None:
    """Quaternion (w, x, y, z) world_from_camera, or None where the yaw counts from an unknown heading.

    With neither frame's flag set, YAW_LOCK decides and `delta_yaw_rad` is void: the rule of older gimbals. NEUTRAL goes
    before it, and is ahead of the vehicle: PX4 to 1.14 sets both over the angles of servos, which count from there.
    """
    flags = GimbalFlags(gimbal.flags & 0x72)
    quaternion = unit_quaternion(gimbal.quaternion)
    explicit = flags & (GimbalFlags.YAW_IN_VEHICLE_FRAME | GimbalFlags.YAW_IN_EARTH_FRAME)
    locked = GimbalFlags.YAW_LOCK in flags and GimbalFlags.NEUTRAL not in flags
    if not (GimbalFlags.YAW_IN_EARTH_FRAME in flags if explicit else locked):
        told = bool(explicit) and math.isfinite(gimbal.delta_yaw_rad) and gimbal.delta_yaw_rad != 0
        yaw_rad = gimbal.delta_yaw_rad if told else heading_rad
        if yaw_rad is None:
            return None
        quaternion = quaternion_products(np.array(quaternion_from_euler(0.0, 0.0, yaw_rad)), quaternion)
    return _of_camera(quaternion)


def turned(yaw_deg: float, pitch_deg: float, roll_deg: float) -> Vector:
    """Quaternion (w, x, y, z) of what heads so from north clockwise, nose up, right side down."""
    return np.array(quaternion_from_euler(*map(math.radians, (roll_deg, pitch_deg, yaw_deg))))


def looking_along(yaw_deg: float, pitch_deg: float, roll_deg: float) -> Vector:
    """Quaternion (w, x, y, z) world_from_camera of a camera whose gimbal is `turned` so."""
    return _of_camera(turned(yaw_deg, pitch_deg, roll_deg))


def _of_camera(gimbal: Vector) -> Vector:
    """Quaternion (w, x, y, z), w >= 0, of a gimbal's camera."""
    quaternion = quaternion_products(gimbal, BODY_FROM_CAMERA)
    return quaternion if quaternion[0] >= 0 else -quaternion


def looking(pitch_deg: float) -> Vector:
    """`body_from_camera`, shape (3, 3), of a camera that looks ahead along the body's x, turned up by a pitch."""
    return np.asarray(rotation_from_euler(0.0, math.radians(pitch_deg), 0.0) @ NED_FROM_CAMERA)


def screwed(body: BodyAttitudeSample, body_from_camera: Vector) -> AttitudeSample:
    """The attitude of a camera that is screwed to the body, `body_from_camera`, (3, 3)."""
    (camera,) = _screwed([body], body_from_camera)
    return camera


def with_fixed_camera(telemetry: Telemetry, body_from_camera: Vector) -> Telemetry:
    """The telemetry with the attitude of a camera that is screwed to the body, `body_from_camera`, (3, 3)."""
    cameras = _screwed(telemetry.body_attitudes, body_from_camera)
    motion = [sample for sample in telemetry.samples if not isinstance(sample, AttitudeSample)]
    return replace(telemetry, samples=by_time(motion, cameras))


def _screwed(bodies: Sequence[BodyAttitudeSample], body_from_camera: Vector) -> list[AttitudeSample]:
    turns = np.array([body.world_from_body for body in bodies]).reshape(-1, 4)
    cameras = quaternion_products(turns, quaternion_from_rotation(body_from_camera))
    return [AttitudeSample(body.stamp_ns, camera) for body, camera in zip(bodies, cameras, strict=True)]
