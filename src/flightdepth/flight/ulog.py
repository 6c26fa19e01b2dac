"""PX4's ULog (.ulg), through pyulog: local velocity, attitude of the body, attitude of a gimbal, place on Earth, UTC.

Fields are those of PX4's uORB messages VehicleLocalPosition, VehicleAttitude, GimbalDeviceAttitudeStatus,
VehicleGlobalPosition and SensorGps.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from itertools import compress, repeat
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flightdepth.flight.autopilot import (
    LAST_STAMP_US,
    OTHER_GIMBALS,
    BodyAttitude,
    Moment,
    Position,
    Record,
    Value,
    Velocity,
    autopilot_telemetry,
)
from flightdepth.flight.gimbal import GimbalAttitude
from flightdepth.flight.power_ups import DAMAGED_TIMES, OTHER_POWER_UPS, boots, longest_boot
from flightdepth.flight.records import Telemetry
from flightdepth.flight.ulog_file import MAGIC, load

Columns = dict[str, NDArray[Any]]
QUATERNION = ("q[0]", "q[1]", "q[2]", "q[3]")
POSITION, GIMBAL = "vehicle_local_position", "gimbal_device_attitude_status"
INVALID_POSITIONS = "positions marked invalid"
FIX_3D = 3
JOINED = "another log joined to this one, not read"


def looks_like_ulog(head: bytes, path: Path) -> bool:
    """Whether the file begins with ULog's magic number."""
    return head.startswith(MAGIC)


def read_ulog(path: Path) -> Telemetry:
    """Read a ULog; what came before a cut is used, and the cut is counted."""
    counts: Counter[str] = Counter()
    log, cut, joined = load(path, list(TOPICS))
    counts[JOINED] += joined
    counts["cut off or damaged: the log is not whole"] += cut or bool(log.file_corruption)
    counts["drop-outs that the logger noted"] += len(log.dropouts)
    resets, records = 0, []
    instances = {topic: first_instance(log, topic, counts) for topic in TOPICS}
    topics = {topic: columns for topic, columns in instances.items() if columns is not None}
    for topic, columns in of_one_power_up(topics, counts).items():
        records += complete_records(TOPICS[topic], columns, counts)
        resets += reset_count(columns)
    records.sort(key=lambda record: record.stamp_ns)
    noted = f" ({resets} resets of the attitude)" if resets else ""
    flown = longest_boot(records, counts)
    return autopilot_telemetry(f"ULog {path.name}{noted}", flown, counts, told_by=[POSITION])


def first_instance(log: Any, topic: str, counts: Counter[str]) -> Columns | None:
    """The columns of a topic's first instance: PX4 publishes what it flies by there."""
    found = [dataset for dataset in log.data_list if dataset.name == topic]
    first, *others = sorted(found, key=lambda dataset: dataset.multi_id) or [None]
    if topic == GIMBAL:
        counts[OTHER_GIMBALS] += sum(len(other.data.get("device_flags", ())) for other in others)
    return None if first is None else first.data


def of_one_power_up(topics: dict[str, Columns], counts: Counter[str]) -> dict[str, Columns]:
    """The columns of the power-up with most velocities, where the log's time starts again.

    A topic that does not start again as often is left out: nobody knows which power-up it belongs to.
    """
    parts = {topic: power_ups(columns) for topic, columns in topics.items()}
    flown = parts.get(POSITION, [])
    if not flown or all(len(each) == 1 for each in parts.values()):
        return topics
    longest = max(range(len(flown)), key=lambda number: len(flown[number]["timestamp"]))
    chosen = {topic: each[longest] for topic, each in parts.items() if len(each) == len(flown)}
    given, kept = (sum(len(columns["timestamp"]) for columns in part.values()) for part in (topics, chosen))
    counts[OTHER_POWER_UPS] += given - kept
    return chosen


def power_ups(columns: Columns) -> list[Columns]:
    """The columns of each power-up, in the order of the log; whole where there is one."""
    stamps_ns = np.array([min(stamp, LAST_STAMP_US) * 1000 for stamp in stamps_us(columns)], dtype=np.int64)
    found = boots(stamps_ns, Counter())
    return (
        [{name: values[run] for name, values in columns.items()} for run in found] if found[1:] else [columns]
    )


def complete_records(
    read_records: Callable[[Columns, Counter[str]], Iterator[Record]],
    columns: Columns,
    counts: Counter[str],
) -> list[Record]:
    """The records of a topic; none, and a count, where a damaged format lacks a field."""
    try:
        with np.errstate(all="ignore"):  # trash may be any number
            return list(read_records(columns, counts))
    except KeyError as error:
        counts[f"topics without the field {error.args[0]}"] += 1
        return []


