"""What the logs of autopilots share: records on a clock that starts at power-up, good ones and bad ones."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

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
    time_0_is,
)
from flightdepth.flight.universal_time import LAST_UTC_NS, Clock, UniversalTime
from flightdepth.motion import is_rotation, rotation_from_quaternion

# Stamps beyond are damage, of clocks that count from 1970 too; ns still fit into int64.
LAST_STAMP_US = LAST_UTC_NS // 1000
# Reasons that readers share.
DAMAGED_BYTES = "bytes skipped: damaged or cut off"
OTHER_GIMBALS = "attitudes of other gimbals"
NO_ROTATION = "attitudes that are no rotation"
# A filter's output that does not change for so long while moving has died.
STUCK_NS = 2 * NS_PER_S
# How old the body's heading may be where a gimbal's yaw counts from it.
HEADING_AGE_NS = NS_PER_S // 2


class Velocity(NamedTuple):
    """Velocity north, east, down in m/s; the standard deviation of each, or None; the place told beside it, if any."""

    ned: Sequence[float]
    sigma: float | None = None
    place: Sequence[float] = ()


class BodyAttitude(NamedTuple):
    """Quaternion (w, x, y, z), world (NED) from body (x forward, y right, z down)."""

    quaternion: Sequence[float]


class Position(NamedTuple):
    """Latitude and longitude, degrees; altitude above mean sea level, metres."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float


class Moment(NamedTuple):
    """Universal time, ns since 1970."""

    utc_ns: int


Value = Velocity | BodyAttitude | GimbalAttitude | Position | Moment


class Record(NamedTuple):
    """One value of a log; `stamp_ns` since the autopilot's power-up, `received_ns` by another clock, or 0."""

    stamp_ns: int
    value: Value
    received_ns: int = 0


def autopilot_telemetry(
    name: str,
    records: Sequence[Record],
    counts: Counter[str],
    *,
    told_by: Iterable[str],
    clock: Clock = "satellites",
) -> Telemetry:
    """Telemetry from the records of a log on one clock, in any order.

    Its time 0 is that of the first record, positions and moments left aside. `told_by` are the log's names for a
    velocity; `clock` is what the moments are read from.
    """
    ordered = sorted(records, key=lambda record: record.stamp_ns)
    moving = (record.stamp_ns for record in ordered if not isinstance(record.value, Position | Moment))
    zero_ns = next(moving, 0)
    gate = Gate(counts)
    stamps_ns: list[int] = []
    positions: list[Position] = []
    moments: list[tuple[int, int]] = []
    # The body's attitudes first: a gimbal's yaw counts from the heading between two of them.
    for stamp_ns, value, _ in sorted(ordered, key=lambda record: not isinstance(record.value, BodyAttitude)):
        if isinstance(value, Position):
            stamps_ns.append(stamp_ns - zero_ns)
            positions.append(value)
        elif isinstance(value, Moment):
            moments.append((stamp_ns - zero_ns, value.utc_ns))
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
        f"{name}: {what}{time_0_is(zero_ns)}",
        by_time(gate.velocities, gate.cameras),
        dict(+counts),  # without the zeros
        body_attitudes=tuple(gate.bodies),
        places=places,
        time_0_told=False,
        utc=UniversalTime.by_readings(moments, clock),
    )


@dataclass
class Gate:
    """Takes records, each kind in time order, keeps the sound ones and counts the others."""

    counts: Counter[str]
    velocities: list[VelocitySample] = field(default_factory=list)
    bodies: list[BodyAttitudeSample] = field(default_factory=list)
    cameras: list[AttitudeSample] = field(default_factory=list)
    _told: tuple[float, ...] = ()
    _unchanged_since_ns: int = 0

    def take(self, stamp_ns: int, value: Velocity | BodyAttitude | GimbalAttitude) -> None:
        """Keep one record, or count why not."""
        if isinstance(value, Velocity):
            self._take_velocity(stamp_ns, value)
        elif not is_rotation(value.quaternion):
            self.counts[NO_ROTATION] += 1
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
        if not all(map(math.isfinite, value.ned)):
            self.counts["velocities that are not numbers"] += 1
        elif math.hypot(*value.ned) > FASTEST_M_S:
            self.counts[f"velocities above {FASTEST_M_S:.0f} m/s"] += 1
        elif self._later(stamp_ns, self.velocities, "velocities") and self._alive(stamp_ns, value):
            sound = value.sigma is not None and math.isfinite(value.sigma) and value.sigma >= 0
            sigma = value.sigma if sound else None
            self.velocities.append(
                VelocitySample(stamp_ns, np.array(value.ned, dtype=np.float64), sigma=sigma)
            )

    def _alive(self, stamp_ns: int, value: Velocity) -> bool:
        """Whether it, or the place beside it, has changed lately: a simulator's speed may be as even as it likes."""
        before, self._told = self._told, (*value.ned, *filter(math.isfinite, value.place))
        if self._told != before or not any(value.ned):
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
