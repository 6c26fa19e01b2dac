"""The engine's state as Prometheus reads it: text format 0.0.4, units seconds and metres."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from flightdepth.live.obstacles import Sectors
from flightdepth.live.status import LiveStatus, State

CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"
PREFIX = "flightdepth_"

Labels = Mapping[str, str]


@dataclass(frozen=True)
class Metric:
    """One family: its samples, each labels and a value."""

    name: str
    kind: Literal["gauge", "counter"]
    help: str
    samples: Iterable[tuple[Labels, float]]

    def lines(self) -> Iterator[str]:
        """HELP, TYPE and the samples; nothing for a family without any."""
        samples = list(self.samples)
        if not samples:
            return
        yield f"# HELP {PREFIX}{self.name} {self.help}"
        yield f"# TYPE {PREFIX}{self.name} {self.kind}"
        for labels, value in samples:
            told = ",".join(f'{key}="{escaped(text)}"' for key, text in labels.items())
            number = str(int(value)) if float(value).is_integer() else repr(float(value))
            yield f"{PREFIX}{self.name}{{{told}}} {number}" if told else f"{PREFIX}{self.name} {number}"


def prometheus(status: LiveStatus, sectors: Sectors | None = None) -> str:
    """The whole page at /metrics."""
    families = [*engine(status), *frames(status), *telemetry(status), *sinks(status), *obstacles(sectors)]
    return "".join(f"{line}\n" for family in families for line in family.lines())


def engine(status: LiveStatus) -> Iterator[Metric]:
    """Health, age and ranges."""
    states = [({"state": state.value}, float(state is status.health.state)) for state in State]
    yield Metric("health", "gauge", "1 for the state the engine is in", states)
    yield Metric("uptime_seconds", "counter", "Since the engine began", only(status.uptime_s))
    yield Metric("age_seconds", "gauge", "Age of the last result", seconds(status.age_ms))
    yield Metric(
        "age_p95_seconds", "gauge", "95 % of the last minute were younger", seconds(status.age_p95_ms)
    )
    from_sender = None if status.age_ms is None else float(status.age_from == "sender")
    yield Metric(
        "age_from_sender", "gauge", "1: since the sender's time, 0: since reception", only(from_sender)
    )
    denied = None if status.lens is None or not status.lens.decided else status.lens.doubt is not None
    yield Metric("lens_denied", "gauge", "1: the camera's turns deny its focal length", only(denied))
    yield Metric("ranges", "gauge", "Frame pairs a frame", only(status.ranges))
    lengths = enumerate(status.displacements_m, 1)
    yield Metric(
        "displacement_metres", "gauge", "Flown between a pair", [({"range": str(i)}, m) for i, m in lengths]
    )
    shifts = enumerate(status.shifts, 1)
    yield Metric(
        "shift_frames", "gauge", "Frames between a pair", [({"range": str(i)}, n) for i, n in shifts]
    )


def frames(status: LiveStatus) -> Iterator[Metric]:
    """Pictures received, used and dropped."""
    counts = status.frames
    dropped = [({"reason": reason}, float(count)) for reason, count in counts.dropped.items()]
    yield Metric("frames_received_total", "counter", "Pictures from the stream", only(counts.received))
    yield Metric("frames_used_total", "counter", "Pictures given to the estimator", only(counts.used))
    yield Metric("frames_dropped_total", "counter", "Pictures left out", dropped)
    yield Metric("frames_in_per_second", "gauge", "Pictures received", only(status.fps_in))
    yield Metric("results_per_second", "gauge", "Depth maps", only(status.fps))
    yield Metric("reconnects_total", "counter", "The stream was opened again", only(status.reconnects))


def telemetry(status: LiveStatus) -> Iterator[Metric]:
    """What comes from the autopilot."""
    dropped = [({"reason": reason}, float(n)) for reason, n in status.telemetry_dropped.items()]
    yield Metric("velocities_per_second", "gauge", "Velocities received", only(status.telemetry_hz))
    yield Metric(
        "telemetry_age_seconds", "gauge", "Since the newest velocity", seconds(status.telemetry_age_ms)
    )
    yield Metric(
        "telemetry_dropped_total",
        "counter",
        "MAVLink messages left out or not sent, jumps of its clock",
        dropped,
    )


def sinks(status: LiveStatus) -> Iterator[Metric]:
    """What became of the results."""
    samples = [
        ({"sink": name, "outcome": outcome}, float(count))
        for name, counts in status.sinks.items()
        for outcome, count in (("taken", counts.taken), ("missed", counts.missed), ("failed", counts.failed))
    ]
    yield Metric("sink_results_total", "counter", "Results by receiver", samples)


def obstacles(sectors: Sectors | None) -> Iterator[Metric]:
    """The nearest obstacle, and how many sectors know one."""
    if sectors is None:
        return
    seen = np.isfinite(sectors.obstacle_m)
    nearest = float(np.nanmin(sectors.obstacle_m)) if seen.any() else None
    yield Metric("obstacle_nearest_metres", "gauge", "Horizontal distance", only(nearest))
    yield Metric("obstacle_sectors", "gauge", "Sectors of 72 with an obstacle", only(float(seen.sum())))
    known = float((seen | (sectors.clear_m > 0)).sum())
    yield Metric("known_sectors", "gauge", "Sectors of 72 of which anything is known", only(known))


def only(value: float | None) -> tuple[tuple[Labels, float], ...]:
    """One sample without labels, none where there is no value."""
    return () if value is None else (({}, float(value)),)


def seconds(milliseconds: float | None) -> tuple[tuple[Labels, float], ...]:
    """One sample in seconds."""
    return only(None if milliseconds is None else milliseconds / 1000)


def escaped(text: str) -> str:
    """A label's value in quotes."""
    return text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
