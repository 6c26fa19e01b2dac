"""A ground station's MAVLink log (.tlog), through pymavlink: what the autopilot sent while it flew.

Each message stands behind the time it was received, microseconds since 1970, big-endian 64 bit. Messages and
their units: https://mavlink.io/en/messages/common.html
"""

from __future__ import annotations

import math
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from flightdepth.errors import BadInput, MissingExtra
from flightdepth.flight.autopilot import (
    DAMAGED_BYTES,
    OTHER_GIMBALS,
    BodyAttitude,
    Position,
    Record,
    Velocity,
    autopilot_telemetry,
    placed_boots,
)
from flightdepth.flight.file_bytes import log_bytes
from flightdepth.flight.gimbal import GimbalAttitude
from flightdepth.flight.positions import UNFIXED
from flightdepth.flight.records import Telemetry
from flightdepth.motion import quaternion_from_rotation, rotation_from_euler, rotation_from_quaternion

# A time before 2096 and the first byte of a message, MAVLink 1 or 2.
START = re.compile(rb"\x00[\x00-\x0e].{6}[\xfe\xfd]", re.DOTALL)
TIME_BYTES = 8
MAVLINK_1 = 0xFE
SIGNED = 1  # bit of MAVLink 2's incompatibility flags; a signature makes the message longer
HEARTBEAT = "HEARTBEAT"
NO_AUTOPILOT = 8  # MAV_AUTOPILOT_INVALID: the sender of this heartbeat flies nothing
# MAV_FRAME of ODOMETRY's pose and velocity.
LOCAL_NED, BODY_NED, BODY_FRD = 1, 8, 12
# Time in `time_usec` beyond a year is since 1970, so on a clock that other messages do not share.
YEAR_US = 365 * 86400 * 10**6

Message = Any


class Source(NamedTuple):
    """Who sent a message: MAVLink's numbers of the vehicle and of the device in it."""

    system: int
    component: int


# Records of each sender with the name of their message, in the order of the log.
Found = dict[Source, list[tuple[str, Record]]]


def looks_like_tlog(head: bytes, path: Path) -> bool:
    """Whether the file begins with a time and a message, and then another, as far as `head` reaches."""
    size = frame_size(head, 0)
    return size > 0 and (len(head) < size + TIME_BYTES + 1 or START.match(head, size) is not None)


def read_tlog(path: Path) -> Telemetry:
    """Read a tlog; damaged messages and bytes are skipped and counted."""
    counts: Counter[str] = Counter()
    found: Found = defaultdict(list)
    autopilots = set()
    for received_us, message in messages(path, counts):
        source, name = Source(message.get_srcSystem(), message.get_srcComponent()), message.get_type()
        if name == HEARTBEAT:
            autopilots |= {source} if message.autopilot != NO_AUTOPILOT else set()
            continue
        for stamp_ns, value in KINDS[name](message, counts):
            found[source].append((name, Record(stamp_ns, value, received_us * 1000)))
    chosen = the_autopilot(found, autopilots, counts)
    if chosen is None:
        got = "none of a vehicle's" + (f" ({sum(counts.values())} damaged)" if counts else "")
        raise BadInput(f"telemetry {path}", expected=f"{' or '.join(VELOCITIES)} messages", got=got)
    return telemetry_of(path.name, chosen, found, counts)


def the_autopilot(found: Found, autopilots: set[Source], counts: Counter[str]) -> Source | None:
    """The source to believe: one whose heartbeat says autopilot, else any; of several the most talkative."""
    spoken = Counter(
        source for source, rows in found.items() for _, record in rows if isinstance(record.value, Velocity)
    )
    if not spoken:
        return None
    chosen = max(spoken, key=lambda source: (source in autopilots, spoken[source]))
    counts["velocities of other senders"] += spoken.total() - spoken[chosen]
    return chosen


def telemetry_of(name: str, source: Source, found: Found, counts: Counter[str]) -> Telemetry:
    """Telemetry of one vehicle: its autopilot's records, and the gimbal's, which has a clock of its own."""
    names = {kind for kind, _ in found[source]}
    velocity = next(kind for kind in VELOCITIES if kind in names)
    attitude = next((kind for kind in ATTITUDES if kind in names), None)
    wanted = {(velocity, Velocity), (attitude, BodyAttitude), (GLOBAL, Position)}
    own = [record for kind, record in found[source] if (kind, type(record.value)) in wanted]
    records = placed_boots(own, counts)
    for sender in sorted(sender for sender in found if sender.system == source.system):
        gimbals: dict[int, list[Record]] = defaultdict(list)
        for _, record in found[sender]:
            if isinstance(record.value, GimbalAttitude):
                gimbals[record.value.device].append(record)
        if gimbals:
            first, *others = gimbals.values()  # the first one carries the camera
            counts[OTHER_GIMBALS] += sum(map(len, others))
            if not any(record.stamp_ns for record in first):  # it has no clock
                first = [record._replace(stamp_ns=record.received_ns) for record in first]
            records += placed_boots(first, counts)
            break
    what = f"tlog {name}, {velocity} of vehicle {source.system}"
    return autopilot_telemetry(what, records, counts, told_by=VELOCITIES)


