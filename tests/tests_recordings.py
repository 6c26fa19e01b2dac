"""Flights with known velocities, written as DJI subtitles, Parrot metadata and ROS recordings, by the real
writers where there are any. The layouts are those that the readers' docstrings name; the values are made up."""

import json
from types import SimpleNamespace

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_typestore

LATITUDE, LONGITUDE = 48.7, 2.2
RADIUS_M = 6378137.0
START_NS = 1_700_000_000_000_000_000
STORES = {"ros1": get_typestore(Stores.ROS1_NOETIC), "cdr": get_typestore(Stores.ROS2_HUMBLE)}


def place(north_m, east_m):
    """Latitude and longitude in degrees; WGS 84 radii by the textbook, written apart from the package."""
    e2 = 0.0066943799901413165
    w = 1 - e2 * np.sin(np.radians(LATITUDE)) ** 2
    latitude = LATITUDE + np.degrees(north_m / (RADIUS_M * (1 - e2) / w**1.5))
    longitude = LONGITUDE + np.degrees(east_m / (RADIUS_M / np.sqrt(w) * np.cos(np.radians(LATITUDE))))
    return latitude, longitude


def clock(seconds, separator=","):
    milliseconds = round(seconds * 1000)
    minutes, milliseconds = divmod(milliseconds, 60_000)
    return f"00:{minutes:02d}:{milliseconds // 1000:02d}{separator}{milliseconds % 1000:03d}"


def cues(velocity, body, *, seconds=6.0, rate=30.0, fixes_per_s=5.0, newline="\n"):
    """Subtitles of a straight flight from 50 m; `body` gets what a drone knows at its last GPS fix."""
    north, east, down = velocity
    parts = []
    for index in range(int(seconds * rate)):
        time = index / rate
        fixed = np.floor(time * fixes_per_s + 1e-9) / fixes_per_s
        latitude, longitude = place(north * fixed, east * fixed)
        drone = SimpleNamespace(
            index=index,
            lat=latitude,
            lon=longitude,
            height=50 - down * fixed,
            down=down,
            north=north,
            east=east,
            speed=np.hypot(north, east),
        )
        parts += [str(index + 1), f"{clock(time)} --> {clock((index + 1) / rate)}", *body(drone), ""]
    return newline.join(parts) + newline


def mavic_3(drone):
    return [
        f'<font size="28">FrameCnt: {drone.index + 1}, DiffTime: 33ms',
        f"2024-05-01 10:00:00.{drone.index % 1000:03d}",
        "[iso: 100] [shutter: 1/640.0] [fnum: 2.8] [ev: 0] [color_md: default] [focal_len: 24.00] "
        f"[latitude: {drone.lat:.6f}] [longitude: {drone.lon:.6f}] "
        f"[rel_alt: {drone.height:.3f} abs_alt: {drone.height + 100:.3f}] "
        "[gb_yaw: 90.0 gb_pitch: -30.0 gb_roll: 0.0] </font>",
    ]


def air_2_with_typo(drone):
    return [
        f"[iso : 100] [latitude : {drone.lat:.6f}] [longtitude : {drone.lon:.6f}] [altitude: {drone.height:.6f}]"
    ]


def comma_decimals(drone):
    return [line.replace(".", ",") for line in mavic_3(drone)]


def mavic_pro(drone):
    return [
        "HOME(2.2000,48.7000) 2017.08.05 14:11:51",
        f"GPS({drone.lon:.6f},{drone.lat:.6f},16) BAROMETER:{drone.height:.1f}",
        "ISO:100 Shutter:60 EV: Fnum:F2.2",
    ]


def mavic_pro_commas(drone):
    return [line.replace(".", ",") for line in mavic_pro(drone)[1:]]


def matrice_300(drone):
    return [f"GPS({drone.lat:.6f},{drone.lon:.6f},0.0M) BAROMETER:{drone.height:.1f}M"]


