"""Which records of a log are of the same power-up of the autopilot: its clock starts anew with each."""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from collections.abc import Sequence

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
# Meanwhile the other one brings something newer, or this one what is known, at least so often.
SOON_NS = NS_PER_S
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


def of_one_link(records: Sequence[Record], counts: Counter[str]) -> list[Record]:
    """As if one link had brought them all: each once, and what only a slower one brought among those of its time."""
    last: dict[tuple[int, type], Record] = {}
    kept: list[Record] = []
    newest_ns, start = 0, 0  # of this power-up
    repeated_ns = -REPEATED_NS
    for index, record in enumerate(records):
        key = record.stamp_ns, type(record.value)
        if (before := last.get(key)) is not None and _came_again(before, record):
            counts[REPEATED] += 1
            repeated_ns = record.received_ns
            continue
        last[key] = record
        behind_ns = newest_ns - record.stamp_ns
        repeating = behind_ns > BACK_NS and record.received_ns - repeated_ns <= SOON_NS
        late = repeating or (behind_ns > STEP_NS and _goes_on_from(newest_ns, records, index))
        if late and behind_ns <= REPEATED_NS:
            kept.insert(bisect_right(kept, record.stamp_ns, start, key=lambda each: each.stamp_ns), record)
            continue
        if behind_ns > STEP_NS:
            newest_ns, start = 0, len(kept)
        newest_ns = max(newest_ns, record.stamp_ns)
        kept.append(record)
    return kept


def _came_again(before: Record, record: Record) -> bool:
    late_ns = record.received_ns - before.received_ns
    # As text, in which NaN is NaN: a gimbal's yaw that is not known, a place beside a velocity.
    return 0 <= late_ns <= REPEATED_NS and repr(before.value) == repr(record.value)


def _goes_on_from(newest_ns: int, records: Sequence[Record], index: int) -> bool:
    """Whether the clock goes on from a time soon after a record that is older; after a restart it does not."""
    for record in map(records.__getitem__, range(index + 1, len(records))):
        if record.received_ns > records[index].received_ns + SOON_NS:
            return False
        if record.stamp_ns >= newest_ns:
            return True
    return False


def placed_boots(records: Sequence[Record], counts: Counter[str]) -> list[Record]:
    """All records on the receiver's clock: one offset for each power-up, a gap between two of them.

    The receiver's clock may be set while it runs, so only the first records of a power-up tell its offset.
    """
    records = of_one_link(records, counts)
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
