"""Which records of a log are of the same power-up of the autopilot: its clock starts anew with each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flightdepth.flight.autopilot import Record
from flightdepth.flight.records import NS_PER_S
from flightdepth.motion import Stamps

Indices = NDArray[np.intp]

# A log's time that steps back, or ahead, by more starts a new run; less is a packet that overtook another.
STEP_NS = 2 * NS_PER_S
# Packets that overtake one another, and messages of other kinds, are not so far apart.
BACK_NS = NS_PER_S // 5
# A run of fewer records beside longer ones is a damaged stamp.
SHORTEST_RUN = 3
# Left free after a reboot, so that nobody integrates across it: more than any gap that is bridged (1.5 s).
REBOOT_GAP_NS = 2 * NS_PER_S
# A second link to the same autopilot may bring everything again, slower by seconds.
REPEATED_NS = 10 * NS_PER_S
REPEATED = "records that came twice"
OTHER_POWER_UPS = "records of other power-ups of the autopilot"
DAMAGED_TIMES = "records with a damaged time"


def boots(stamps_ns: Stamps, counts: Counter[str], received_ns: Stamps | None = None) -> list[Indices]:
    """Indices of the records [n] of each power-up, in the order of the log; lone damaged stamps are left out.

    A log whose time starts again holds another power-up. Within one, times never go back by STEP_NS. Where another
    clock tells when records were received [n], it also finds a power-up whose times begin near the end of the one
    before, or beyond: more time passed than the autopilot's clock tells.
    """
    steps_ns = np.diff(stamps_ns)
    lost_ns = np.zeros_like(steps_ns) if received_ns is None else np.diff(received_ns) - steps_ns
    breaks = np.flatnonzero((np.abs(steps_ns) > STEP_NS) | ((steps_ns < -BACK_NS) & (lost_ns > STEP_NS))) + 1
    runs = np.split(np.arange(len(stamps_ns)), breaks) if len(stamps_ns) else []
    long_runs = [run for run in runs if len(run) >= SHORTEST_RUN] or runs
    if lost := len(stamps_ns) - sum(map(len, long_runs)):
        counts[DAMAGED_TIMES] += lost
    found: list[Indices] = []
    for run in long_runs:
        if found and _goes_on(stamps_ns, received_ns, found[-1][-1], run[0]):
            found[-1] = np.concatenate([found[-1], run])
        else:
            found.append(run)
    return found


def _goes_on(stamps_ns: Stamps, received_ns: Stamps | None, last: np.intp, first: np.intp) -> bool:
    """Whether the record `first` is of the power-up of the record `last` before it."""
    step_ns = stamps_ns[first] - stamps_ns[last]
    if received_ns is None or step_ns <= STEP_NS:
        return bool(step_ns > 0)  # in step: if another clock goes elsewhere meanwhile, that was set
    return bool(received_ns[first] - received_ns[last] - step_ns <= STEP_NS)


def longest_boot(records: Sequence[Record], counts: Counter[str]) -> list[Record]:
    """The records of the longest power-up; without another clock nobody knows where the others belong."""
    found = boots(np.array([record.stamp_ns for record in records], dtype=np.int64), counts)
    longest = max(found, key=len, default=np.arange(0))
    if left := sum(map(len, found)) - len(longest):
        counts[OTHER_POWER_UPS] += left
    return [records[index] for index in longest.tolist()]


def once(records: Sequence[Record], counts: Counter[str]) -> list[Record]:
    """Without those that are equal, and of the same time since power-up, to one received REPEATED_NS before or less."""
    last: dict[tuple[int, type], Record] = {}
    kept: list[Record] = []
    for record in records:
        key = record.stamp_ns, type(record.value)
        if (before := last.get(key)) is not None and _came_again(before, record):
            counts[REPEATED] += 1
            continue
        last[key] = record
        kept.append(record)
    return kept


def _came_again(before: Record, record: Record) -> bool:
    parts: zip[tuple[Any, Any]] = zip(before.value, record.value, strict=True)
    late_ns = record.received_ns - before.received_ns
    return 0 <= late_ns <= REPEATED_NS and all(np.array_equal(part, other) for part, other in parts)


def placed_boots(records: Sequence[Record], counts: Counter[str]) -> list[Record]:
    """All records on the receiver's clock: one offset for each power-up, a gap between two of them.

    The receiver's clock may be set while it runs, so only the first records of a power-up tell its offset.
    """
    records = once(records, counts)
    stamps = np.array([record.stamp_ns for record in records], dtype=np.int64)
    received = np.array([record.received_ns for record in records], dtype=np.int64)
    placed: list[Record] = []
    for boot in boots(stamps, counts, received):
        offset = int(np.median(received[boot[:50]] - stamps[boot[:50]]))
        if placed:
            counts["reboots inside the log"] += 1
            earliest = max(record.stamp_ns for record in placed) + REBOOT_GAP_NS
            offset = max(offset, earliest - int(stamps[boot].min()))
        placed += [records[i]._replace(stamp_ns=records[i].stamp_ns + offset) for i in boot.tolist()]
    return placed
