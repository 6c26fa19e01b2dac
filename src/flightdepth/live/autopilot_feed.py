"""MAVLink messages of one vehicle, as they come, into velocities and attitudes on the live clock.

What a message means is `flight.mavlink_messages`' business, what is sound is `flight.autopilot.Gate`'s: a flight gives
the same samples live and from its log.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from flightdepth.flight.autopilot import OTHER_GIMBALS, Gate, Moment, Position, Velocity
from flightdepth.flight.mavlink_messages import (
    ATTITUDES,
    GIMBAL,
    HEARTBEAT,
    KINDS,
    VELOCITIES,
    Message,
    Source,
    flies,
)
from flightdepth.flight.power_ups import DAMAGED_TIMES, REBOOT_GAP_NS, SHORTEST_RUN, STEP_NS
from flightdepth.flight.records import NS_PER_S, BodyAttitudeSample, Sample, VelocitySample
from flightdepth.live.clock import RemoteClock
from flightdepth.live.motion_store import MotionStore

# Of two messages that tell the same the better one counts, as long as it keeps coming.
PREFERRED_FOR_NS = NS_PER_S
DOWNWARD = 25  # MAV_SENSOR_ROTATION_PITCH_270: a range finder that looks down
INVALID = 1  # a DISTANCE_SENSOR's `signal_quality`: 0 is unknown, 100 perfect
NOTHING = "", -NS_PER_S


@dataclass(frozen=True)
class AutopilotListener:
    """Who hears of the autopilot, on the link's thread; times on the live clock."""

    on_velocity: Callable[[int], None]
    on_reboot: Callable[[int], None]


