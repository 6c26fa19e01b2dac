"""Rows of numbers in time order: velocities, attitudes or poses as they come in."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flightdepth.errors import BadInput
from flightdepth.flight.records import LATEST_NS

Stamps = NDArray[np.int64]
Rows = NDArray[np.float64]

FIRST_CAPACITY = 1024
MOST_ROWS = 65536


def checked_stamp(stamp_ns: int) -> int:
    """A time as Python's own number, since NumPy's overflow; refused where it is no whole nanoseconds of 64 bits.

    Seconds, as ROS users add them up, lie closer than they tell.
    """
    if not isinstance(stamp_ns, int | np.integer):
        got = f"{type(stamp_ns).__name__} {stamp_ns!r}"
        raise BadInput("stamp_ns", expected="whole nanoseconds", got=got)
    if abs(int(stamp_ns)) > LATEST_NS:
        raise BadInput("stamp_ns", expected="146 years of nanoseconds at most", got=str(stamp_ns))
    return int(stamp_ns)


class Timeline:
    """Stamps [m] (ns, strictly rising) with a row of `columns` floats each; never more than `limit` rows.

    Whoever writes ahead of the frames (a log read at once) may do so up to `limit`; then the oldest row goes.
    """

    def __init__(self, columns: int, *, limit: int = MOST_ROWS) -> None:
        self._stamps = np.empty(FIRST_CAPACITY, dtype=np.int64)
        self._rows = np.empty((FIRST_CAPACITY, columns))
        self._start = self._end = 0
        self._limit = limit

    def __len__(self) -> int:
        return self._end - self._start

    @property
    def is_full(self) -> bool:
        """Whether the next row costs the oldest."""
        return len(self) == self._limit

    @property
    def newest_ns(self) -> int | None:
        """Stamp of the last row, None when there is none."""
        return int(self._stamps[self._end - 1]) if len(self) else None

    @property
    def newest(self) -> tuple[int, Rows]:
        """The last stamp and row; there must be one."""
        return int(self._stamps[self._end - 1]), self._rows[self._end - 1]

    def add(self, stamp_ns: int, row: ArrayLike) -> bool:
        """Append a row; False, and nothing kept, when `stamp_ns` does not come after the newest."""
        stamp_ns = checked_stamp(stamp_ns)
        newest = self.newest_ns
        if newest is not None and stamp_ns <= newest:
            return False
        if self._end == len(self._stamps):
            self._make_room()
        self._stamps[self._end] = stamp_ns
        self._rows[self._end] = row
        self._end += 1
        self._start = max(self._start, self._end - self._limit)
        return True

    def between(self, first_ns: int, last_ns: int, *, spare: int = 0) -> tuple[Stamps, Rows]:
        """The rows from the last one at or before `first_ns` to the first one at or after `last_ns`.

        `spare`: with so many more before them, as far as there are.
        """
        stamps = self._stamps[self._start : self._end]
        first = max(int(np.searchsorted(stamps, first_ns, "right")) - 1 - spare, 0)
        last = int(np.searchsorted(stamps, last_ns, "left")) + 1
        return stamps[first:last], self._rows[self._start : self._end][first:last]

    def forget(self, before_ns: int, *, spare: int = 0) -> None:
        """Drop what no time at or after `before_ns` needs: all rows before those that `between` gives for it."""
        stamps = self._stamps[self._start : self._end]
        self._start += max(int(np.searchsorted(stamps, before_ns, "right")) - 1 - spare, 0)

    def _make_room(self) -> None:
        # Rows forgotten at the front are reused first, so a long flight stays in the first block.
        kept = slice(self._start, self._end)
        capacity = max(FIRST_CAPACITY, 2 * len(self))
        stamps, rows = np.empty(capacity, dtype=np.int64), np.empty((capacity, self._rows.shape[1]))
        stamps[: len(self)], rows[: len(self)] = self._stamps[kept], self._rows[kept]
        self._stamps, self._rows = stamps, rows
        self._start, self._end = 0, len(self)
