"""A recorded log in place of a MAVLink link, played in real time beside a recorded video."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import replace

from flightdepth.flight.records import NS_PER_S, Telemetry, VelocitySample
from flightdepth.live.motion_store import MotionStore


class LogPlayer:
    """Gives each sample of `telemetry` to `store` when it is due: its time 0 is `epoch_ns`, live clock."""

    def __init__(
        self,
        telemetry: Telemetry,
        store: MotionStore,
        *,
        epoch_ns: int,
        on_velocity: Callable[[int], None],
    ) -> None:
        self._samples = sorted(
            [*telemetry.samples, *telemetry.body_attitudes], key=lambda sample: sample.stamp_ns
        )
        self._store, self._epoch_ns, self._on_velocity = store, epoch_ns, on_velocity
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._work, name="log", daemon=True)

    def start(self) -> None:
        """Begin to play."""
        self._thread.start()

    def close(self) -> None:
        """Stop."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()

    def _work(self) -> None:
        for sample in self._samples:
            due_ns = self._epoch_ns + sample.stamp_ns
            if self._stop.wait(max(0, due_ns - time.monotonic_ns()) / NS_PER_S):
                return
            now_ns = time.monotonic_ns()
            self._store.add(replace(sample, stamp_ns=due_ns), now_ns)
            if isinstance(sample, VelocitySample):
                self._on_velocity(now_ns)
