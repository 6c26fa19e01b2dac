"""What ROS messages say of a flight, in this package's frames.

Axes (REP 103, REP 105): a map frame is east-north-up, a body frame forward-left-up, a frame with "optical"
in its name right-down-forward. A name that ends in the word "ned" is north-east-down, one that ends in "frd"
forward-right-down. `odom` and `map` of visual odometry start in any direction: their "north" is then the
y axis of that frame, which changes no distance.

Which axes a twist has:
    Odometry                  those of child_frame_id, turned to the map by the pose; those of frame_id where
                              child_frame_id is empty or the same
    TwistStamped, ...         those of frame_id: a map frame (map, odom, world, earth, enu, ned, local_origin)
                              or a body frame (base_link, base_footprint, body, fcu, imu...) or an optical one
    Vector3Stamped            those of frame_id, a map frame with "enu" in its name: DJI's drivers tell velocities so
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np

from flightdepth.flight.records import (
    FASTEST_M_S,
    LATEST_NS,
    NS_PER_S,
    AttitudeSample,
    BodyAttitudeSample,
)
from flightdepth.flight.ros_records import DamagedError, RosMessage, required
from flightdepth.motion import (
    NED_FROM_ENU,
    Vector,
    is_rotation,
    quaternion_from_rotation,
    quaternion_products,
    rotation_from_quaternion,
)

ODOMETRY = "nav_msgs/msg/Odometry"
TWIST_WITH_COVARIANCE = "geometry_msgs/msg/TwistWithCovarianceStamped"
TWIST = "geometry_msgs/msg/TwistStamped"
VECTOR = "geometry_msgs/msg/Vector3Stamped"
POSE = "geometry_msgs/msg/PoseStamped"
POSE_WITH_COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"
IMU = "sensor_msgs/msg/Imu"
IMAGE = "sensor_msgs/msg/Image"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
VELOCITY_KINDS = (ODOMETRY, TWIST_WITH_COVARIANCE, TWIST, VECTOR)  # best first
ORIENTATION_KINDS = (ODOMETRY, POSE, POSE_WITH_COVARIANCE, IMU)
IMAGE_KINDS = (IMAGE, COMPRESSED_IMAGE)
DEPTH_ENCODINGS = ("16UC1", "32FC1")

ENU, NED, FRD, OPTICAL = "enu", "ned", "frd", "optical"  # names of frames that tell their axes
FRD_FROM_FLU = np.diag([1.0, -1.0, -1.0])
OPTICAL_FROM_FRD = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
MAP_NAMES = ("map", "odom", "world", "earth", "local_origin")
NED_NAME = re.compile(r"(?:^|[^A-Za-z])[Nn][Ee][Dd]$|[a-z]NED$")  # not as in "odom_combined"
# MAVROS turns these two to the map, and names the body over them. The second has the vertical velocity downward (its
# versions before the middle of 2026; upward since, which no message tells).
MAVROS_LOCAL, MAVROS_GLOBAL, MAP = "/velocity_local", "/global_position/local", "map"
NED_FROM_END = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
BODY_NAMES = ("base", "body", "fcu", "imu", "vehicle", "drone", "uav", "frd", "flu")


@dataclass(frozen=True, eq=False)
class Twist:
    """A linear velocity [3] with its axes: `frame` "world" (NED), "body" (FRD) or "camera" (optical)."""

    stamp_ns: int
    velocity: Vector
    frame: str
    sigma: float | None


class Orientation(NamedTuple):
    """How `body` is turned in `parent`, the names of frames: (w, x, y, z), of length 1 but for rounding."""

    stamp_ns: int
    quaternion: Sequence[float] | Vector
    parent: str
    body: str

    @property
    def of_camera(self) -> bool:
        """Whether what is turned is a camera: its frame is an optical one."""
        return axes_of(self.body) == "camera"


def decoded(message: RosMessage) -> Any:
    """The message through rosbags, by the definitions that ROS ships (those of the types above never changed).

    A type that ROS does not know is read by the recording's own definition.
    """
    store = _definitions(message.serial)
    if message.kind not in store.fielddefs:
        store = _own_definition(message.kind, message.definition)
    read = store.deserialize_ros1 if message.serial == "ros1" else store.deserialize_cdr
    try:
        return read(message.data, message.kind)
    except Exception as error:  # rosbags compiles a reader for each type, which raises what Python raises
        raise DamagedError(f"a {message.kind} that cannot be read ({error})") from error


@cache
def _definitions(serial: str) -> Any:
    typesys = required("rosbags.typesys")
    return typesys.get_typestore(
        typesys.Stores.ROS1_NOETIC if serial == "ros1" else typesys.Stores.ROS2_HUMBLE
    )


@lru_cache(maxsize=16)
def _own_definition(kind: str, definition: str) -> Any:
    """A store with one type of numbers; with none where that is not what the definition tells.

    Rosbags unfolds an array of texts before it looks whether a message holds so many.
    """
    typesys = required("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.EMPTY)
    with suppress(Exception):  # a damaged text ends in what Python raises
        _, fields = typesys.get_types_from_msg(definition, kind)[kind]
        if all(_of_numbers(described) for _, described in fields):
            store.register({kind: ([], fields)})
    return store


def _of_numbers(described: Any) -> bool:
    """Whether rosbags describes a number or an array of them: (node, (name, size)), (node, (described, length))."""
    node, inner = described
    nodes = required("rosbags.interfaces").Nodetype
    if node in (nodes.ARRAY, nodes.SEQUENCE):
        node, inner = inner[0]
    return node == nodes.BASE and "string" not in inner[0]


def is_depth_map(message: RosMessage, content: Any) -> bool:
    """Whether an image is what a camera measures of depth (REP 118), not what it sees."""
    if message.kind == COMPRESSED_IMAGE:
        return "compressedDepth" in content.format
    return content.encoding in DEPTH_ENCODINGS


def stamp_of(header: Any, log_ns: int) -> int:
    """The header's stamp; the time of recording where nobody set it."""
    stamp_ns = int(header.stamp.sec) * NS_PER_S + int(header.stamp.nanosec) or log_ns
    if abs(stamp_ns) > LATEST_NS:
        raise DamagedError("a time that no clock tells")
    return stamp_ns


