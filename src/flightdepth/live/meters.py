"""Figures over the last seconds: rates and ages, with the time passed in and memory that does not grow."""

from __future__ import annotations

from collections import deque

import numpy as np

from flightdepth.flight.records import NS_PER_S

RATE_NS, AGES_NS = 3 * NS_PER_S, 60 * NS_PER_S  # so long events and ages count
LEAST_NS = NS_PER_S // 10  # pictures that lay in a queue come in one burst, which is no rate
REFRESH_NS = NS_PER_S // 4  # sorting a minute's ages for each result would cost a millisecond


class Rate:
    """Events a second over the last RATE_NS, and since a pause of half of that."""

    def __init__(self) -> None:
        self._stamps: deque[int] = deque(maxlen=4096)

    def add(self, now_ns: int) -> None:
        """One event."""
        if self._stamps and now_ns - self._stamps[-1] > RATE_NS // 2:
            self._stamps.clear()
        self._stamps.append(now_ns)

    def hz(self, now_ns: int) -> float:
        """Intervals over their time; 0 where the recent ones take less than LEAST_NS."""
        while self._stamps and now_ns - self._stamps[0] > RATE_NS:
            self._stamps.popleft()
        if not self._stamps or (taken_ns := self._stamps[-1] - self._stamps[0]) < LEAST_NS:
            return 0.0
        return (len(self._stamps) - 1) * NS_PER_S / taken_ns


class Ages:
    """Milliseconds of the last AGES_NS, and the value that 95 % of them do not exceed, at most REFRESH_NS old."""

    def __init__(self) -> None:
        self._entries: deque[tuple[int, float]] = deque(maxlen=8192)
        self._p95: tuple[int, float] | None = None

    def add(self, now_ns: int, age_ms: float) -> None:
        """One age."""
        self._entries.append((now_ns, age_ms))
        self.forget(now_ns)

    def forget(self, now_ns: int) -> None:
        """Leave out what is older than AGES_NS."""
        while self._entries and now_ns - self._entries[0][0] > AGES_NS:
            self._entries.popleft()

    @property
    def last_ms(self) -> float | None:
        """The newest age, None where there is none."""
        return self._entries[-1][1] if self._entries else None

    @property
    def p95_ms(self) -> float | None:
        """The 95th percentile, None where there is no age."""
        if not self._entries:
            return None
        newest_ns = self._entries[-1][0]
        if self._p95 is None or newest_ns - self._p95[0] >= REFRESH_NS:
            self._p95 = newest_ns, float(np.percentile([age for _, age in self._entries], 95))
        return self._p95[1]
