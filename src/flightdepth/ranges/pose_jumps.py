"""Poses that jump: a SLAM loop closure or a GPS reset moves the map, not the drone."""

from __future__ import annotations

from collections import Counter

import numpy as np

from flightdepth.flight.records import FASTEST_M_S, MAX_GAP_S
from flightdepth.motion import Vector
from flightdepth.ranges.timeline import Rows

# A drone hardly accelerates by more; a lone sample that jumps farther is a glitch.
MAX_ACCELERATION_M_S2 = 30.0
POSITION_NOISE_M = 0.5  # of three poses in a row, with up to four centimetres of noise in each axis


class PoseJumps:
    """Finds the places where measured positions jump; give it every pose, in the order of time.

    One that lies where no drone can fly from those before waits for the next: where that goes on from those
    before, it was a glitch and is dropped; where it goes on from the one that waits, a new segment begins there.
    """

    def __init__(self, dropped: Counter[str]) -> None:
        self._dropped = dropped
        self._segment = 0
        self._last: tuple[int, Rows] | None = None
        self._speed: Vector | None = None  # m/s over the last step of `_step_s`, where one is known
        self._step_s = 0.0
        self._suspect: tuple[int, Rows] | None = None

    @property
    def newest_ns(self) -> int | None:
        """Stamp of the last pose taken."""
        newest = self._suspect or self._last
        return None if newest is None else newest[0]

    def take(self, stamp_ns: int, row: Rows) -> list[tuple[int, Rows]]:
        """The poses that may be used now: stamps, and rows that begin with the position, with their segment added."""
        suspect, self._suspect = self._suspect, None
        if self._last is None or self._goes_on(stamp_ns, row):
            self._count_glitch(suspect)
            return [self._kept(stamp_ns, row)]
        # Soon enough that nothing else is to be known of the speed between.
        if suspect is not None and stamp_ns - suspect[0] <= MAX_GAP_S * 1e9 and _near(suspect, stamp_ns, row):
            self._dropped["way between two poses: a jump"] += 1
            self._segment += 1
            return [self._kept(*suspect), self._kept(stamp_ns, row)]
        self._count_glitch(suspect)
        self._suspect = stamp_ns, row
        return []

    def _count_glitch(self, suspect: tuple[int, Rows] | None) -> None:
        if suspect is not None:
            self._dropped["pose glitch"] += 1

    def _goes_on(self, stamp_ns: int, row: Rows) -> bool:
        """Whether a drone can be there after the last pose, at the speed that it had."""
        assert self._last is not None
        if self._speed is None:
            return _near(self._last, stamp_ns, row)
        step_s = (stamp_ns - self._last[0]) * 1e-9
        off_m = np.linalg.norm(row[:3] - self._last[1][:3] - self._speed * step_s)
        # The speed is that of the middle of the step before.
        return bool(off_m <= POSITION_NOISE_M + MAX_ACCELERATION_M_S2 * step_s * (step_s + self._step_s) / 2)

    def _kept(self, stamp_ns: int, row: Rows) -> tuple[int, Rows]:
        if self._last is not None:
            self._step_s = (stamp_ns - self._last[0]) * 1e-9
            self._speed = (row[:3] - self._last[1][:3]) / self._step_s
        self._last = stamp_ns, row
        return stamp_ns, np.append(row, self._segment)


def _near(pose: tuple[int, Rows], stamp_ns: int, row: Rows) -> bool:
    """Whether a drone of unknown speed can fly there from a pose."""
    reach_m = POSITION_NOISE_M + FASTEST_M_S * (stamp_ns - pose[0]) * 1e-9
    return float(np.linalg.norm(row[:3] - pose[1][:3])) <= reach_m
