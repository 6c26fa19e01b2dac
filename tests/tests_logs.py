"""Logs of autopilots for tests: ULog and DataFlash by their documented layouts, tlog by pymavlink's writer."""

import math
import struct
from pathlib import Path

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

ULOG_MAGIC = b"ULog\x01\x12\x35\x01"
LOCAL_POSITION = (
    "vehicle_local_position:uint64_t timestamp;uint64_t timestamp_sample;float vx;float vy;float vz;"
    "float evh;float evv;bool v_xy_valid;bool v_z_valid;uint8_t[6] _padding0;"
)
ATTITUDE = (
    "vehicle_attitude:uint64_t timestamp;uint64_t timestamp_sample;float[4] q;float[4] delta_q_reset;"
    "uint8_t quat_reset_counter;uint8_t[7] _padding0;"
)
GIMBAL = (
    "gimbal_device_attitude_status:uint64_t timestamp;float[4] q;float delta_yaw;uint16_t device_flags;"
    "uint8_t[2] _padding0;"
)
# Of 1.15, but for fields that nothing reads; its topics are vehicle_gps_position and sensor_gps.
SENSOR_GPS = (
    "uint64_t timestamp;uint64_t timestamp_sample;uint64_t time_utc_usec;int32_t timestamp_time_relative;"
    "uint8_t fix_type;uint8_t[3] _padding0;"
)
START_US = 7_000_000


def velocity(i):
    """North, east, down, all different and changing, exact as float32."""
    return (3 + i / 8, -1 - i / 16, 0.25 + i / 32)


def quaternion(i):
    q = np.float32([0.9, 0.1, -0.2 - i / 100, 0.3])
    return tuple((q / np.linalg.norm(q)).tolist())


