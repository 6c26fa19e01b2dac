"""Stamps as logs give them: mostly rising, sometimes doubled, sometimes one that jumps."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TypeVar

from flightdepth.flight.records import AttitudeSample, BodyAttitudeSample, VelocitySample

Stamped = TypeVar("Stamped", VelocitySample, AttitudeSample, BodyAttitudeSample)


def rising(stamps_ns: Sequence[int]) -> list[int]:
    """Indices of the stamps that rise strictly.

    Of two neighbours in the wrong order the later one goes if the other still follows what was kept: so one
    damaged stamp far in the future costs itself, not everything after it.
    """
    kept: list[int] = []
    for index, stamp_ns in enumerate(stamps_ns):
        last_ns = stamps_ns[kept[-1]] if kept else None
        if last_ns is not None and stamp_ns <= last_ns:
            continue
        next_ns = stamps_ns[index + 1] if index + 1 < len(stamps_ns) else stamp_ns
        if next_ns < stamp_ns and (last_ns is None or next_ns > last_ns):
            continue
        kept.append(index)
    return kept


def in_time_order(samples: Sequence[Stamped], counts: Counter[str]) -> list[Stamped]:
    """The samples whose stamps rise; the others are counted by what they are."""
    kept = [samples[index] for index in rising([sample.stamp_ns for sample in samples])]
    if len(kept) < len(samples):
        kind = "velocities" if isinstance(samples[0], VelocitySample) else "attitudes"
        counts[f"{kind} not later than the one before"] += len(samples) - len(kept)
    return kept
