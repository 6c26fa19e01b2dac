"""What the logs of autopilots share: records on a clock that starts at power-up, good ones and bad ones."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flightdepth.errors import BadInput
from flightdepth.flight.gimbal import GimbalAttitude, camera_attitude
from flightdepth.flight.places import SEA_LEVEL
from flightdepth.flight.positions import place_track
from flightdepth.flight.records import (
    FASTEST_M_S,
    NS_PER_S,
    AttitudeSample,
    BodyAttitudeSample,
    Telemetry,
    VelocitySample,
    by_time,
    none_of,
)
from flightdepth.motion import Vector, rotation_from_quaternion

Stamps = NDArray[np.int64]
Indices = NDArray[np.intp]

# A log's time that steps back, or ahead, by more starts a new run; less is a packet that overtook another.
STEP_NS = 2 * NS_PER_S
# Packets that overtake one another, and messages of other kinds, are not so far apart.
BACK_NS = NS_PER_S // 5
# A run of fewer records beside longer ones is a damaged stamp.
SHORTEST_RUN = 3
# Left free after a reboot, so that nobody integrates across it: more than any gap that is bridged (1.5 s).
REBOOT_GAP_NS = 2 * NS_PER_S
# Stamps beyond are damage: microseconds since 1970 reach this in 2096, and ns still fit into int64.
LAST_STAMP_US = 4 * 10**15
# Reasons that readers share.
DAMAGED_BYTES = "bytes skipped: damaged or cut off"
OTHER_POWER_UPS = "records of other power-ups of the autopilot"
DAMAGED_TIMES = "records with a damaged time"
OTHER_GIMBALS = "attitudes of other gimbals"
# A filter's output that does not change for so long while moving has died.
STUCK_NS = 2 * NS_PER_S
# How old the body's heading may be where a gimbal's yaw counts from it.
HEADING_AGE_NS = NS_PER_S // 2


class Velocity(NamedTuple):
    """Velocity north, east, down in m/s; the standard deviation of each, or None."""

    ned: Sequence[float]
    sigma: float | None = None


class BodyAttitude(NamedTuple):
    """Quaternion (w, x, y, z), world (NED) from body (x forward, y right, z down)."""

    quaternion: Sequence[float]


class Position(NamedTuple):
    """Latitude and longitude, degrees; altitude above mean sea level, metres."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float


class Record(NamedTuple):
    """One value of a log; `stamp_ns` since the autopilot's power-up, `received_ns` by another clock, or 0."""

    stamp_ns: int
    value: Velocity | BodyAttitude | GimbalAttitude | Position
    received_ns: int = 0


def boots(stamps_ns: Stamps, counts: Counter[str], received_ns: Stamps | None = None) -> list[Indices]:
    """Indices of the records [n] of each power-up, in the order of the log; lone damaged stamps are left out.

    A log whose time starts again holds another power-up. Within one, times never go back by STEP_NS. Where another
    clock tells when records were received [n], it also finds a power-up whose times begin near the end of the one
    before, or beyond: more time passed than the autopilot's clock tells.
    """
    steps_ns = np.diff(stamps_ns)
    lost_ns = np.zeros_like(steps_ns) if received_ns is None else np.diff(received_ns) - steps_ns
    breaks = np.flatnonzero((np.abs(steps_ns) > STEP_NS) | ((steps_ns < -BACK_NS) & (lost_ns > STEP_NS))) + 1
    runs = np.split(np.arange(len(stamps_ns)), breaks) if len(stamps_ns) else []
    long_runs = [run for run in runs if len(run) >= SHORTEST_RUN] or runs
    if lost := len(stamps_ns) - sum(map(len, long_runs)):
        counts[DAMAGED_TIMES] += lost
    found: list[Indices] = []
    for run in long_runs:
        if found and _goes_on(stamps_ns, received_ns, found[-1][-1], run[0]):
            found[-1] = np.concatenate([found[-1], run])
        else:
            found.append(run)
    return found