def ulog_message(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


def ulog_bytes(formats, subscriptions, data) -> bytes:
    """`subscriptions`: (instance, id, topic); `data`: (id, body)."""
    parts = [ULOG_MAGIC + struct.pack("<Q", START_US), ulog_message("B", bytes(40))]
    parts += [ulog_message("F", text.encode()) for text in formats]
    parts += [ulog_message("A", struct.pack("<BH", i, number) + t.encode()) for i, number, t in subscriptions]
    parts += [ulog_message("D", struct.pack("<H", number) + body) for number, body in data]
    return b"".join(parts)


def local_position(stamp_us, ned, *, valid=(True, True), deviations=(0.5, 0.25)) -> bytes:
    return struct.pack("<QQ5f2?", stamp_us + 300, stamp_us, *ned, *deviations, *valid)


def attitude(stamp_us, q, resets=0) -> bytes:
    return struct.pack("<QQ8fB", stamp_us + 300, stamp_us, *q, 1, 0, 0, 0, resets)


def gimbal(stamp_us, q, flags, delta_yaw=math.nan) -> bytes:
    return struct.pack("<Q5fH", stamp_us, *q, delta_yaw, flags)


def px4_gps(stamp_us, utc_us, *, relative_us=0, fix=3) -> bytes:
    """What a receiver tells: published at `stamp_us`, its UTC was so `relative_us` later."""
    return struct.pack("<QQQiB", stamp_us, 0, utc_us, relative_us, fix)


def ulog_flight(count=40, period_us=100_000, *, gps=(), gps_topic="vehicle_gps_position") -> bytes:
    """`gps` are bodies by `px4_gps`."""
    data = [(2, reading) for reading in gps]
    for i in range(count):
        stamp = START_US + i * period_us
        data += [(0, local_position(stamp, velocity(i))), (1, attitude(stamp + 20_000, quaternion(i)))]
    formats = [LOCAL_POSITION, ATTITUDE]
    subscriptions = [(0, 0, "vehicle_local_position"), (0, 1, "vehicle_attitude")]
    if gps:
        formats.append(f"{gps_topic}:{SENSOR_GPS}")
        subscriptions.append((0, 2, gps_topic))
    return ulog_bytes(formats, subscriptions, data)


STRUCT_OF = {
    "Q": "Q",
    "B": "B",
    "b": "b",
    "c": "h",
    "C": "H",
    "f": "f",
    "H": "H",
    "n": "4s",
    "L": "i",
    "e": "i",
}
DATAFLASH = {
    "XKF1": (0x81, "QBccCfff", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD"),
    "XKF4": (0x82, "QBHb", "TimeUS,C,SS,PI"),
    "XKQ": (0x83, "QBffff", "TimeUS,C,Q1,Q2,Q3,Q4"),
    "ATT": (0x84, "QccC", "TimeUS,Roll,Pitch,Yaw"),
    "GPS": (0x85, "QBBfff", "TimeUS,I,Status,Spd,GCrs,VZ"),
    "GPA": (0x86, "QBC", "TimeUS,I,SAcc"),
    "IMU": (0x87, "QBfff", "TimeUS,I,GyrX,GyrY,GyrZ"),
    "MNT": (0x88, "QBffffffff", "TimeUS,I,DesRoll,Roll,DesPitch,Pitch,DesYawB,YawB,DesYawE,YawE"),
}


def dataflash_fmt(number, name, letters, columns, length=None) -> bytes:
    size = struct.calcsize("<" + "".join(STRUCT_OF[c] for c in letters)) + 3 if length is None else length
    texts = struct.pack("<4s16s64s", name.encode(), letters.encode(), columns.encode())
    return b"\xa3\x95\x80" + bytes([number, size]) + texts


def dataflash_head(names=DATAFLASH) -> bytes:
    own = dataflash_fmt(0x80, "FMT", "BBn", "Type,Length,Name,Format,Columns", 89)
    own = own.replace(b"BBn\0\0", b"BBnNZ")
    return own + b"".join(dataflash_fmt(DATAFLASH[n][0], n, *DATAFLASH[n][1:]) for n in names)


def dataflash_record(name, *values) -> bytes:
    number, letters, _ = DATAFLASH[name]
    return b"\xa3\x95" + bytes([number]) + struct.pack("<" + "".join(STRUCT_OF[c] for c in letters), *values)


def xkf1(stamp_us, ned, core=0) -> bytes:
    return dataflash_record("XKF1", stamp_us, core, 0, 0, 0, *ned)


def dataflash_flight(count=40, period_us=100_000) -> bytes:
    parts = [dataflash_head()]
    for i in range(count):
        stamp = START_US + i * period_us
        parts += [
            dataflash_record("IMU", stamp - 50_000, 0, 0.1, 0.2, 0.3),
            xkf1(stamp, velocity(i)),
            xkf1(stamp, (-9, -9, -9), core=1),
            dataflash_record("XKQ", stamp + 20_000, 0, *quaternion(i)),
            dataflash_record("XKF4", stamp + 30_000, 0, 0b111, 0),
        ]
    return b"".join(parts)


AUTOPILOT, GROUND = (1, 1), (255, 190)
RECEIVED_US = 1_700_000_000_000_000


def tlog_part(received_us, message, source=AUTOPILOT, *, mavlink_1=False) -> bytes:
    writer = mavlink.MAVLink(None, srcSystem=source[0], srcComponent=source[1])
    return struct.pack(">Q", received_us) + message.pack(writer, force_mavlink1=mavlink_1)


def heartbeat(autopilot=mavlink.MAV_AUTOPILOT_PX4):
    return mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_QUADROTOR, autopilot, 0, 0, 0, 3)


def ned_message(boot_ms, ned):
    return mavlink.MAVLink_local_position_ned_message(boot_ms, 0, 0, 0, *ned)


def quaternion_message(boot_ms, q):
    return mavlink.MAVLink_attitude_quaternion_message(boot_ms, *q, 0, 0, 0)


def tlog_flight(count=40, period_ms=100, *, boot_ms=START_US // 1000, received_us=RECEIVED_US) -> bytes:
    parts = [tlog_part(received_us, heartbeat())]
    for i in range(count):
        now_us, now_ms = received_us + i * period_ms * 1000, boot_ms + i * period_ms
        parts += [
            tlog_part(now_us, ned_message(now_ms, velocity(i))),
            tlog_part(now_us + 20_000, quaternion_message(now_ms + 20, quaternion(i))),
        ]
    return b"".join(parts)


def written(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path
