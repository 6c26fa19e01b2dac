"""The camera's orientation at any time, from time-ordered quaternions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flightdepth.flight.records import HOLD_S, MAX_GAP_S
from flightdepth.motion import Vector, mixed_quaternions, rotations_from_quaternions
from flightdepth.ranges.timeline import Rows, Stamps
from flightdepth.runtimes.arrays import Flags


def neighbours(stamps_ns: Stamps, at_ns: Stamps) -> tuple[NDArray[np.intp], Vector, Vector, Flags]:
    """Where each of `at_ns` [k] lies among the samples [m >= 1]: (before, elapsed_s, share, known).

    `before` is the sample at or before it, `elapsed_s` the time since, `share` 0..1 the way to the next
    sample (0 where that is missing or beyond a gap), `known` whether the value there may be used.
    """
    before = np.searchsorted(stamps_ns, at_ns, "right") - 1
    started = before >= 0
    before = np.maximum(before, 0)
    after = np.minimum(before + 1, len(stamps_ns) - 1)
    step_s = (stamps_ns[after] - stamps_ns[before]) * 1e-9
    elapsed_s = np.asarray((at_ns - stamps_ns[before]) * 1e-9, dtype=np.float64)
    inside = (step_s > 0) & (step_s <= MAX_GAP_S)
    share: Vector = np.where(inside, elapsed_s / np.where(inside, step_s, 1.0), 0.0)
    return before, elapsed_s, share, started & (inside | (elapsed_s <= HOLD_S))


def orientations(stamps_ns: Stamps, quaternions: Rows, at_ns: Stamps) -> tuple[Vector, Flags]:
    """Rotations [k, 3, 3] at the times `at_ns` [k] and whether each is known; unknown ones are the identity."""
    if not len(stamps_ns):
        return np.broadcast_to(np.eye(3), (len(at_ns), 3, 3)), np.zeros(len(at_ns), dtype=np.bool_)
    before, _, share, known = neighbours(stamps_ns, at_ns)
    start, end = quaternions[before], quaternions[np.minimum(before + 1, len(quaternions) - 1)]
    rotations = rotations_from_quaternions(mixed_quaternions(start, end, share))
    rotations[~known] = np.eye(3)
    return rotations, known