def _goes_on(stamps_ns: Stamps, received_ns: Stamps | None, last: np.intp, first: np.intp) -> bool:
    """Whether the record `first` is of the power-up of the record `last` before it."""
    step_ns = stamps_ns[first] - stamps_ns[last]
    if received_ns is None or step_ns <= STEP_NS:
        return bool(step_ns > 0)  # in step: if another clock goes elsewhere meanwhile, that was set
    return bool(received_ns[first] - received_ns[last] - step_ns <= STEP_NS)


def longest_boot(records: Sequence[Record], counts: Counter[str]) -> list[Record]:
    """The records of the longest power-up; without another clock nobody knows where the others belong."""
    found = boots(np.array([record.stamp_ns for record in records], dtype=np.int64), counts)
    longest = max(found, key=len, default=np.arange(0))
    if left := sum(map(len, found)) - len(longest):
        counts[OTHER_POWER_UPS] += left
    return [records[index] for index in longest.tolist()]


def placed_boots(records: Sequence[Record], counts: Counter[str]) -> list[Record]:
    """All records on the receiver's clock: one offset for each power-up, a gap between two of them.

    The receiver's clock may be set while it runs, so only the first records of a power-up tell its offset.
    """
    stamps = np.array([record.stamp_ns for record in records], dtype=np.int64)
    received = np.array([record.received_ns for record in records], dtype=np.int64)
    placed: list[Record] = []
    for boot in boots(stamps, counts, received):
        offset = int(np.median(received[boot[:50]] - stamps[boot[:50]]))
        if placed:
            counts["reboots inside the log"] += 1
            earliest = max(record.stamp_ns for record in placed) + REBOOT_GAP_NS
            offset = max(offset, earliest - int(stamps[boot].min()))
        placed += [records[i]._replace(stamp_ns=records[i].stamp_ns + offset) for i in boot.tolist()]
    return placed


def autopilot_telemetry(
    name: str, records: Sequence[Record], counts: Counter[str], *, told_by: Iterable[str]
) -> Telemetry:
    """Telemetry from the records of a log on one clock, in any order.

    Its time 0 is that of the first record, positions left aside. `told_by` are the log's names for a velocity.
    """
    ordered = sorted(records, key=lambda record: record.stamp_ns)
    moving = (record.stamp_ns for record in ordered if not isinstance(record.value, Position))
    zero_ns = next(moving, 0)
    gate = Gate(counts)
    stamps_ns: list[int] = []
    positions: list[Position] = []
    # The body's attitudes first: a gimbal's yaw counts from the heading between two of them.
    for stamp_ns, value, _ in sorted(ordered, key=lambda record: not isinstance(record.value, BodyAttitude)):
        if isinstance(value, Position):
            stamps_ns.append(stamp_ns - zero_ns)
            positions.append(value)
        else:
            gate.take(stamp_ns - zero_ns, value)
    if not gate.velocities:
        expected = f"a velocity ({' or '.join(told_by)})"
        raise BadInput(f"telemetry {name}", expected=expected, got=none_of(counts))
    camera = f", {len(gate.cameras)} camera attitudes" if gate.cameras else ""
    what = f"{len(gate.velocities)} velocities, {len(gate.bodies)} body attitudes{camera}"
    table = np.array(positions, dtype=np.float64).reshape(-1, 3)
    places = place_track(stamps_ns, table[:, :2], table[:, 2], SEA_LEVEL, counts)
    return Telemetry(
        f"{name}: {what}; its time 0 is {zero_ns / NS_PER_S:.3f} s of its clock",
        by_time(gate.velocities, gate.cameras),
        dict(+counts),  # without the zeros
        body_attitudes=tuple(gate.bodies),
        places=places,
        time_0_told=False,
    )