def axes_of(frame_id: str) -> str:
    """The kind of a frame by its name: "world", "body", "camera", or "" where the name does not tell."""
    tail = frame_id.rsplit("/", 1)[-1]
    name = tail.lower()
    if "optical" in name:
        return "camera"
    if any(part in name for part in MAP_NAMES):  # of one vehicle too: "uav1_odom"
        return "world"
    if any(part in name for part in BODY_NAMES):
        return "body"
    return "world" if NED_NAME.search(tail) or "enu" in name else ""


def ned_from_map(frame_id: str) -> Vector:
    """Rotation from a map frame."""
    downward = NED_NAME.search(frame_id) or frame_id.lower().endswith("frd")
    return np.eye(3) if downward else NED_FROM_ENU


def frd_from_body(frame_id: str) -> Vector:
    """Rotation from a body frame."""
    return np.eye(3) if frame_id.lower().endswith("frd") else FRD_FROM_FLU


def tells_velocity(message: RosMessage) -> bool:
    """Whether a message is one of a velocity; of a bare vector its topic says so ("/dji_osdk_ros/velocity")."""
    named = message.kind != VECTOR or message.topic.rsplit("/", 1)[-1].startswith("velocity")
    return named and message.kind in VELOCITY_KINDS


def twist_of(message: RosMessage, content: Any) -> Twist | None:
    """The velocity in a message; None where the frame's name does not tell its axes."""
    if message.kind == ODOMETRY:
        return _odometry_twist(message, content)
    if message.kind == VECTOR:
        return _vector_twist(message, content)
    inner = content.twist.twist if message.kind == TWIST_WITH_COVARIANCE else content.twist
    covariance = content.twist.covariance if message.kind == TWIST_WITH_COVARIANCE else None
    name = MAP if message.topic.endswith(MAVROS_LOCAL) else content.header.frame_id
    axes = axes_of(name)
    turn = {"world": ned_from_map(name), "body": frd_from_body(name), "camera": np.eye(3)}.get(axes)
    if turn is None:
        return None
    return _twist(message, content, turn @ speed_of(inner.linear), axes, covariance)


def _vector_twist(message: RosMessage, content: Any) -> Twist | None:
    # The first versions of DJI's driver told north, east, up, in "/map".
    if "enu" not in content.header.frame_id.lower():
        return None
    return _twist(message, content, NED_FROM_ENU @ speed_of(content.vector), "world", None)


def _odometry_twist(message: RosMessage, content: Any) -> Twist:
    frame, child = content.header.frame_id, content.child_frame_id
    if message.topic.endswith(MAVROS_GLOBAL):
        velocity = NED_FROM_END @ speed_of(content.twist.twist.linear)
        return _twist(message, content, velocity, "world", content.twist.covariance)
    velocity = speed_of(content.twist.twist.linear)
    if child and child != frame and velocity.any():  # 0 is 0 in any axes
        velocity = rotation_of(content.pose.pose.orientation) @ velocity
    return _twist(message, content, ned_from_map(frame) @ velocity, "world", content.twist.covariance)


