"""Recordings of PX4's own messages (px4_msgs), by the writers of rosbags and mcap.

The fields are those of PX4's messages in their order, on which a message's bytes depend; the values are made up.
"""

import re
from functools import cache

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from tests_logs import quaternion, velocity
from tests_recordings import START_NS, STORES

DELAY_NS = 8_000_000  # of a message on its way to the recorder
POSITION_1_16 = """# Fused local position in NED.
uint32 MESSAGE_VERSION = 1

uint64 timestamp # [us] Time since system start
uint64 timestamp_sample
bool xy_valid
bool z_valid
bool v_xy_valid # [@enum x] vx and vy are "valid" – both
bool v_z_valid
float32 x
float32 y
float32 z
float32[2] delta_xy
uint8 xy_reset_counter
float32 delta_z
uint8 z_reset_counter
float32 vx
float32 vy
float32 vz
float32 z_deriv
float32[2] delta_vxy
uint8 vxy_reset_counter
float32 delta_vz
uint8 vz_reset_counter
float32 ax
float32 ay
float32 az
float32 heading
float32 heading_var
float32 unaided_heading
float32 delta_heading
uint8 heading_reset_counter
bool heading_good_for_control
float32 tilt_var
bool xy_global
bool z_global
uint64 ref_timestamp
float64 ref_lat
float64 ref_lon
float32 ref_alt
bool dist_bottom_valid
float32 dist_bottom
float32 dist_bottom_var
float32 delta_dist_bottom
uint8 dist_bottom_reset_counter
uint8 dist_bottom_sensor_bitfield
uint8 DIST_BOTTOM_SENSOR_NONE = 0
float32 eph
float32 epv
float32 evh
float32 evv
bool dead_reckoning
float32 vxy_max
float32 vz_max
float32 hagl_min
float32 hagl_max_z
float32 hagl_max_xy
# TOPICS vehicle_local_position estimator_local_position
"""
# What PX4 1.13 lacks, and deviations and times that no version need have.
LATER = (
    r"heading_var|unaided_heading|tilt_var|heading_good_for_control|dist_bottom_var|delta_dist_bottom|hagl_max_xy"
    r"|dist_bottom_reset_counter|MESSAGE_VERSION|evh|evv|timestamp_sample"
)
POSITION_OLD = re.sub(rf"\n\w+ ({LATER})\b[^\n]*", "", POSITION_1_16)
ATTITUDE = """uint64 timestamp
uint64 timestamp_sample
float32[4] q
float32[4] delta_q_reset
uint8 quat_reset_counter
"""
GIMBAL_1_13 = """uint64 timestamp
uint8 target_system
uint8 target_component
uint16 device_flags
uint16 DEVICE_FLAGS_YAW_LOCK = 16
float32[4] q
float32 angular_velocity_x
float32 angular_velocity_y
float32 angular_velocity_z
uint32 failure_flags
bool received_from_mavlink
"""
GIMBAL = GIMBAL_1_13.replace(
    "bool received", "float32 delta_yaw\nfloat32 delta_yaw_velocity\nuint8 gimbal_device_id\nbool received"
)
ODOMETRY_1_14 = """uint64 timestamp
uint64 timestamp_sample
uint8 POSE_FRAME_NED = 1
uint8 pose_frame
float32[3] position
float32[4] q
uint8 velocity_frame
float32[3] velocity
float32[3] angular_velocity
float32[3] position_variance
float32[3] orientation_variance
float32[3] velocity_variance
uint8 reset_counter
int8 quality
"""
ODOMETRY_1_13 = """uint64 timestamp
uint64 timestamp_sample
uint8 LOCAL_FRAME_NED=0
uint8 local_frame
float32 x
float32 y
float32 z
float32[4] q
float32[4] q_offset
float32[21] pose_covariance
uint8 velocity_frame
float32 vx
float32 vy
float32 vz
float32 rollspeed
float32 pitchspeed
float32 yawspeed
float32[21] velocity_covariance
uint8 reset_counter
"""
GLOBAL_1_13 = """uint64 timestamp
uint64 timestamp_sample
float64 lat
float64 lon
float32 alt
float32 alt_ellipsoid
float32 delta_alt
uint8 lat_lon_reset_counter
uint8 alt_reset_counter
float32 eph
float32 epv
float32 terrain_alt
bool terrain_alt_valid
bool dead_reckoning
"""
KINDS = {
    "position": "px4_msgs/msg/VehicleLocalPosition",
    "odometry": "px4_msgs/msg/VehicleOdometry",
    "attitude": "px4_msgs/msg/VehicleAttitude",
    "gimbal": "px4_msgs/msg/GimbalDeviceAttitudeStatus",
    "global": "px4_msgs/msg/VehicleGlobalPosition",
}
SYNCED_US = START_NS // 1000  # what PX4's clock says at time 0, where it keeps the time of its agent
SINCE_POWER_US = 7_000_000  # and where it does not