def messages(path: Path, counts: Counter[str]) -> Iterator[tuple[int, Message]]:
    """Time of reception (us) and message, of the kinds in KINDS and heartbeats, with a sound checksum."""
    try:
        from pymavlink.dialects.v20 import common as mavlink
    except ModuleNotFoundError as error:
        raise MissingExtra(f"reading the MAVLink log {path.name}", "ardupilot") from error
    data = log_bytes(path)
    wanted = {number for number, kind in mavlink.mavlink_map.items() if kind.msgname in (HEARTBEAT, *KINDS)}
    decoder = mavlink.MAVLink(None)

    def decode(frame: bytes) -> Message | None:
        try:
            return decoder.decode(bytearray(frame))
        except mavlink.MAVError:
            counts["messages with a wrong checksum"] += 1
            return None

    yield from decoded(data, wanted, decode, counts)


def decoded(
    data: bytes, wanted: set[int], decode: Callable[[bytes], Message | None], counts: Counter[str]
) -> Iterator[tuple[int, Message]]:
    """Walk from message to message; an unwanted one counts as whole if another, or the end, follows."""
    at = 0
    while at < len(data):
        size = frame_size(data, at)
        whole = 0 < size <= len(data) - at
        if whole and message_number(data, at + TIME_BYTES) in wanted:
            message = decode(data[at + TIME_BYTES : at + size])
            whole = message is not None
            if whole:
                yield int.from_bytes(data[at : at + TIME_BYTES], "big"), message
        elif whole:
            left = len(data) - at - size
            whole = left <= TIME_BYTES or START.match(data, at + size) is not None
        if whole:
            at += size
        else:
            found = START.search(data, at + 1)
            next_at = found.start() if found else len(data)
            counts[DAMAGED_BYTES] += next_at - at
            at = next_at


def frame_size(data: bytes, at: int) -> int:
    """Bytes of the time and message that begin at `at`, 0 where none does."""
    if START.match(data, at) is None or len(data) < at + TIME_BYTES + 10:
        return 0
    first, length, flags = data[at + TIME_BYTES : at + TIME_BYTES + 3]
    if first == MAVLINK_1:
        return TIME_BYTES + 8 + length
    return TIME_BYTES + 12 + length + (13 if flags & SIGNED else 0)


def message_number(data: bytes, at: int) -> int:
    """The number of the message that begins at `at`."""
    return data[at + 5] if data[at] == MAVLINK_1 else int.from_bytes(data[at + 7 : at + 10], "little")


def local_position(message: Message, counts: Counter[str]) -> Iterator[tuple[int, Velocity]]:
    """LOCAL_POSITION_NED."""
    yield message.time_boot_ms * 10**6, Velocity((message.vx, message.vy, message.vz))


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
        yield message.time_usec * 1000, Velocity(ned, sigma)
        yield message.time_usec * 1000, BodyAttitude(message.q)


def global_position(message: Message, counts: Counter[str]) -> Iterator[tuple[int, Velocity | Position]]:
    """GLOBAL_POSITION_INT: 1e-7 degrees, mm above mean sea level, cm/s; all zero before the first fix."""
    if message.lat == message.lon == 0:
        counts[UNFIXED] += 1
        return
    stamp_ns = message.time_boot_ms * 10**6
    yield stamp_ns, Velocity((message.vx / 100, message.vy / 100, message.vz / 100))
    yield stamp_ns, Position(message.lat / 1e7, message.lon / 1e7, message.alt / 1000)


def attitude_quaternion(message: Message, counts: Counter[str]) -> Iterator[tuple[int, BodyAttitude]]:
    """ATTITUDE_QUATERNION: w first, from body to NED."""
    quaternion = (message.q1, message.q2, message.q3, message.q4)
    yield message.time_boot_ms * 10**6, BodyAttitude(quaternion)


def attitude(message: Message, counts: Counter[str]) -> Iterator[tuple[int, BodyAttitude]]:
    """ATTITUDE: roll, pitch and yaw in radians."""
    angles = message.roll, message.pitch, message.yaw
    if all(map(math.isfinite, angles)):
        quaternion = quaternion_from_rotation(rotation_from_euler(*angles)).tolist()
        yield message.time_boot_ms * 10**6, BodyAttitude(quaternion)
    else:
        counts["attitudes that are no rotation"] += 1


def gimbal(message: Message, counts: Counter[str]) -> Iterator[tuple[int, GimbalAttitude]]:
    """GIMBAL_DEVICE_ATTITUDE_STATUS, as it stands."""
    value = GimbalAttitude(message.q, message.flags, message.delta_yaw, message.gimbal_device_id)
    yield message.time_boot_ms * 10**6, value


GIMBAL, GLOBAL = "GIMBAL_DEVICE_ATTITUDE_STATUS", "GLOBAL_POSITION_INT"
# The first of each that the autopilot sent is used.
VELOCITIES = ("LOCAL_POSITION_NED", "ODOMETRY", GLOBAL)
ATTITUDES = ("ATTITUDE_QUATERNION", "ATTITUDE", "ODOMETRY")
KINDS: dict[str, Callable[[Message, Counter[str]], Iterator[tuple[int, Any]]]] = {
    "LOCAL_POSITION_NED": local_position,
    "ODOMETRY": odometry,
    GLOBAL: global_position,
    "ATTITUDE_QUATERNION": attitude_quaternion,
    "ATTITUDE": attitude,
    GIMBAL: gimbal,
}