class AutopilotFeed:
    """Takes every message of a link in the order of arrival; keeps what one vehicle's autopilot says.

    That is vehicle number `system`, or the first one heard: by a heartbeat of its autopilot, before which nothing
    counts. `clock` is the autopilot's; `counts` says what was left out.
    """

    def __init__(self, store: MotionStore, listener: AutopilotListener, *, system: int | None = None) -> None:
        self.vehicle: Source | None = None
        self._system = system
        self.clock = RemoteClock()
        self.counts: Counter[str] = Counter()
        self._store, self._listener = store, listener
        self._gate = Gate(self.counts)
        self._gimbal: tuple[Source, int] | None = None
        self._gimbal_clock = RemoteClock()
        self._seen: dict[str, int] = {}
        self._offset_ns: int | None = None  # a copy of the clock's, for other threads
        self._ahead = 0  # times in a row that lie ahead of the clock
        self._newest_boot_ns = 0
        self._newest_live_ns = 0
        self._held_until_ns = 0
        self._left_out = NOTHING  # why a velocity did not count last, and when; until one does
        self._other = 0, -NS_PER_S  # the last other vehicle that told a velocity, and when

    def instead(self, now_ns: int) -> str:
        """What the autopilot does in place of telling velocities that count; any thread may ask."""
        if self.vehicle is None:
            of = "" if self._system is None else f" of vehicle {self._system}"
            return f"no autopilot's heartbeat{of} comes"
        why, left_out_ns = self._left_out
        if now_ns - left_out_ns < NS_PER_S:
            return f"{why} are left out"
        system, told_ns = self._other
        other = f"; those of vehicle {system} are left out" if now_ns - told_ns < NS_PER_S else ""
        return f"the autopilot of vehicle {self.vehicle.system} tells none ({', '.join(VELOCITIES)}){other}"

    def take(self, message: Message, now_ns: int) -> None:
        """One message, received at `now_ns`."""
        name = message.get_type()
        source = Source(message.get_srcSystem(), message.get_srcComponent())
        if name == HEARTBEAT:
            wanted = flies(message) and self._system in (None, source.system)
            if wanted and self.vehicle is None:
                self.vehicle = source
        elif self.vehicle is None or source.system != self.vehicle.system:
            self.counts["messages of other vehicles"] += name in KINDS and self.vehicle is not None
            if name in VELOCITIES and self.vehicle is not None:
                self._other = source.system, now_ns
        elif name == GIMBAL:
            self._take_gimbal(message, source, now_ns)
        elif source == self.vehicle:
            before = Counter(self.counts) if name in VELOCITIES else None
            self._take_autopilot(name, message, now_ns)
            if before is not None and (left_out := self.counts - before):
                self._left_out = next(iter(left_out)), now_ns

    def boot_ns(self, live_ns: int) -> int | None:
        """A time of the live clock on the autopilot's, None before anything was heard of that."""
        return None if self._offset_ns is None else live_ns - self._offset_ns

    def _take_autopilot(self, name: str, message: Message, now_ns: int) -> None:
        if name == "TIMESYNC":
            if message.tc1 != 0 and not self._is_damaged(message.tc1, now_ns):
                self.clock.answered(message.ts1, message.tc1, now_ns)
        elif name == "DISTANCE_SENSOR":
            self._take_range(message, now_ns)
        elif name == "ALTITUDE":
            if math.isfinite(message.bottom_clearance) and message.bottom_clearance > 0:
                self._store.add_height(now_ns, message.bottom_clearance)
        elif name in KINDS:
            self._seen[name] = now_ns
            for boot_ns, value in KINDS[name](message, self.counts):
                if isinstance(value, Position | Moment):  # nobody asks live where on Earth it is, or when
                    continue
                if not self._is_best(name, VELOCITIES if isinstance(value, Velocity) else ATTITUDES, now_ns):
                    continue
                if self._is_damaged(boot_ns, now_ns):
                    continue
                self._watch_for_reboot(boot_ns, now_ns)
                self.clock.arrived(boot_ns, now_ns)
                self._offset_ns = self.clock.offset_ns
                self._keep(self.clock.live_ns(boot_ns), value, now_ns)

    def _take_gimbal(self, message: Message, source: Source, now_ns: int) -> None:
        """A gimbal has a clock of its own; the first one that reports carries the camera."""
        gimbal = source, message.gimbal_device_id
        self._gimbal = gimbal if self._gimbal is None else self._gimbal
        if gimbal != self._gimbal:
            self.counts[OTHER_GIMBALS] += 1
            return
        for boot_ns, value in KINDS[GIMBAL](message, self.counts):
            if boot_ns == 0:  # a gimbal without a clock
                self._keep(now_ns, value, now_ns)
                continue
            self._gimbal_clock.arrived(boot_ns, now_ns)
            self._keep(self._gimbal_clock.live_ns(boot_ns), value, now_ns)

    def _take_range(self, message: Message, now_ns: int) -> None:
        within = message.min_distance <= message.current_distance <= message.max_distance
        if message.orientation != DOWNWARD or not within or message.current_distance <= 0:
            return
        if message.signal_quality == INVALID:
            self.counts["heights of a range finder without an echo"] += 1
        else:
            self._store.add_height(now_ns, message.current_distance / 100)

    def _is_best(self, name: str, family: tuple[str, ...], now_ns: int) -> bool:
        """Whether no better message of its family came lately. ODOMETRY stands in both families."""
        better = [self._seen[kind] for kind in family[: family.index(name)] if kind in self._seen]
        return all(now_ns - seen_ns >= PREFERRED_FOR_NS for seen_ns in better)

    def _is_damaged(self, boot_ns: int, now_ns: int) -> bool:
        """Whether a time lies ahead of the autopilot's clock; SHORTEST_RUN of them in a row are a clock that jumped."""
        self._ahead = self._ahead + 1 if self.clock.is_ahead(boot_ns, now_ns) else 0
        if 0 < self._ahead < SHORTEST_RUN:
            self.counts[DAMAGED_TIMES] += 1
            return True
        if self._ahead:
            self.counts["jumps of the autopilot's clock"] += 1
            self.clock, self._ahead = RemoteClock(), 0
        return False

    def _watch_for_reboot(self, boot_ns: int, now_ns: int) -> None:
        if boot_ns < self._newest_boot_ns - STEP_NS:
            self.clock, self._gate = RemoteClock(), Gate(self.counts)
            # Nobody may integrate across a reboot, however short it was.
            self._held_until_ns = self._newest_live_ns + REBOOT_GAP_NS
            self._newest_boot_ns = boot_ns
            self._listener.on_reboot(now_ns)
        self._newest_boot_ns = max(self._newest_boot_ns, boot_ns)

    def _keep(self, stamp_ns: int, value: Any, now_ns: int) -> None:
        if stamp_ns < self._held_until_ns:
            self.counts["records just after a reboot"] += 1
            return
        self._newest_live_ns = max(self._newest_live_ns, stamp_ns)
        for sample in newly_kept(self._gate, stamp_ns, value):
            self._store.add(sample, now_ns)
            if isinstance(sample, VelocitySample):
                self._left_out = NOTHING
                self._listener.on_velocity(now_ns)


def newly_kept(gate: Gate, stamp_ns: int, value: Any) -> list[Sample | BodyAttitudeSample]:
    """What `gate` keeps of one record; it then remembers only the newest of each kind, all that it needs."""
    kinds: tuple[list[Any], ...] = (gate.velocities, gate.bodies, gate.cameras)
    before = [len(kind) for kind in kinds]
    gate.take(stamp_ns, value)
    found = [sample for kind, n in zip(kinds, before, strict=True) for sample in kind[n:]]
    for kind in kinds:
        del kind[:-1]
    return found