@cache
def store_of(kind, definition):
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition, kind))
    return store


def px4(short, definition, topic, time_s, clock_us, **values):
    """A message: (topic, ns of recording, kind, its definition, its store, itself); what is not given is 0."""
    kind = KINDS[short]
    store = store_of(kind, definition)
    plain = store.deserialize_cdr(b"\0\1\0\0" + bytes(store_size(kind, definition)), kind)
    stamp_us = clock_us + round(time_s * 1e6)
    values = {"timestamp": stamp_us + 2000, "timestamp_sample": stamp_us} | values
    fields = plain.__dataclass_fields__
    for name, value in values.items():
        if name in fields:
            array = isinstance(getattr(plain, name), np.ndarray)
            object.__setattr__(plain, name, np.array(value, np.float32) if array else value)
    at_ns = START_NS + round(time_s * 1e9) + DELAY_NS
    return topic, at_ns, kind, definition, store, plain


def store_size(kind, definition):
    """Bytes of a message of numbers, without padding at its end."""
    for size in range(4, 400):
        try:
            store_of(kind, definition).deserialize_cdr(b"\0\1\0\0" + bytes(size), kind)
        except Exception:
            continue
        return size
    raise AssertionError(kind)


def position(
    i, *, clock_us=SYNCED_US, definition=POSITION_1_16, topic="/fmu/out/vehicle_local_position_v1", **values
):
    vx, vy, vz = velocity(i)
    told = {"vx": vx, "vy": vy, "vz": vz, "evh": 0.5, "evv": 0.25, "v_xy_valid": True, "v_z_valid": True}
    return px4("position", definition, topic, i / 10, clock_us, **(told | values))


def attitude(i, *, clock_us=SYNCED_US, topic="/fmu/out/vehicle_attitude", **values):
    return px4("attitude", ATTITUDE, topic, i / 10, clock_us, **({"q": quaternion(i)} | values))


def odometry(i, *, clock_us=SYNCED_US, definition=ODOMETRY_1_14, topic="/fmu/out/vehicle_odometry", **values):
    vx, vy, vz = velocity(i)
    told = {"velocity": velocity(i), "vx": vx, "vy": vy, "vz": vz, "q": quaternion(i)}
    return px4("odometry", definition, topic, i / 10, clock_us, **(told | values))


def gimbal(
    i, *, clock_us=SYNCED_US, definition=GIMBAL, topic="/fmu/out/gimbal_device_attitude_status", **values
):
    return px4("gimbal", definition, topic, i / 10, clock_us, **values)


def global_position(i, *, clock_us=SYNCED_US, topic="/fmu/out/vehicle_global_position", **values):
    return px4("global", GLOBAL_1_13, topic, i / 10, clock_us, **values)


def write_px4(path, messages, plugin="MCAP"):
    """A folder as rosbags writes it."""
    with Ros2Writer(path, version=9, storage_plugin=StoragePlugin[plugin]) as bag:
        _fill(bag, messages, lambda store: store.serialize_cdr)
    return path


def write_px4_ros1(path, messages):
    """A bag of ROS 1, as its branch of px4_msgs gives."""
    with Ros1Writer(path) as bag:
        _fill(bag, messages, lambda store: store.serialize_ros1)
    return path


def _fill(bag, messages, serializer):
    connections = {}
    for topic, at_ns, kind, _, store, message in messages:
        if topic not in connections:
            connections[topic] = bag.add_connection(topic, kind, typestore=store)
        bag.write(connections[topic], at_ns, bytes(serializer(store)(message, kind)))


def write_px4_mcap(path, messages, *, compression="NONE", chunk_size=2000, encoding="ros2msg"):
    """A file as rosbag2 writes it: the definitions are the texts of the .msg files."""
    with path.open("wb") as file:
        writer = McapWriter(file, chunk_size=chunk_size, compression=CompressionType[compression])
        writer.start(profile="ros2", library="test")
        channels = {}
        for topic, at_ns, kind, definition, store, message in messages:
            if (topic, definition) not in channels:
                schema = writer.register_schema(kind, encoding, definition.encode())
                channels[topic, definition] = writer.register_channel(topic, "cdr", schema)
            data = bytes(store.serialize_cdr(message, kind))
            writer.add_message(channels[topic, definition], at_ns, data, at_ns)
        writer.finish()
    return path


def of_ros(topic, time_s, made):
    """A message of `tests_recordings.Messages`, to be recorded among PX4's."""
    kind, message = made
    store = STORES["cdr"]
    return (
        topic,
        START_NS + round(time_s * 1e9),
        kind,
        store.generate_msgdef(kind, ros_version=2)[0],
        store,
        message,
    )