def phantom_4_rtk(drone):
    return [
        f"F/5.6, SS 400, ISO 100, EV 0, RTK ({drone.lon:.6f}, {drone.lat:.6f}, 15), HOME (2.2, 48.7, 3.10m), "
        f"D 12.00m, H {drone.height:.2f}m, H.S {drone.speed:.2f}m/s, V.S {drone.down:.2f}m/s, "
        "F.PRY (2.7°, -7.0°, 88.0°), G.PRY (-30.0°, 0.0°, 90.0°)"
    ]


def mini_2(drone):
    return [
        f"F/2.8, SS 206.14, ISO 150, EV 0, DZOOM 1.000, GPS ({drone.lon:.4f}, {drone.lat:.4f}, 15), D 13.69m, "
        f"H {drone.height:.2f}m, H.S {drone.speed:.2f}m/s, V.S {-drone.down:.2f}m/s "
    ]


def matrice_30(drone):
    return [
        f'<font size="28">FrameCnt: {drone.index + 1}, DiffTime: 33ms',
        "2024-02-27 22:30:45.395",
        "[fnum: 1.0] [focal_len: 58.00] [dzoom: 1.00] ",
        f"[latitude: {drone.lat:.6f}] [longitude: {drone.lon:.6f}] "
        f"[rel_alt: {drone.height:.3f} abs_alt: {drone.height + 60:.3f}] ",
        f"[drone_speedx: {drone.east:.1f} drone_speedy: {drone.north:.1f} drone_speedz: {drone.down:.1f}] ",
        "[drone_yaw: -20.4 drone_pitch: 2.4 drone_roll: -2.1] ",
        "[gb_yaw: 90.0 gb_pitch: -30.0 gb_roll: 0.0] ",
        "",
        "0",
        "[dzoom_ratio: 10000, delta:0] [color_md : default] ",
        "</font>",
    ]


# Layout to (its subtitles, cues a second, fixes a second).
DJI_LAYOUTS = {
    "Mavic 3": (mavic_3, 30.0, 5.0),
    "Air 2, misspelt": (air_2_with_typo, 30.0, 10.0),
    "comma decimals": (comma_decimals, 30.0, 5.0),
    "Mavic Pro": (mavic_pro, 1.0, 1.0),
    "Mavic Pro, comma decimals": (mavic_pro_commas, 1.0, 1.0),
    "Matrice 300": (matrice_300, 10.0, 5.0),
    "Phantom 4 RTK": (phantom_4_rtk, 1.0, 1.0),
    "Matrice 30": (matrice_30, 30.0, 5.0),
}

PARROT_V3 = (
    "time drone_quat_w drone_quat_x drone_quat_y drone_quat_z location_valid location_latitude "
    "location_longitude location_altitude_wgs84ellipsoid location_altitude_egm96amsl "
    "location_horizontal_accuracy location_vertical_accuracy location_sv_count ground_distance speed_north "
    "speed_east speed_down air_speed frame_base_quat_w frame_base_quat_x frame_base_quat_y frame_base_quat_z "
    "frame_quat_w frame_quat_x frame_quat_y frame_quat_z exposure_time gain"
)
QUATERNION_EAST = "0.70711 0.00000 0.00000 0.70711"  # yaw 90 degrees


def parrot_csv(velocity, *, rows=10, located=True):
    """Version 3 as vmeta-extract writes it; an unknown location is one cell shorter, as the library has it."""
    location = (
        "1 48.70000000 2.20000000 150.00 100.00 1.00 1.00 14" if located else "0 0. 0. 0.00 0.00 0.00 0"
    )
    speed = " ".join(f"{part:.3f}" for part in velocity)
    line = f"1.0 0.0 0.0 0.0 {location} 25.00 {speed} -1.000 1.0 0.0 0.0 0.0 {QUATERNION_EAST} 3.2 100"
    return "\n".join([PARROT_V3, *(f"{33_333 * index} {line}" for index in range(rows))]) + "\n"


