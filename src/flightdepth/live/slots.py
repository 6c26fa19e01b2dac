"""Where the newest counts: a slot that keeps one item, and sinks that never hold up whoever feeds them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Generic, TypeVar

from flightdepth.live.status import LiveResult, Sink, SinkCounts

WAIT_S = 0.2  # between two looks at whether the owner still lives
LEAVE_S = 2.0  # a sink that is still busy after this long is left behind; its thread dies with the process
T = TypeVar("T")


class Newest(Generic[T]):
    """Holds one item for one taker; a newer one takes its place, and `replaced` counts those never taken."""

    def __init__(self) -> None:
        self._filled = threading.Condition()
        self._item: tuple[T] | None = None
        self.replaced = 0

    def put(self, item: T) -> None:
        """Never waits; pushes out an older item."""
        with self._filled:
            self.replaced += self._item is not None
            self._item = (item,)
            self._filled.notify()

    def take(self, timeout_s: float) -> T | None:
        """The item, or None when there is none for `timeout_s`."""
        with self._filled:
            self._filled.wait_for(lambda: self._item is not None, timeout_s)
            held, self._item = self._item, None
            return None if held is None else held[0]


class SinkThread:
    """Runs one sink on a thread of its own, with the newest result only; what it raises is counted.

    `on_failure` hears the first error, so that it is told once and not thirty times a second.
    """

    def __init__(self, name: str, sink: Sink, on_failure: Callable[[str, Exception], None]) -> None:
        self.name = name
        self._sink, self._on_failure = sink, on_failure
        self._slot: Newest[LiveResult] = Newest()
        self._stop = threading.Event()
        self._counts = SinkCounts()
        self._thread = threading.Thread(target=self._work, name=f"sink {name}", daemon=True)
        self._thread.start()

    @property
    def counts(self) -> SinkCounts:
        """What it took, missed and failed on, so far."""
        return replace(self._counts, missed=self._slot.replaced)

    def put(self, result: LiveResult) -> None:
        """Hand over one result; never waits."""
        self._slot.put(result)

    def close(self) -> None:
        """Let it finish the result in hand and the one that waits, but not wait for them longer than LEAVE_S."""
        self._stop.set()
        self._thread.join(LEAVE_S)

    def _work(self) -> None:
        while True:
            last = self._stop.is_set()
            result = self._slot.take(0 if last else WAIT_S)
            if result is None:
                if last:
                    return
                continue
            try:
                self._sink(result)
            except Exception as error:
                self._fail(error)
            else:
                self._counts = replace(self._counts, taken=self._counts.taken + 1)

    def _fail(self, error: Exception) -> None:
        first = self._counts.failed == 0
        self._counts = replace(self._counts, failed=self._counts.failed + 1)
        if first:
            self._on_failure(self.name, error)
