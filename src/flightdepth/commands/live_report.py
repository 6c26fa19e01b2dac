"""What `flightdepth live` says while it runs, and at its end."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from flightdepth.commands.terminal import mention
from flightdepth.live.engine import LiveEngine
from flightdepth.live.status import LiveStatus, SinkCounts

LINE_EVERY_S = 5.0
LOOK_S = 0.2


@contextmanager
def told(engine: LiveEngine) -> Iterator[None]:
    """A line when the health changes, and one each LINE_EVERY_S, from a thread of its own."""
    over = threading.Event()

    def watch() -> None:
        said, line_at = None, 0.0
        while not over.wait(LOOK_S):
            status = engine.status()
            if status.health.kind != said or time.monotonic() >= line_at:
                said, line_at = status.health.kind, time.monotonic() + LINE_EVERY_S
                mention(line(status))

    thread = threading.Thread(target=watch, name="status", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def missing(status: LiveStatus) -> dict[str, int]:
    """Pictures that are not in the recording, by reason."""
    missed = status.sinks.get("recorder", SinkCounts()).missed
    return dict(status.frames.dropped) | ({"the disk was busy": missed} if missed else {})


def line(status: LiveStatus) -> str:
    """The engine in one line."""
    health = status.health.state.upper() + (f" ({status.health.reason})" if status.health.reason else "")
    age = "-" if status.age_p95_ms is None else f"{status.age_ms:.0f} ms (p95 {status.age_p95_ms:.0f})"
    return (
        f"{status.uptime_s:7.1f} s  {health}; {status.fps:.1f} of {status.fps_in:.1f} frames/s, n = {status.ranges},"
        f" age {age} since {status.age_from}, telemetry {status.telemetry_hz:.0f} Hz"
    )


def summary(status: LiveStatus) -> str:
    """What came of it, a line for each thing."""
    lines = [f"{status.frames.used} of {status.frames.received} pictures used in {status.uptime_s:.1f} s"]
    lines += [f"  {count} dropped: {reason}" for reason, count in status.frames.dropped.items()]
    lines += [f"  telemetry: {why} ({count})" for why, count in status.telemetry_dropped.items()]
    lines += [f"  lens: {status.lens}"] if status.lens is not None and status.lens.decided else []
    for name, counts in status.sinks.items():
        lines.append(f"  {name}: {counts.taken} results, {counts.missed} missed, {counts.failed} failed")
    return "\n".join(lines)
