"""The engine's health as a pure state machine: events and times in, OK, DEGRADED or LOST with a reason out."""

from __future__ import annotations

from dataclasses import dataclass, replace

from flightdepth.flight.records import NS_PER_S
from flightdepth.live.status import Health, State

STARTING = "no picture has come yet"
SILENT = "no picture comes"
PREPARING = "the network is prepared for these pictures"
STUCK = "pictures come, but no results"
REBOOTED = "the autopilot rebooted"
NO_TELEMETRY = "no telemetry yet"
LATE = "telemetry is late"
SLOW = "the machine is too slow"
OLD = "results are old"
LENS = "the camera's turns deny its lens"
RECOVERING = "recovering from "
MEASURED = SLOW, OLD  # against a limit, about which a figure may swing


@dataclass(frozen=True)
class Limits:
    """How long each thing may last before it counts, ns; age of a result, ms; results a second."""

    silent_ns: int = 3 * NS_PER_S // 2
    stuck_ns: int = 2 * NS_PER_S
    reboot_ns: int = 5 * NS_PER_S
    late_ns: int = NS_PER_S // 2
    no_depth_ns: int = 3 * NS_PER_S // 10
    recovered_ns: int = NS_PER_S // 2
    old_ms: float = 250.0
    slow_hz: float = 8.0


class HealthMonitor:
    """Hears what happened and when; `judge(now_ns)` says how things stand. Not for several threads at once.

    `faster`: what would take less time than what runs. To be set before it is asked to judge:

    instead                what came since the last picture, and was none
    lens_doubt             what the camera's turns say against its focal length
    untold                 what telemetry tells in place of velocities
    lacking                what somebody who needs the results can't do, and for want of what
    preparing              whether the network is being compiled for pictures of another size
    pictures_hz, taken_hz  how many came, and were looked at, a second
    """

    def __init__(self, start_ns: int, *, faster: str = "") -> None:
        self._limits, self._faster = Limits(), f"; {faster} take less time" if faster else ""
        self.instead: str | None = None
        self.lens_doubt: str | None = None
        self.untold: str | None = None
        self.lacking: str | None = None
        self.preparing = False
        self.pictures_hz = self.taken_hz = 0.0
        self._health = Health(State.LOST, STARTING, start_ns)
        self._trouble_ns = start_ns
        self._picture_ns: int | None = None
        self._stream_error: str | None = None
        self._refused: str | None = None
        self._resumed_ns = start_ns
        self._velocity_ns: int | None = None
        self._link_error: str | None = None
        self._reboot_ns: int | None = None
        self._result_ns: int | None = None
        self._depth_ns = start_ns
        self._no_depth: str | None = None
        self._doubt: str | None = None
        self._age_ms = 0.0

    def picture(self, now_ns: int) -> None:
        """A picture came."""
        if self._picture_ns is None or now_ns - self._picture_ns > self._limits.silent_ns:
            self._resumed_ns = now_ns
        self._picture_ns, self._stream_error = now_ns, None

    def stream_failed(self, why: str) -> bool:
        """The stream could not be opened, or broke; whether that is news since the last picture."""
        known, self._stream_error = self._stream_error, why
        return why != known

    def refused(self, why: str) -> None:
        """A picture could not be used at all."""
        self._refused = why

    def velocity(self, now_ns: int) -> None:
        """A velocity came."""
        self._velocity_ns, self._link_error = now_ns, None

    def link_failed(self, why: str) -> bool:
        """The telemetry's connection could not be opened, or broke; whether that is news since the last velocity."""
        known, self._link_error = self._link_error, why
        return why != known

    def rebooted(self, now_ns: int) -> None:
        """The autopilot's clock began again."""
        self._reboot_ns = now_ns

    def result(self, now_ns: int, *, no_depth: str | None, age_ms: float, doubt: str | None = None) -> None:
        """A result stood; `no_depth` says why it holds none, `doubt` what speaks against the telemetry."""
        self._result_ns, self._no_depth, self._age_ms, self._refused = now_ns, no_depth, age_ms, None
        self._doubt = doubt
        if no_depth is None:
            self._depth_ns = now_ns

    def judge(self, now_ns: int) -> Health:
        """The state now. Trouble counts at once; it must be over for `recovered_ns` before all is well.

        What is MEASURED is told until then, the others as what it recovers from.
        """
        state, reason = self._worst(now_ns)
        before = self._health
        if state is not State.OK:
            self._trouble_ns = now_ns
        elif before.reason is not None and now_ns - self._trouble_ns < self._limits.recovered_ns:
            past = before.kind[1].removeprefix(RECOVERING)
            state, reason = State.DEGRADED, before.reason if past in MEASURED else RECOVERING + past
        health = Health(state, reason, now_ns)
        self._health = replace(health, since_ns=before.since_ns) if health.kind == before.kind else health
        return self._health

    def _worst(self, now_ns: int) -> tuple[State, str | None]:
        lost = self._lost(now_ns)
        if lost is not None:
            return State.LOST, lost
        degraded = self._degraded(now_ns)
        return (State.OK if degraded is None else State.DEGRADED), degraded

    def _lost(self, now_ns: int) -> str | None:
        why = f"{self.instead} came" if self.instead else self._stream_error
        because = f": {why}" if why else ""
        if self._picture_ns is None:
            return STARTING + because
        if now_ns - self._picture_ns > self._limits.silent_ns:
            return SILENT + because
        refused = f": {self._refused}" if self._refused else ""
        if self._result_ns is None:
            return STUCK + refused if refused else PREPARING
        if now_ns - max(self._result_ns, self._resumed_ns) > self._limits.stuck_ns:
            return PREPARING if self.preparing else STUCK + refused
        return None

    def _degraded(self, now_ns: int) -> str | None:
        """The first trouble that counts, the worst first."""
        limits, velocity_ns, reboot_ns = self._limits, self._velocity_ns, self._reboot_ns
        late_ns = 0 if velocity_ns is None else now_ns - velocity_ns
        why = self.untold or self._link_error
        silent = NO_TELEMETRY + (f": {why}" if why else "")
        late = f"{LATE}: no velocity for {late_ns / NS_PER_S:.1f} s" + (f"; {why}" if why else "")
        taken_hz, pictures_hz = self.taken_hz, self.pictures_hz
        troubles = (
            (reboot_ns is not None and now_ns - reboot_ns < limits.reboot_ns, REBOOTED),
            (velocity_ns is None, silent),
            (late_ns > limits.late_ns, late),
            (now_ns - self._depth_ns > limits.no_depth_ns, self._no_depth),
            (True, self._doubt),
            (
                0 < taken_hz < min(limits.slow_hz, pictures_hz / 2),
                f"{SLOW}: {taken_hz:.1f} results a second of {pictures_hz:.0f} pictures{self._faster}",
            ),
            (self._age_ms > limits.old_ms, f"{OLD}: {self._age_ms:.0f} ms"),
            # Once told it lasts, so what may pass comes before it.
            (self.lens_doubt is not None, f"{LENS}: {self.lens_doubt}"),
            (True, self.lacking),
        )
        return next((reason for counts, reason in troubles if counts and reason is not None), None)