def parrot_json(velocity, *, rows=10, protobuf=False, indent=None):
    speed = dict(zip(("north", "east", "down"), velocity, strict=True))
    east = dict(zip("wxyz", map(float, QUATERNION_EAST.split()), strict=True))
    level = {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0}
    metadata = {"drone_quat": level, "speed": speed, "frame_quat": east}
    if protobuf:
        metadata = {
            "drone": {"quat": level, "speed": speed},
            "camera": {"timestamp": 7, "quat": east},
            "links": [{}],
        }
    frames = [{"time": 33_333 * index, "metadata": metadata} for index in range(rows)]
    return json.dumps({"session": {"model": "x"}, "frame": frames}, indent=indent)


class Messages:
    """Messages of one ROS version: `odometry(time_s, ...)` and so on give (topic, type, message)."""

    def __init__(self, serial):
        self.store = STORES[serial]
        self.serial = serial
        self.types = {
            name.rsplit("/", 1)[-1]: kind for name, kind in self.store.types.items() if "_msgs/" in name
        }

    def header(self, time_s, frame_id):
        stamp_ns = START_NS + round(time_s * 1e9)
        time = self.store.types["builtin_interfaces/msg/Time"](stamp_ns // 10**9, stamp_ns % 10**9)
        seq = {"seq": 0} if self.serial == "ros1" else {}
        return self.types["Header"](stamp=time, frame_id=frame_id, **seq)

    def vector(self, values):
        return self.types["Vector3"](*map(float, values))

    def twist(self, linear):
        return self.types["Twist"](self.vector(linear), self.vector((0, 0, 0)))

    def pose(self, wxyz, place=(0, 0, 0)):
        w, x, y, z = map(float, wxyz)
        return self.types["Pose"](
            self.types["Point"](*map(float, place)), self.types["Quaternion"](x, y, z, w)
        )

    def covariance(self, sigma):
        return np.diag([sigma**2] * 6).ravel()

    def odometry(
        self,
        time_s,
        linear,
        wxyz=(1, 0, 0, 0),
        *,
        sigma=0.1,
        frame="map",
        child="base_link",
        place=(0, 0, 0),
    ):
        pose = self.types["PoseWithCovariance"](self.pose(wxyz, place), self.covariance(0))
        twist = self.types["TwistWithCovariance"](self.twist(linear), self.covariance(sigma))
        return "nav_msgs/msg/Odometry", self.types["Odometry"](self.header(time_s, frame), child, pose, twist)

    def twist_stamped(self, time_s, linear, frame):
        return "geometry_msgs/msg/TwistStamped", self.types["TwistStamped"](
            self.header(time_s, frame), self.twist(linear)
        )

    def twist_with_covariance(self, time_s, linear, frame, sigma):
        twist = self.types["TwistWithCovariance"](self.twist(linear), self.covariance(sigma))
        message = self.types["TwistWithCovarianceStamped"](self.header(time_s, frame), twist)
        return "geometry_msgs/msg/TwistWithCovarianceStamped", message

    def pose_stamped(self, time_s, wxyz, frame="map", place=(0, 0, 0)):
        message = self.types["PoseStamped"](self.header(time_s, frame), self.pose(wxyz, place))
        return "geometry_msgs/msg/PoseStamped", message

    def imu(self, time_s, wxyz=(1, 0, 0, 0), *, covariance=0.0):
        given, zero = self.pose(wxyz).orientation, np.zeros(9)
        message = self.types["Imu"](
            self.header(time_s, "base_link"),
            given,
            np.full(9, float(covariance)),
            self.vector((0, 0, 0)),
            zero,
            self.vector((0, 0, 9.81)),
            zero,
        )
        return "sensor_msgs/msg/Imu", message

    def image(self, time_s, array, encoding):
        height, width = array.shape[:2]
        data = np.ascontiguousarray(array).ravel()
        message = self.types["Image"](
            self.header(time_s, "camera"), height, width, encoding, 0, len(data) // height, data
        )
        return "sensor_msgs/msg/Image", message

    def compressed(self, time_s, data):
        message = self.types["CompressedImage"](
            self.header(time_s, "camera"), "jpeg", np.frombuffer(data, np.uint8)
        )
        return "sensor_msgs/msg/CompressedImage", message

    def bytes_of(self, kind, message):
        if self.serial == "ros1":
            return bytes(self.store.serialize_ros1(message, kind))
        return bytes(self.store.serialize_cdr(message, kind))


def write_ros1(path, messages, compression=None, *, chunk_size=1 << 20):
    """`messages`: (topic, time_s, (kind, message)); topics keep one connection each."""
    made = Messages("ros1")
    bag = Ros1Writer(path)
    bag.chunk_threshold = chunk_size
    if compression:
        bag.set_compression(Ros1Writer.CompressionFormat[compression])
    with bag:
        connections = {}
        for topic, time_s, (kind, message) in messages:
            if topic not in connections:
                connections[topic] = bag.add_connection(topic, kind, typestore=made.store)
            bag.write(connections[topic], START_NS + round(time_s * 1e9), made.bytes_of(kind, message))
    return path


def write_ros2(path, messages, plugin):
    made = Messages("cdr")
    with Ros2Writer(path, version=9, storage_plugin=StoragePlugin[plugin]) as bag:
        connections = {}
        for topic, time_s, (kind, message) in messages:
            if topic not in connections:
                connections[topic] = bag.add_connection(topic, kind, typestore=made.store)
            bag.write(connections[topic], START_NS + round(time_s * 1e9), made.bytes_of(kind, message))
    return path


def write_mcap(path, messages, *, serial="cdr", compression="ZSTD", chunk_size=1 << 20, chunks=True):
    made = Messages(serial)
    with path.open("wb") as file:
        writer = McapWriter(
            file, chunk_size=chunk_size, compression=CompressionType[compression], use_chunking=chunks
        )
        writer.start(profile="ros1" if serial == "ros1" else "ros2", library="test")
        channels = {}
        for topic, time_s, (kind, message) in messages:
            if topic not in channels:
                name = kind.replace("/msg/", "/") if serial == "ros1" else kind
                schema = writer.register_schema(name, f"{'ros1' if serial == 'ros1' else 'ros2'}msg", b"")
                channels[topic] = writer.register_channel(topic, serial, schema)
            stamp_ns = START_NS + round(time_s * 1e9)
            writer.add_message(channels[topic], stamp_ns, made.bytes_of(kind, message), stamp_ns)
        writer.finish()
    return path


# Container to the function that writes it and the serialization of its messages.
ROS_CONTAINERS = {
    "ROS 1": (write_ros1, "ros1"),
    "ROS 1, bz2": (lambda path, messages: write_ros1(path, messages, "BZ2"), "ros1"),
    "ROS 1, lz4": (lambda path, messages: write_ros1(path, messages, "LZ4"), "ros1"),
    "ROS 2, SQLite": (lambda path, messages: write_ros2(path, messages, "SQLITE3"), "cdr"),
    "ROS 2, MCAP": (lambda path, messages: write_ros2(path, messages, "MCAP"), "cdr"),
    "MCAP, zstd": (write_mcap, "cdr"),
    "MCAP, lz4": (lambda path, messages: write_mcap(path, messages, compression="LZ4"), "cdr"),
    "MCAP, no chunks": (lambda path, messages: write_mcap(path, messages, chunks=False), "cdr"),
    "MCAP, ROS 1": (lambda path, messages: write_mcap(path, messages, serial="ros1"), "ros1"),
}


def odometry_flight(serial, *, rows=40, linear=(4.0, 1.0, -0.5), wxyz=(1, 0, 0, 0)):
    made = Messages(serial)
    return [("/odom", index / 20, made.odometry(index / 20, linear, wxyz)) for index in range(rows)]
