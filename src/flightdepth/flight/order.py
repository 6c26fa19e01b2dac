"""Stamps as logs give them: mostly rising, sometimes doubled, sometimes one that jumps."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import pairwise
from typing import TypeVar

from flightdepth.flight.records import NS_PER_S, AttitudeSample, BodyAttitudeSample, VelocitySample

Stamped = TypeVar("Stamped", VelocitySample, AttitudeSample, BodyAttitudeSample)
Item = TypeVar("Item")
Doubt = Callable[[int, int, int], bool]  # of a stamp, the one before it, the step to that; ns


AHEAD = 7  # stamps that are looked at before one is believed: up to three damaged ones in a row are found out
# What comes so long after the stamp before is doubted; a shorter jump costs no more than what it leaps over.
LONG_NS = NS_PER_S // 10


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
        if not _jumps(last_ns, stamp_ns, stamps_ns[index + 1 : index + 1 + AHEAD]):
            kept.append(index)
    return kept


def is_long_after(stamp_ns: int, last_ns: int, step_ns: int) -> bool:
    """Whether a stamp is so long after the one before that it may be wrong."""
    return stamp_ns > last_ns + LONG_NS + 2 * step_ns


def with_jumps(
    stamped: Iterable[tuple[int, Item]], is_doubted: Doubt = is_long_after
) -> Iterator[tuple[int, Item, bool]]:
    """Stamps, from about 0 on, and what they are of, as they come, each with whether it goes by the rule of `rising`.

    Only where a stamp is doubted is anything held back, to look ahead: pictures take memory and time.
    """
    held: deque[tuple[int, Item]] = deque()
    last_ns = step_ns = 0

    def first() -> tuple[int, Item, bool]:
        nonlocal last_ns, step_ns
        stamp_ns, item = held.popleft()
        jumps = _jumps(last_ns, stamp_ns, [other for other, _ in held])
        if stamp_ns > last_ns and not jumps:
            last_ns, step_ns = stamp_ns, stamp_ns - last_ns
        return stamp_ns, item, jumps

    for each in stamped:
        held.append(each)
        while held and (len(held) > AHEAD or not is_doubted(held[0][0], last_ns, step_ns)):
            yield first()
    while held:
        yield first()


def _jumps(last_ns: int | None, stamp_ns: int, ahead: Sequence[int]) -> bool:
    """Whether more of the stamps ahead lie between the last one kept and this one than beyond it."""
    if not ahead or min(ahead) >= stamp_ns:
        return False
    follow = [other for other in ahead if last_ns is None or other > last_ns]
    return sum(other < stamp_ns for other in follow) > sum(other > stamp_ns for other in follow)


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
