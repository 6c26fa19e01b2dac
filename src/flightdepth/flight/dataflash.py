"""ArduPilot's DataFlash log (.bin): velocity of the EKF or, at worst, of the GPS; attitude of the body and the gimbal;
the EKF's place on Earth; UTC by the GPS.

Its records (`dataflash_records`) are walked twice: what a log holds decides what is read of it, and all of its numbers
at once take fifty times the file in memory.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from flightdepth.flight.autopilot import (
    LAST_STAMP_US,
    OTHER_GIMBALS,
    BodyAttitude,
    Moment,
    Position,
    Record,
    Velocity,
    autopilot_telemetry,
)
from flightdepth.flight.dataflash_records import FMT, MAGIC, Fields, Layout, field_letters, wanted_rows
from flightdepth.flight.file_bytes import log_bytes
from flightdepth.flight.gimbal import GimbalAttitude, GimbalFlags
from flightdepth.flight.power_ups import longest_boot
from flightdepth.flight.records import Telemetry
from flightdepth.flight.universal_time import utc_of_gps_ns
from flightdepth.motion import quaternion_from_euler

GPS_FIX_3D = 3
WEEK_MS = 7 * 86_400_000
# Bits of the EKF's solution status (SS): horizontal and vertical velocity are good.
VELOCITY_VALID = 2 | 4


def looks_like_dataflash(head: bytes, path: Path) -> bool:
    """Whether the file begins with a record that announces a layout; all DataFlash logs do."""
    return head.startswith(MAGIC + bytes([FMT]))


def read_dataflash(path: Path) -> Telemetry:
    """Read a DataFlash log; what came before a cut is used, damaged bytes are skipped and counted."""
    counts: Counter[str] = Counter()
    data, letters = log_bytes(path), field_letters(path)
    selection = Selection.of(Survey.of(wanted_rows(data, letters, WANTED, Counter())), counts)
    velocity, attitude, records = selection.velocity, selection.attitude, []
    for layout, body in wanted_rows(data, letters, selection.used, counts):
        try:
            records += selection.records(layout.name, layout.fields(body))
        except KeyError as error:
            counts[f"{layout.name} records without {error.args[0]}"] += 1
        except (ValueError, OverflowError):
            counts[f"{layout.name} records with a number that cannot be"] += 1
    what = f"DataFlash {path.name}, {velocity or 'no'} velocity, {attitude or 'no'} attitude"
    return autopilot_telemetry(what, longest_boot(records, counts), counts, told_by=VELOCITIES)


@dataclass
class Survey:
    """What a log holds: its types of record, what the EKF says of itself first, each GPS's fixes.

    primaries  by type of status: the core that is primary first
    statuses   by type of status: the first of each core
    """

    names: set[str] = field(default_factory=set)
    primaries: dict[str, float] = field(default_factory=dict)
    statuses: dict[str, dict[float, int]] = field(default_factory=dict)
    fixes: Counter[float] = field(default_factory=Counter)

    @classmethod
    def of(cls, rows: Iterable[tuple[Layout, bytes]]) -> Survey:
        """Of all the rows of a log."""
        survey = cls()
        for layout, body in rows:
            survey.names.add(layout.name)
            fields = layout.fields(body) if layout.name in SURVEYED else {}
            if layout.name == "GPS":
                survey.fixes[fields.get("I", 0)] += fields.get("Status", 0) >= GPS_FIX_3D
            elif "PI" in fields:
                survey.primaries.setdefault(layout.name, fields["PI"])
                if math.isfinite(status := fields.get("SS", math.nan)):
                    first = survey.statuses.setdefault(layout.name, {})
                    first.setdefault(fields.get("C", 0), int(status))
        return survey


@dataclass
class Selection:
    """Turns rows into records: of the EKF core that ArduPilot flies by, or of one GPS; of the first gimbal.

    `velocity`, `attitude` and `status` (of the EKF) name the types that are used; rows of other types give nothing.
    """

    velocity: str
    attitude: str
    status: str
    counts: Counter[str]
    _core: float | None = None
    _status: dict[float, int] = field(default_factory=dict)
    _gps: float | None = None
    _gps_sigmas: dict[float, float] = field(default_factory=dict)
    _gimbal: float | None = None

    @classmethod
    def of(cls, log: Survey, counts: Counter[str]) -> Selection:
        """For a log: with what the EKF says of itself first, and the first receiver that has a fix mostly."""
        velocity = next((name for name in VELOCITIES if name in log.names), "")
        attitude = next((name for name in ATTITUDES if name in log.names), "")
        fixes = +log.fixes  # of those that have any
        most = max(fixes.values(), default=0)
        receiver = min((number for number, count in fixes.items() if count * 2 >= most), default=None)
        status = EKF_STATUS.get(velocity, "XKF4")
        core, statuses = log.primaries.get(status), log.statuses.get(status, {})
        return cls(velocity, attitude, status, counts, _core=core, _status=statuses, _gps=receiver)

    @property
    def used(self) -> frozenset[str]:
        """The types of record that `records` reads."""
        return frozenset([self.velocity, self.attitude, self.status, "GPS", "GPA", GIMBAL, PLACE])

    def records(self, name: str, fields: Fields) -> list[Record]:
        """The record of a row, if it is of use."""
        if name == self.status:
            self._core = fields["PI"]
            self._status[fields.get("C", 0)] = int(fields["SS"])
        elif name == "GPA":
            self._gps_sigmas[fields.get("I", 0)] = fields["SAcc"]
        elif name == PLACE:
            return [Record(stamp_ns(fields), Position(fields["Lat"], fields["Lng"], fields["Alt"]))]
        elif name == GIMBAL:
            return self._gimbal_attitude(fields)
        elif name == "GPS":
            return [*self._gps_velocity(fields), *self._moment(fields)]
        elif name == self.velocity:
            return self._core_velocity(fields)
        elif name == self.attitude and (name == "ATT" or self._is_primary(fields)):
            return [Record(stamp_ns(fields), BodyAttitude(ATTITUDES[name](fields)))]
        return []

    def _is_primary(self, fields: Fields) -> bool:
        if self._core is None:
            self._core = fields.get("C", 0)  # until a record says which is primary
        return fields.get("C", self._core) == self._core  # without the column there is one core

    def _core_velocity(self, fields: Fields) -> list[Record]:
        if not self._is_primary(fields):
            return []
        if self._status.get(fields.get("C", 0), VELOCITY_VALID) & VELOCITY_VALID != VELOCITY_VALID:
            self.counts["velocities marked invalid"] += 1
            return []
        place = [fields[name] for name in ("PN", "PE", "PD") if name in fields]
        velocity = Velocity((fields["VN"], fields["VE"], fields["VD"]), place=place)
        return [Record(stamp_ns(fields), velocity)]

    def _gps_velocity(self, fields: Fields) -> list[Record]:
        receiver = fields.get("I", 0)
        if self.velocity != "GPS" or not self._is_chosen(receiver):
            return []
        if fields["Status"] < GPS_FIX_3D:
            self.counts["velocities without a 3D fix"] += 1
            return []
        course = math.radians(fields["GCrs"])
        north, east = fields["Spd"] * math.cos(course), fields["Spd"] * math.sin(course)
        return [
            Record(stamp_ns(fields), Velocity((north, east, fields["VZ"]), self._gps_sigmas.get(receiver)))
        ]

    def _is_chosen(self, receiver: float) -> bool:
        self._gps = receiver if self._gps is None else self._gps
        return receiver == self._gps

    def _moment(self, fields: Fields) -> list[Record]:
        """UTC at a fix, where a log tells week and milliseconds."""
        week, of_week_ms = fields.get("GWk", 0), fields.get("GMS", -1)
        fixed = fields.get("Status", 0) >= GPS_FIX_3D and week > 0 and 0 <= of_week_ms < WEEK_MS
        if not fixed or not self._is_chosen(fields.get("I", 0)):
            return []
        return [Record(stamp_ns(fields), Moment(utc_of_gps_ns(int(week), int(of_week_ms))))]

    def _gimbal_attitude(self, fields: Fields) -> list[Record]:
        self._gimbal = fields["I"] if self._gimbal is None else self._gimbal
        if fields["I"] != self._gimbal:
            self.counts[OTHER_GIMBALS] += 1
            return []
        angles = {"Roll": fields["Roll"], "Pitch": fields["Pitch"], "Yaw": fields["YawE"]}
        value = GimbalAttitude(euler_quaternion(angles), GimbalFlags.YAW_IN_EARTH_FRAME)
        return [Record(stamp_ns(fields), value)]


def stamp_ns(fields: Fields) -> int:
    """Time since power-up; one that no log can hold is an error."""
    stamp_us = int(fields["TimeUS"])
    if not 0 <= stamp_us < LAST_STAMP_US:
        raise ValueError(stamp_us)
    return stamp_us * 1000


def ekf_quaternion(fields: Fields) -> Sequence[float]:
    """Q1 to Q4 of the EKF: w first, from body to north-east-down."""
    return fields["Q1"], fields["Q2"], fields["Q3"], fields["Q4"]


def euler_quaternion(fields: Fields) -> Sequence[float]:
    """Quaternion of Roll, Pitch, Yaw in degrees."""
    angles_deg = [fields[name] for name in ("Roll", "Pitch", "Yaw")]
    if not all(map(math.isfinite, angles_deg)):
        return math.nan, 0.0, 0.0, 0.0
    return quaternion_from_euler(*map(math.radians, angles_deg))


# The first of each that a log holds is used: EKF3, EKF2, then what does without an EKF.
VELOCITIES = ("XKF1", "NKF1", "GPS")
ATTITUDES: dict[str, Callable[[Fields], Sequence[float]]] = {
    "XKQ": ekf_quaternion,
    "NKQ": ekf_quaternion,
    "NKQ1": ekf_quaternion,
    "ATT": euler_quaternion,
}
EKF_STATUS = {"XKF1": "XKF4", "NKF1": "NKF4"}
SURVEYED = frozenset([*EKF_STATUS.values(), "GPS"])
GIMBAL = "MNT"  # degrees; YawE counts from north
PLACE = "POS"  # where the EKF has it: degrees, metres above mean sea level
WANTED = frozenset([*VELOCITIES, *ATTITUDES, *EKF_STATUS.values(), "GPA", GIMBAL, PLACE])