def velocities(columns: Columns, counts: Counter[str]) -> Iterator[Record]:
    """VehicleLocalPosition: velocity where PX4 calls both parts valid, with its standard deviation."""
    valid = columns["v_xy_valid"].astype(bool) & columns["v_z_valid"].astype(bool)
    counts["velocities marked invalid"] += int(np.count_nonzero(~valid))
    # evh is the deviation of the horizontal velocity's length: sqrt(var_north + var_east) (EKF2).
    told = (
        columns.get(name, np.full(len(valid), np.nan)).astype(np.float64) for name in ("evh", "evv", *"xyz")
    )
    evh, evv, *places = told
    sigmas = np.sqrt((evh * evh + evv * evv) / 3)
    ned = np.stack([columns[name] for name in ("vx", "vy", "vz")], axis=1).astype(np.float64)
    found = map(Velocity, ned.tolist(), sigmas.tolist(), np.stack(places, axis=1).tolist())
    return timed(columns, found, counts, valid)


def body_attitudes(columns: Columns, counts: Counter[str]) -> Iterator[Record]:
    """VehicleAttitude: q rotates from body (forward, right, down) to world (NED), w first."""
    return timed(columns, map(BodyAttitude, quaternions(columns)), counts)


def gimbal_attitudes(columns: Columns, counts: Counter[str]) -> Iterator[Record]:
    """GimbalDeviceAttitudeStatus: as MAVLink's; older logs have no `delta_yaw`."""
    flags = columns["device_flags"].astype(np.int64)
    delta_yaws = columns.get("delta_yaw", np.full(len(flags), np.nan))
    found = map(GimbalAttitude, quaternions(columns), flags.tolist(), delta_yaws.tolist())
    return timed(columns, found, counts)


def global_positions(columns: Columns, counts: Counter[str]) -> Iterator[Record]:
    """VehicleGlobalPosition: the place by which PX4 flies; older logs do not say whether it is valid."""
    lat, lon, alt = (columns[name].astype(np.float64) for name in ("lat", "lon", "alt"))
    whole = np.ones(len(lat), dtype=bool)
    valid, measured = (columns.get(name, whole).astype(bool) for name in ("lat_lon_valid", "alt_valid"))
    counts[INVALID_POSITIONS] += int(np.count_nonzero(~valid))
    altitudes_m = np.where(measured, alt, np.nan)
    return timed(columns, map(Position, lat.tolist(), lon.tolist(), altitudes_m.tolist()), counts, valid)


def moments(columns: Columns, counts: Counter[str]) -> Iterator[Record]:
    """SensorGps: UTC at a fix in three dimensions; 0 before the receiver knows it, and old logs have none."""
    stamps_us = np.minimum(columns["timestamp"], LAST_STAMP_US).astype(np.int64)
    untold = np.zeros_like(stamps_us)
    utc_us = np.minimum(columns.get("time_utc_usec", untold), LAST_STAMP_US).astype(np.int64)
    fixed = (columns.get("fix_type", untold) >= FIX_3D) & (utc_us > 0)
    told_us = stamps_us + columns.get("timestamp_time_relative", untold)  # when it was so
    return timed({"timestamp": told_us}, (Moment(each * 1000) for each in utc_us.tolist()), counts, fixed)


def timed(
    columns: Columns,
    values: Iterable[Value],
    counts: Counter[str],
    kept: NDArray[np.bool_] | None = None,
) -> Iterator[Record]:
    """A record for each of the values [n] that is `kept` [n]; damaged times are counted instead."""
    told = repeat(True) if kept is None else kept.tolist()
    for stamp_us, value in compress(zip(stamps_us(columns), values, strict=True), told):
        if stamp_us < LAST_STAMP_US:
            yield Record(stamp_us * 1000, value)
        else:
            counts[DAMAGED_TIMES] += 1


def stamps_us(columns: Columns) -> list[int]:
    """Time since power-up; of the measurement where the topic says it, else of its publication."""
    stamps = columns["timestamp_sample" if "timestamp_sample" in columns else "timestamp"]
    stamps = np.where(stamps == 0, columns.get("timestamp", stamps), stamps)  # 0 where nobody set it
    return [int(stamp) for stamp in stamps.tolist()]


def quaternions(columns: Columns) -> list[list[float]]:
    """Rows of (w, x, y, z)."""
    rows: list[list[float]] = np.stack([columns[name] for name in QUATERNION], axis=1).tolist()
    return rows


def reset_count(columns: Columns) -> int:
    """How often the estimator set its attitude anew; a camera's pictures do not jump with it."""
    counter = columns.get("quat_reset_counter")
    return 0 if counter is None else int(np.count_nonzero(np.diff(counter)))


TOPICS: dict[str, Callable[[Columns, Counter[str]], Iterator[Record]]] = {
    POSITION: velocities,
    "vehicle_attitude": body_attitudes,
    GIMBAL: gimbal_attitudes,
    "vehicle_global_position": global_positions,
    "vehicle_gps_position": moments,
    "sensor_gps": moments,  # what the former is made of; logs may hold either
}
