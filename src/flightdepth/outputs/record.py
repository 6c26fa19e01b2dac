"""flight.json: which camera, network and settings the depth comes from, and what is missing from it."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from flightdepth.camera import Camera
from flightdepth.flight.offset import ClockOffset
from flightdepth.outputs.encoding import FARTHEST, UNIT_M, UNKNOWN
from flightdepth.outputs.frame_table import FrameRow
from flightdepth.weights.card import NetworkCard

DepthFormat = Literal["png", "npz"]
NUMBER = re.compile(r"\d+(?:\.\d+)?")


class Source(BaseModel):
    """What was run: the flight, and with what."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    flight: str = Field(description="name of the video")
    video_bytes: int | None = Field(default=None, description="size of the video's file")
    telemetry: str = Field(description="where the velocity comes from")
    telemetry_digest: str | None = Field(default=None, description="of its samples: another log has another")
    camera: Camera
    camera_source: str = Field(default="", description="where the camera comes from, and how sure it is")
    clock: ClockOffset | None = Field(
        default=None, description="offset between video and log, where estimated"
    )
    network: NetworkCard
    settings: dict[str, bool | int | float | str | None] = Field(default_factory=dict)
    warnings: tuple[str, ...] = Field(default=(), description="what the user was warned of")


class DepthScaleNote(BaseModel):
    """How to read depth/*.png; float32 metres with NaN for unknown in depth/*.npz."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: DepthFormat
    unit_m: float = UNIT_M
    unknown: int = UNKNOWN
    this_or_farther: int = FARTHEST


class Counts(BaseModel):
    """How much depth there is, and why not more. Reasons that differ in numbers only count as one."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    frames: int
    frames_with_depth: int
    frames_without_depth: dict[str, int] = Field(description="by reason")
    dropped: dict[str, int] = Field(description="parts of the video and the log that could not be used")
    pixels_at_655_m_or_farther: int

    @classmethod
    def of(cls, rows: Sequence[FrameRow], dropped: dict[str, int], saturated_pixels: int) -> Counts:
        """Counts of a whole flight."""
        missing = grouped(row.reason for row in rows if row.reason)
        return cls(
            frames=len(rows),
            frames_with_depth=len(rows) - missing.total(),
            frames_without_depth=dict(missing.most_common()),
            dropped=dropped,
            pixels_at_655_m_or_farther=saturated_pixels,
        )


def grouped(reasons: Iterable[str]) -> Counter[str]:
    """How often each reason stands; where only its numbers differ, once with their spans: "turns 3 to 5 degrees"."""
    groups: dict[tuple[str, ...], list[list[str]]] = defaultdict(list)
    for reason in reasons:
        groups[tuple(NUMBER.split(reason))].append(NUMBER.findall(reason))
    found: Counter[str] = Counter()
    for words, numbers in groups.items():
        spans = [_span(column) for column in zip(*numbers, strict=True)]
        found["".join(word + span for word, span in zip(words, [*spans, ""], strict=True))] = len(numbers)
    return found


def with_frames(notes: Iterable[str]) -> tuple[str, ...]:
    """Each note once, with its number of frames."""
    return tuple(f"{note} ({frames} frame{'s' * (frames > 1)})" for note, frames in grouped(notes).items())


def _span(numbers: Sequence[str]) -> str:
    least, most = min(numbers, key=float), max(numbers, key=float)
    return least if least == most else f"{least} to {most}"


class FlightRecord(BaseModel):
    """The whole of flight.json."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    flightdepth: str = Field(description="version that wrote this")
    source: Source
    depth: DepthScaleNote
    counts: Counts
    notes: tuple[str, ...] = Field(
        default=(), description="assumptions behind the depth, and of how many frames"
    )


@dataclass(frozen=True)
class Summary:
    """A flight in a few figures, for people; medians are over the frames with depth, NaN without any.

    `warnings` are those that came up in flight.
    """

    counts: Counts
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    valid_fraction_median: float
    latency_median_ms: float
    latency_p95_ms: float

    @classmethod
    def of(
        cls,
        rows: Sequence[FrameRow],
        counts: Counts,
        notes: tuple[str, ...],
        warnings: tuple[str, ...] = (),
    ) -> Summary:
        """Figures of a whole flight."""
        known = [row for row in rows if not row.reason]
        latencies = [row.latency_ms for row in known] or [float("nan")]
        fractions = [row.valid_fraction for row in known] or [float("nan")]
        return cls(
            counts=counts,
            notes=notes,
            warnings=warnings,
            valid_fraction_median=float(np.median(fractions)),
            latency_median_ms=float(np.median(latencies)),
            latency_p95_ms=float(np.percentile(latencies, 95)),
        )