@dataclass
class Gate:
    """Takes records, each kind in time order, keeps the sound ones and counts the others."""

    counts: Counter[str]
    velocities: list[VelocitySample] = field(default_factory=list)
    bodies: list[BodyAttitudeSample] = field(default_factory=list)
    cameras: list[AttitudeSample] = field(default_factory=list)
    _unchanged_since_ns: int = 0

    def take(self, stamp_ns: int, value: Velocity | BodyAttitude | GimbalAttitude) -> None:
        """Keep one record, or count why not."""
        if isinstance(value, Velocity):
            self._take_velocity(stamp_ns, value)
        elif not is_rotation(value.quaternion):
            self.counts["attitudes that are no rotation"] += 1
        elif isinstance(value, BodyAttitude):
            if self._later(stamp_ns, self.bodies, "body attitudes"):
                self.bodies.append(BodyAttitudeSample(stamp_ns, np.array(value.quaternion)))
        elif self._later(stamp_ns, self.cameras, "camera attitudes"):
            attitude = camera_attitude(value, self._heading_rad(stamp_ns))
            if attitude is None:
                self.counts["gimbal attitudes without a heading"] += 1
            else:
                self.cameras.append(AttitudeSample(stamp_ns, attitude))

    def _take_velocity(self, stamp_ns: int, value: Velocity) -> None:
        velocity = np.array(value.ned, dtype=np.float64)
        if not np.isfinite(velocity).all():
            self.counts["velocities that are not numbers"] += 1
        elif np.linalg.norm(velocity) > FASTEST_M_S:
            self.counts[f"velocities above {FASTEST_M_S:.0f} m/s"] += 1
        elif self._later(stamp_ns, self.velocities, "velocities") and self._alive(stamp_ns, velocity):
            sound = value.sigma is not None and math.isfinite(value.sigma) and value.sigma >= 0
            self.velocities.append(VelocitySample(stamp_ns, velocity, sigma=value.sigma if sound else None))

    def _alive(self, stamp_ns: int, velocity: Vector) -> bool:
        newest = self.velocities[-1].velocity if self.velocities else None
        if newest is None or not velocity.any() or not np.array_equal(newest, velocity):
            self._unchanged_since_ns = stamp_ns
        alive = stamp_ns - self._unchanged_since_ns <= STUCK_NS
        self.counts["stuck velocities"] += not alive
        return alive

    def _later(
        self, stamp_ns: int, kept: Sequence[VelocitySample | BodyAttitudeSample | AttitudeSample], kind: str
    ) -> bool:
        later = not kept or stamp_ns > kept[-1].stamp_ns
        self.counts[f"{kind} not later than the one before"] += not later
        return later

    def _heading_rad(self, stamp_ns: int) -> float | None:
        """The body's heading between its attitudes before and after; where these are far apart that of the near one."""
        after = bisect_left(self.bodies, stamp_ns, key=lambda body: body.stamp_ns)
        around = self.bodies[max(after - 1, 0) : after + 1]
        if len(around) < 2 or around[1].stamp_ns - around[0].stamp_ns > 2 * HEADING_AGE_NS:
            around = [body for body in around if abs(body.stamp_ns - stamp_ns) <= HEADING_AGE_NS]
        if not around:
            return None
        headings_rad = np.unwrap([heading_rad(body) for body in around])
        return float(np.interp(stamp_ns, [body.stamp_ns for body in around], headings_rad))


def heading_rad(body: BodyAttitudeSample) -> float:
    """Where a body's x points, from north clockwise."""
    rotation = rotation_from_quaternion(body.world_from_body)
    return math.atan2(rotation[1, 0], rotation[0, 0])


def is_rotation(quaternion: Iterable[float]) -> bool:
    """Whether four numbers are a unit quaternion, as far as a log's rounding allows."""
    numbers = [float(number) for number in quaternion]
    return all(abs(number) < 1.1 for number in numbers) and 0.9 < math.hypot(*numbers) < 1.1
