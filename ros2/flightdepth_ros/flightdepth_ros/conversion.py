"""Between ROS messages and flightdepth, without rclpy: only the fields of messages are used.

Pictures, axes and units of odometry are read as flightdepth reads them from recordings (docs/telemetry.md).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.flight.gimbal import looking, screwed
from flightdepth.flight.ros_frames import picture
from flightdepth.flight.ros_messages import (
    IMAGE,
    ODOMETRY,
    body_attitudes,
    camera_attitudes,
    orientation_of,
    stamp_of,
    twist_of,
)
from flightdepth.flight.ros_records import DamagedError, RosMessage
from flightdepth.motion import Vector

# CameraInfo.distortion_model (sensor_msgs/distortion_models.hpp) and the model here.
MODELS = {"plumb_bob": "pinhole", "rational_polynomial": "pinhole", "equidistant": "fisheye", "": "pinhole"}


def image_of(message: Any, now_ns: int) -> tuple[int, NDArray[np.uint8]]:
    """Stamp and uint8 RGB [H, W, 3] of a sensor_msgs/Image; `now_ns` where nobody set a stamp."""
    return stamp_of(message.header, now_ns), picture(_unread(IMAGE, now_ns), message)


def velocity_of(message: Any, now_ns: int) -> tuple[int, Vector, float | None]:
    """Stamp, velocity NED in m/s and its standard deviation, of a nav_msgs/Odometry."""
    twist = twist_of(_unread(ODOMETRY, now_ns), message)
    assert twist is not None  # an Odometry always tells its axes
    return twist.stamp_ns, twist.velocity, twist.sigma


def camera_attitude_of(message: Any, now_ns: int, pitch_deg: float) -> tuple[int, Vector]:
    """Stamp and quaternion world_from_camera of a nav_msgs/Odometry.

    The camera is screwed to the body and looks up by `pitch_deg`, unless the odometry is of an optical frame: its own.
    """
    told = orientation_of(_unread(ODOMETRY, now_ns), message)
    if told is None:
        raise DamagedError("odometry that does not tell how the drone is turned")
    if told.of_camera:
        [camera] = camera_attitudes([told])
    else:
        [body] = body_attitudes([told])
        camera = screwed(body, looking(pitch_deg))
    return camera.stamp_ns, camera.world_from_camera


def camera_of(info: Any) -> Camera:
    """The camera of a sensor_msgs/CameraInfo, of the raw picture; binning and a region of interest are refused."""
    if info.distortion_model not in MODELS:
        raise BadInput("camera info", expected=f"a model of {list(MODELS)}", got=repr(info.distortion_model))
    roi = (info.roi.x_offset, info.roi.y_offset, info.roi.width, info.roi.height)
    if max(info.binning_x, info.binning_y) > 1 or roi not in {(0, 0, 0, 0), (0, 0, info.width, info.height)}:
        raise BadInput("camera info", expected="the whole picture", got="binning or a region of interest")
    fx, _, cx, _, fy, cy = (float(value) for value in info.k[:6])
    distortion = tuple(float(value) for value in info.d) if any(info.d) else ()
    return Camera(
        int(info.width), int(info.height), fx, fy, cx, cy, distortion, MODELS[info.distortion_model]
    )


def _unread(kind: str, now_ns: int) -> RosMessage:
    """What flightdepth wants to know of a message besides its fields."""
    return RosMessage(topic="", kind=kind, serial="cdr", log_ns=now_ns, data=b"")