def _twist(message: RosMessage, content: Any, velocity: Vector, axes: str, covariance: Any) -> Twist:
    return Twist(stamp_of(content.header, message.log_ns), velocity, axes, sigma_of(covariance))


def sigma_of(covariance: Any) -> float | None:
    """Standard deviation of a component from a 6x6 covariance; None where it is unset (zeros, -1)."""
    if covariance is None:
        return None
    variances = np.asarray(covariance, dtype=np.float64).reshape(6, 6).diagonal()[:3]
    known = (variances >= 0).all() and 0 < variances.max() < FASTEST_M_S**2
    return float(np.sqrt(variances.mean())) if known else None


def orientation_of(message: RosMessage, content: Any) -> Orientation | None:
    """How a message says that a camera or the drone is turned; None where it tells none of the drone.

    An Imu says so by a covariance of -1; many drivers leave all of it 0 instead, the quaternion at "not turned". Who
    tells a place alone leaves all of the quaternion 0.
    """
    frame = content.header.frame_id
    if message.kind == IMU:
        covariance, given = content.orientation_covariance, content.orientation
        if covariance[0] == -1 or not (given.x or given.y or given.z or np.any(covariance)):
            return None
        quaternion, body, parent = given, frame, ENU
    elif axes_of(frame) in ("body", "camera"):  # of what the drone itself sees
        return None
    else:
        pose = content.pose if message.kind == POSE else content.pose.pose
        body = content.child_frame_id if message.kind == ODOMETRY else "base_link"
        quaternion, parent = pose.orientation, frame
    if not (quaternion.w or quaternion.x or quaternion.y or quaternion.z):
        return None
    return Orientation(stamp_of(content.header, message.log_ns), quaternion_of(quaternion), parent, body)


def camera_attitudes(orientations: Sequence[Orientation], zero_ns: int = 0) -> list[AttitudeSample]:
    """Those of a camera, on a clock whose 0 is `zero_ns`."""
    turned = zip(orientations, _world_quaternions(orientations), strict=True)
    return [AttitudeSample(each.stamp_ns - zero_ns, quaternion) for each, quaternion in turned]


def body_attitudes(orientations: Sequence[Orientation], zero_ns: int = 0) -> list[BodyAttitudeSample]:
    """Those of the drone, on a clock whose 0 is `zero_ns`."""
    turned = zip(orientations, _world_quaternions(orientations), strict=True)
    return [BodyAttitudeSample(each.stamp_ns - zero_ns, quaternion) for each, quaternion in turned]


def _world_quaternions(orientations: Sequence[Orientation]) -> Vector:
    """World (NED) from body (FRD) or camera (optical), [n, 4]; w is not negative."""
    given = np.array([each.quaternion for each in orientations]).reshape(-1, 4)
    given /= np.linalg.norm(given, axis=1, keepdims=True)
    around = np.array([_turns_around(each.parent, each.body) for each in orientations]).reshape(-1, 2, 4)
    turned = quaternion_products(quaternion_products(around[:, 0], given), around[:, 1])
    return np.where(turned[:, :1] < 0, -turned, turned)


@lru_cache(maxsize=64)
def _turns_around(parent: str, body: str) -> Vector:
    """What goes before a message's quaternion, and what behind it: NED from its map; its body from FRD, [2, 4]."""
    from_body = np.eye(3) if axes_of(body) == "camera" else frd_from_body(body).T
    return np.stack([quaternion_from_rotation(ned_from_map(parent)), quaternion_from_rotation(from_body)])


def speed_of(vector: Any) -> Vector:
    """A Vector3 of m/s as an array [3]; what is no number, or faster than any drone, is damage."""
    speed = np.array([vector.x, vector.y, vector.z], dtype=np.float64)
    if not np.abs(speed).max() < FASTEST_M_S:
        raise DamagedError("a velocity beyond reason")
    return speed


def rotation_of(quaternion: Any) -> Vector:
    """A Quaternion message as a matrix; one that is no rotation is damage."""
    return rotation_from_quaternion(quaternion_of(quaternion))


def quaternion_of(quaternion: Any) -> tuple[float, float, float, float]:
    """A Quaternion message as (w, x, y, z), of length 1 but for rounding; one that is no rotation is damage."""
    values = quaternion.w, quaternion.x, quaternion.y, quaternion.z
    if not is_rotation(values, within=0.01):
        raise DamagedError("an orientation that is no rotation")
    return values
