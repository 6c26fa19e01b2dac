"""flight.json: which camera, network and settings the depth comes from, and what is missing from it."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from flightdepth.camera import Camera
from flightdepth.flight.offset import ClockOffset
from flightdepth.flight.places import AltitudeAbove
from flightdepth.flight.universal_time import UniversalTime
from flightdepth.outputs.encoding import FARTHEST, UNIT_M, UNKNOWN
from flightdepth.outputs.frame_table import FrameRow
from flightdepth.weights.card import NetworkCard

DepthFormat = Literal["png", "npz"]
NUMBER = re.compile(r"\d+(?:\.\d+)?")
Span = tuple[str, str]  # least and most, as they were written


class Source(BaseModel):
    """What was run: the flight, and with what."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    flight: str = Field(description="name of the video")
    video_bytes: int | None = Field(default=None, description="size of the video's file")
    telemetry: str = Field(description="where the velocity comes from")
    telemetry_digest: str | None = Field(
        default=None, description="of what results come from: another log has another"
    )
    altitude_above: AltitudeAbove | None = Field(
        default=None, description="what altitude_m in poses.csv counts from; None where the log tells none"
    )
    true_north: bool = Field(
        default=True, description="false where north_m in poses.csv may point in any direction"
    )
    camera: Camera
    camera_source: str = Field(default="", description="where the camera comes from, and how sure it is")
    mask_digest: str | None = Field(
        default=None, description="of what no depth is told of: another mask has another"
    )
    clock: ClockOffset | None = Field(
        default=None, description="offset between video and log, where estimated"
    )
    utc: UniversalTime | None = Field(
        default=None, description="universal time of stamp_ns 0, and whose clock told it; None where none did"
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
        missing = ReasonTally(row.reason for row in rows if row.reason).counts()
        return cls(
            frames=len(rows),
            frames_with_depth=len(rows) - missing.total(),
            frames_without_depth=dict(missing.most_common()),
            dropped=dropped,
            pixels_at_655_m_or_farther=saturated_pixels,
        )


class ReasonTally:
    """Counts reasons; those that differ in numbers only are one, with their spans: "turns 3 to 5 degrees".

    However many come, it holds no more than their wordings.
    """

    def __init__(self, reasons: Iterable[str] = ()) -> None:
        self._groups: dict[tuple[str, ...], tuple[int, list[Span]]] = {}  # by what stands between the numbers
        for reason in reasons:
            self.add(reason)

    def add(self, reason: str) -> None:
        """Count one."""
        words, numbers = tuple(NUMBER.split(reason)), NUMBER.findall(reason)
        count, spans = self._groups.get(words, (0, [(number, number) for number in numbers]))
        wider = [
            (min(least, number, key=float), max(most, number, key=float))
            for (least, most), number in zip(spans, numbers, strict=True)
        ]
        self._groups[words] = count + 1, wider

    def counts(self) -> Counter[str]:
        """How often each came, in the order of the first."""
        found: Counter[str] = Counter()
        for words, (count, spans) in self._groups.items():
            said = [least if least == most else f"{least} to {most}" for least, most in spans]
            found["".join(word + span for word, span in zip(words, [*said, ""], strict=True))] = count
        return found

    def with_frames(self) -> tuple[str, ...]:
        """Each reason with its number of frames."""
        return tuple(f"{said} ({frames} frame{'s' * (frames > 1)})" for said, frames in self.counts().items())


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
    whole: bool = Field(
        default=True, description="false: interrupted, the frames after those that stand are missing"
    )


@dataclass(frozen=True)
class Summary:
    """A flight in a few figures, for people; medians are over the frames with depth, NaN without any, and
    `sigma_share_median` over those whose network tells an error bar.

    `warnings` are those that came up in flight.
    """

    counts: Counts
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    valid_fraction_median: float
    sigma_share_median: float
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
        shares = [row.sigma_share for row in known if row.sigma_share is not None] or [float("nan")]
        return cls(
            counts=counts,
            notes=notes,
            warnings=warnings,
            valid_fraction_median=float(np.median(fractions)),
            sigma_share_median=float(np.median(shares)),
            latency_median_ms=float(np.median(latencies)),
            latency_p95_ms=float(np.percentile(latencies, 95)),
        )
