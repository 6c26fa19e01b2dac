"""Whether packets pile up before the reader, because it decodes more slowly than they come."""

from __future__ import annotations

from collections import deque

from flightdepth.flight.records import NS_PER_S

SPAN_NS = NS_PER_S
# A reader that keeps up waits for packets for more than this share of its time.
LEAST_WAIT = 0.1
# Else packets that are so late lie in a queue, and are thrown away; up to one so late, or so long waited for.
LATE_NS, IN_TIME_NS, WAITED_NS = NS_PER_S // 4, NS_PER_S // 16, NS_PER_S // 100


class Backlog:
    """Hears how long the reader waited for each packet, and how late that is.

    `hurried`: it hardly waited for those of the last second, so they may have been lying in a queue.
    """

    def __init__(self) -> None:
        self.hurried = False
        self._waits: deque[tuple[int, int]] = deque()  # (when it came, how long it was waited for)
        self._since_ns: int | None = None
        self._skipping = False
        # With what came while the stream was opened: until then nobody knows what is late.
        self._caught_up = False

    def read(self, now_ns: int, waited_ns: int) -> None:
        """A packet was read at `now_ns`, after a wait."""
        self._since_ns = now_ns if self._since_ns is None else self._since_ns
        self._waits.append((now_ns, waited_ns))
        while now_ns - self._waits[0][0] > SPAN_NS:
            self._waits.popleft()
        waited = sum(each_ns for _, each_ns in self._waits)
        if now_ns - self._since_ns >= SPAN_NS:
            self.hurried = waited < LEAST_WAIT * SPAN_NS
            self._caught_up |= not self.hurried

    def skips(self, late_ns: int) -> bool:
        """Whether the packet just read, `late_ns` later than the fastest ones, is to be thrown away."""
        now_ns, waited_ns = self._waits[-1]
        if not self._skipping:
            self._skipping = self.hurried and (late_ns > LATE_NS or not self._caught_up)
        elif waited_ns >= WAITED_NS or (self._caught_up and late_ns <= IN_TIME_NS):
            self.hurried = self._skipping = False
            self._caught_up, self._since_ns = True, now_ns
        return self._skipping
