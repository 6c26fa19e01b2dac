"""Times of samples that come in payloads: each payload spans an interval of the video."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flightdepth.flight.records import NS_PER_S
from flightdepth.motion import Stamps


@dataclass(frozen=True)
class Interval:
    """Time of the video that a payload belongs to, ns, `end_ns` left out."""

    start_ns: int
    end_ns: int


def spread(count: int, interval: Interval) -> Stamps:
    """Times of `count` samples without a clock: evenly over their payload, the first at its start."""
    steps = np.arange(count) * (interval.end_ns - interval.start_ns) / max(count, 1)
    return interval.start_ns + steps.astype(np.int64)


def on_video_clock(clocks_s: list[NDArray[np.float64]], intervals: list[Interval]) -> Stamps:
    """Times of samples that carry their own clock (seconds from any zero), one array for each payload.

    Samples keep the spacing of their own clock; one offset for the whole recording moves them to the video.
    Only the arrival is known: each sample arrived within its payload, so offset plus delay lies between the
    largest (own time - payload end) and the smallest (own time - payload start); many payloads make that
    narrow. A sample travels after it was taken, and the file does not say how long: one sampling period is
    assumed, because a sender passes a sample on before it takes the next one.
    """
    arrays = [np.round(clock * NS_PER_S).astype(np.int64) for clock in clocks_s]
    pairs = [(own, interval) for own, interval in zip(arrays, intervals, strict=True) if len(own)]
    stamps: Stamps = np.concatenate([own for own, _ in pairs])
    lowest = max(int(own.max()) - interval.end_ns for own, interval in pairs)
    highest = min(int(own.min()) - interval.start_ns for own, interval in pairs)
    # After a hold-up, old samples arrive late and the bounds cross: those that came fastest decide.
    arrival_ns = (lowest + max(highest, lowest)) // 2
    return stamps - (arrival_ns + sampling_period_ns(stamps))


def sampling_period_ns(stamps: Stamps) -> int:
    """Median time between samples, 0 for a single one."""
    return int(np.median(np.diff(stamps))) if len(stamps) > 1 else 0
