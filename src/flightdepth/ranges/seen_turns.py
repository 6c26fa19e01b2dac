"""How a camera turned whose attitude no log tells: the turns that its pairs show, put together.

Each pair tells its own turn, beside where it moved to (`derotation`). So the orientation of a frame follows from that
of an earlier one, in the axes of the frame with which it began. What comes next is expected to turn on as the last
frames did: then only what changes is left to be seen, and a camera may turn as fast as if a log told its attitude.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flightdepth.motion import Vector, quaternion_from_rotation
from flightdepth.ranges.attitude import (
    TURNED_OVER_NS,
    TURNS_ON_S,
    orientations,
    turn_angles_rad,
    turns_until_last,
)
from flightdepth.ranges.pairs import TURNED_AWAY, Baselines, Pair
from flightdepth.ranges.timeline import Stamps, Timeline
from flightdepth.runtimes.arrays import Flags

# A pair that turned by less is taken not to have: turns that are none, as flying sideways along a wall shows them, do
# not lead to more of them then.
LEAST_TURN_RAD = 0.015
DRIFTS_NS = 2_000_000_000  # by a quarter of a degree, of .03 a pair


@dataclass(frozen=True, eq=False)
class SeenOrientation:
    """A camera's axes in those of an earlier frame, as a rotation (3, 3); comparable where they have begun together.

    begun_ns  when that frame was taken
    """

    rotation: Vector
    begun_ns: int

    def axes(self, stamp_ns: int) -> tuple[int, int]:
        """The same for orientations of a moment, between which turns that were put together have hardly drifted."""
        return self.begun_ns, stamp_ns // DRIFTS_NS


class SeenTurns:
    """Orientations of a flight's frames by the turns between them; `add` each frame's pairs in time order."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Begin anew with the next pairs."""
        self._quaternions = Timeline(4)
        self._begun_ns = 0

    def expire(self, before_ns: int) -> None:
        """Drop what times from `before_ns` on do not need."""
        self._quaternions.forget(before_ns)

    def add(self, stamp_ns: int, pairs: Sequence[Pair]) -> SeenOrientation | None:
        """The orientation of a frame by its pairs, the shortest first; None where their pictures tell no turn.

        Beside a direction of the log's, which may be wrong, turns are seen that are none.
        """
        pairs = [pair for pair in pairs if pair.seen and pair.covariance is not None]
        if not pairs:
            return None
        stamps_ns = np.array([pair.previous.stamp_ns for pair in pairs], dtype=np.int64)
        before, known = self._at(stamps_ns[::-1])
        if known.any():
            longest = int(np.argmax(known))
            rotation = before[longest] @ pairs[len(pairs) - 1 - longest].current_from_previous.T
        else:
            self.forget()
            self._begun_ns, rotation = stamp_ns, np.eye(3)
            for pair in reversed(pairs):
                self._add(pair.previous.stamp_ns, pair.current_from_previous)
        self._add(stamp_ns, rotation)
        return SeenOrientation(np.asarray(rotation), self._begun_ns)

    def goes_on(self, stamp_ns: int) -> bool:
        """Whether it is known how the camera turned until just before a time."""
        newest_ns = self._quaternions.newest_ns
        return newest_ns is not None and stamp_ns - newest_ns <= TURNS_ON_S * 1e9

    def since(self, stamps_ns: Stamps, stamp_ns: int) -> tuple[Vector, Flags]:
        """Rotations [k, 3, 3] of rays since rising times [k] until another, and which are known; the identity else."""
        return turns_until_last(*self._at(np.append(stamps_ns, stamp_ns)))

    def expected(self, lines: Baselines, stamp_ns: int, max_turn_rad: float) -> Baselines:
        """Baselines until a time as the camera is expected to have turned; beyond `max_turn_rad` they are of no use."""
        if not self.goes_on(stamp_ns):
            return lines
        stamps_ns = np.array([lines.frames[k].stamp_ns for k in range(len(lines.usable))], dtype=np.int64)
        turns, _ = self.since(stamps_ns, stamp_ns)
        turn_rad = turn_angles_rad(turns)
        still = turn_rad < LEAST_TURN_RAD
        turns[still], turn_rad[still] = np.eye(3), 0.0
        usable = lines.usable & (turn_rad <= max_turn_rad)
        reason = None if usable.any() else TURNED_AWAY
        return replace(lines, current_from_previous=turns, turn_rad=turn_rad, usable=usable, reason=reason)

    def _at(self, stamps_ns: Stamps) -> tuple[Vector, Flags]:
        last_ns = int(stamps_ns[-1])
        first_ns = min(int(stamps_ns[0]), last_ns - TURNED_OVER_NS)
        return orientations(*self._quaternions.between(first_ns, last_ns), stamps_ns)

    def _add(self, stamp_ns: int, rotation: Vector) -> None:
        self._quaternions.add(stamp_ns, quaternion_from_rotation(rotation))
