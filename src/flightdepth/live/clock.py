"""Times of other clocks on the live clock, `time.monotonic_ns()`: of a stream, an autopilot, a gimbal.

Nobody's wall clock is needed, so stepping one changes nothing. What arrives was sent before; of many arrivals
the fastest says best how two clocks stand to each other (its delay is left in), and a question that comes back
(MAVLink's TIMESYNC) bounds that delay from both sides.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from flightdepth.flight.power_ups import STEP_NS
from flightdepth.flight.records import NS_PER_S

WINDOW_NS = 10 * NS_PER_S  # two crystals 50 ppm apart drift by 0.5 ms meanwhile
# What one clock says of itself differs by less: milliseconds are rounded, filters predict, crystals drift.
AHEAD_NS = NS_PER_S // 20
DRIFT = 5_000  # no two crystals drift apart by more than a part of so many


@dataclass(frozen=True)
class Answer:
    """A question's round trip: the other clock minus ours lies within `trip_ns` / 2 of `offset_ns`."""

    answered_ns: int
    offset_ns: int
    trip_ns: int

    def contradicts(self, other: Answer) -> bool:
        """Whether no one clock can have given both."""
        return abs(self.offset_ns - other.offset_ns) > (self.trip_ns + other.trip_ns) // 2 + AHEAD_NS


class RemoteClock:
    """How one other clock stands to ours; all times in ns, `now_ns` is ours and rises."""

    def __init__(self) -> None:
        # (arrival, arrival - own time), offsets rising: the first is the smallest of the window.
        self._arrivals: deque[tuple[int, int]] = deque()
        self._answers: deque[Answer] = deque(maxlen=32)
        self._least_ns: int | None = None  # the smallest offset that any arrival had

    def arrived(self, own_ns: int, now_ns: int, *, queued: bool = False) -> None:
        """Something stamped `own_ns` by the other clock came at `now_ns`.

        Where that clock stepped back, or something is very late, earlier arrivals are forgotten, and the next
        faster one puts it right.
        Answers stay, since they know better; where the clock did step, the next one is without those before.

        `queued`: it may have lain here before it was read, so it makes no clock later than drift does.
        """
        offset_ns = now_ns - own_ns
        if queued and self._arrivals:
            then_ns, least_ns = self._arrivals[0]
            offset_ns = min(offset_ns, least_ns + (now_ns - then_ns) // DRIFT)
        if self._arrivals and offset_ns - self._arrivals[0][1] > STEP_NS:
            self._arrivals.clear()
        self._least_ns = offset_ns if self._least_ns is None else min(self._least_ns, offset_ns)
        while self._arrivals and self._arrivals[-1][1] >= offset_ns:
            self._arrivals.pop()
        self._arrivals.append((now_ns, offset_ns))
        while now_ns - self._arrivals[0][0] > WINDOW_NS:
            self._arrivals.popleft()

    def answered(self, sent_ns: int, own_ns: int, now_ns: int) -> None:
        """A question sent at `sent_ns` was answered with the other clock's time, at `now_ns`."""
        trip_ns = now_ns - sent_ns
        if 0 <= trip_ns <= NS_PER_S:
            answer = Answer(now_ns, sent_ns + trip_ns // 2 - own_ns, trip_ns)
            if any(answer.contradicts(before) for before in self._answers):
                self._answers.clear()
            self._answers.append(answer)

    def is_ahead(self, own_ns: int, now_ns: int) -> bool:
        """Whether something stamped `own_ns` that came at `now_ns` would be from the future, by what is known.

        Then the other clock jumped ahead, or the stamp is damaged: hear it with `arrived` only if others follow.
        """
        offset_ns = now_ns - own_ns
        if self._least_ns is not None and offset_ns < self._least_ns - STEP_NS:
            return True
        recent = [a for a in self._answers if now_ns - a.answered_ns <= WINDOW_NS]
        return any(offset_ns < a.offset_ns - a.trip_ns // 2 - AHEAD_NS for a in recent)

    @property
    def offset_ns(self) -> int:
        """Ours minus the other clock; something must have been heard."""
        newest_ns = max([a.answered_ns for a in self._answers] + [now_ns for now_ns, _ in self._arrivals])
        recent = [a for a in self._answers if newest_ns - a.answered_ns <= WINDOW_NS]
        if recent:
            return min(recent, key=lambda answer: answer.trip_ns).offset_ns
        return self._arrivals[0][1]

    def live_ns(self, own_ns: int) -> int:
        """The other clock's `own_ns` on ours."""
        return own_ns + self.offset_ns
