"""Stamps as logs give them: mostly rising, sometimes doubled, sometimes one that jumps."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from typing import TypeVar

from flightdepth.flight.records import AttitudeSample, BodyAttitudeSample, VelocitySample

Stamped = TypeVar("Stamped", VelocitySample, AttitudeSample, BodyAttitudeSample)


AHEAD = 7  # stamps that are looked at before one is believed: up to three damaged ones in a row are found out


def rising(stamps_ns: Sequence[int]) -> list[int]:
    """Indices of the stamps that rise strictly.

    A stamp goes if more of those after it lie between what was kept and it than beyond it: so a few damaged stamps
    far in the future cost themselves, not everything after them.
    """
    if all(stamp_ns < later_ns for stamp_ns, later_ns in pairwise(stamps_ns)):
        return list(range(len(stamps_ns)))
    kept: list[int] = []
    for index, stamp_ns in enumerate(stamps_ns):
        last_ns = stamps_ns[kept[-1]] if kept else None
        if last_ns is not None and stamp_ns <= last_ns:
            continue
        ahead = stamps_ns[index + 1 : index + 1 + AHEAD]
        if ahead and min(ahead) < stamp_ns:
            follow = [other for other in ahead if last_ns is None or other > last_ns]
            if sum(other < stamp_ns for other in follow) > sum(other > stamp_ns for other in follow):
                continue
        kept.append(index)
    return kept


def rising_counted(stamps_ns: Sequence[int], counts: Counter[str], what: str) -> list[int]:
    """`rising`; the others are counted as what is not later than the one before."""
    kept = rising(stamps_ns)
    if len(kept) < len(stamps_ns):
        counts[f"{what} not later than the one before"] += len(stamps_ns) - len(kept)
    return kept


def in_time_order(samples: Sequence[Stamped], counts: Counter[str]) -> list[Stamped]:
    """The samples whose stamps rise; the others are counted by what they are."""
    kind = "velocities" if samples and isinstance(samples[0], VelocitySample) else "attitudes"
    kept = rising_counted([sample.stamp_ns for sample in samples], counts, kind)
    return [samples[index] for index in kept]
