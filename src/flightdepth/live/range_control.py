"""How many ranges the machine can afford: fewer when a frame takes longer than the stream gives it, and back.

The cost of one more range is not known before it is tried (another batch size, another load), so the way up is
a trial, and a trial that fails doubles the wait before the next one.
"""

from __future__ import annotations

from flightdepth.flight.records import NS_PER_S

# Shares of the time between two pictures that a frame's work may take. Up to the whole of it no picture waits for
# long; beyond, each waits for up to one more picture's time, and its age is twice that.
TOO_BUSY, ROOM = 0.97, 0.82
SMOOTH_MS = 333.0  # the share is averaged over about this long
SETTLE_NS = NS_PER_S // 2  # after a change, before the next one down
FAILED_NS = 5 * NS_PER_S  # a trial that ends sooner has failed
FIRST_WAIT_NS, LONGEST_WAIT_NS = 2 * NS_PER_S, 64 * NS_PER_S


class RangeControl:
    """Chooses n in 1..`most`; feed it each frame's work and the time that the stream gives for it."""

    def __init__(self, most: int) -> None:
        self.ranges = most
        self._most = most
        self._share: float | None = None
        self._changed_ns = 0
        self._roomy_since_ns: int | None = None
        self._rose_ns: int | None = None
        self._wait_ns = FIRST_WAIT_NS

    def add(self, now_ns: int, busy_ms: float, period_ms: float) -> int:
        """One frame took `busy_ms`, pictures come every `period_ms`; the n for the next frame."""
        self._average(busy_ms / max(period_ms, 1e-3), period_ms)
        assert self._share is not None
        if self._share > TOO_BUSY:
            self._roomy_since_ns = None
            if self.ranges > 1 and now_ns - self._changed_ns >= SETTLE_NS:
                self._fall(now_ns)
        elif self._share > ROOM or self.ranges == self._most:
            self._roomy_since_ns = None
        elif self._roomy_since_ns is None:
            self._roomy_since_ns = now_ns
        elif now_ns - self._roomy_since_ns >= self._wait_ns:
            self._rise(now_ns)
        if self._rose_ns is not None and now_ns - self._rose_ns > FAILED_NS:
            self._rose_ns, self._wait_ns = None, FIRST_WAIT_NS
        return self.ranges

    def _average(self, share: float, period_ms: float) -> None:
        """Exponential mean over SMOOTH_MS of pictures; one slow frame among many is no load."""
        weight = min(period_ms / SMOOTH_MS, 1.0)
        self._share = share if self._share is None else self._share + weight * (share - self._share)

    def _fall(self, now_ns: int) -> None:
        if self._rose_ns is not None:
            self._wait_ns = min(2 * self._wait_ns, LONGEST_WAIT_NS)
        self._change(now_ns, -1)
        self._rose_ns = None

    def _rise(self, now_ns: int) -> None:
        self._change(now_ns, +1)
        self._rose_ns = now_ns

    def _change(self, now_ns: int, step: int) -> None:
        self.ranges += step
        self._changed_ns, self._roomy_since_ns = now_ns, None
        self._share = None  # the old n's cost says nothing about the new one
