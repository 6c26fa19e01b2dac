"""The camera's orientation at any time, from time-ordered quaternions."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.flight.records import HOLD_S, MAX_GAP_S
from flightdepth.motion import Vector, mixed_quaternions, rotations_from_quaternions
from flightdepth.ranges.timeline import Rows, Stamps
from flightdepth.runtimes.arrays import Flags

# Past the last sample, as live, the camera turns on for a while as it did over the last ones: at 50 degrees/s an
# attitude of 20 ms before is a degree off.
TURNED_OVER_NS, LEAST_OVER_NS, TURNS_ON_S = 200_000_000, 30_000_000, 0.15
SLOWEST_RAD_S, FASTEST_RAD_S = 0.08, 4.0  # slower is noise of the samples, faster a jump


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
    """Rotations [k, 3, 3] at the times `at_ns` [k] and whether each is known; unknown ones are the identity.

    Past the last of the samples it turns on for TURNS_ON_S, and then stays.
    """
    if not len(stamps_ns):
        return np.broadcast_to(np.eye(3), (len(at_ns), 3, 3)), np.zeros(len(at_ns), dtype=np.bool_)
    before, elapsed_s, share, known = neighbours(stamps_ns, at_ns)
    start, end = quaternions[before], quaternions[np.minimum(before + 1, len(quaternions) - 1)]
    rotations = rotations_from_quaternions(mixed_quaternions(start, end, share))
    if (late := known & (at_ns > stamps_ns[-1])).any():
        rate_rad_s = _last_rate(stamps_ns, quaternions)
        turned = [cv2.Rodrigues(rate_rad_s * min(each_s, TURNS_ON_S))[0] for each_s in elapsed_s[late]]
        rotations[late] = rotations[late] @ np.array(turned)
    rotations[~known] = np.eye(3)
    return rotations, known


def turns_until_last(rotations: Vector, known: Flags) -> tuple[Vector, Flags]:
    """Of orientations [k + 1, 3, 3], known or not: rotations [k, 3, 3] of rays, from each camera's axes to the last's.

    And which are known [k]; unknown ones are the identity.
    """
    turns = np.einsum("ji,kjl->kil", rotations[-1], rotations[:-1])
    both = known[:-1] & known[-1]
    turns[~both] = np.eye(3)
    return turns, both


def turn_angles_rad(turns: Vector) -> Vector:
    """Angles [k] of rotations [k, 3, 3], 0..pi."""
    return np.asarray(np.arccos(np.clip((np.trace(turns, axis1=1, axis2=2) - 1) / 2, -1, 1)))


def _last_rate(stamps_ns: Stamps, quaternions: Rows) -> Vector:
    """Turn rates (3,), rad/s about the camera's axes, over the last TURNED_OVER_NS; 0 where no samples tell."""
    first = int(np.searchsorted(stamps_ns, stamps_ns[-1] - TURNED_OVER_NS))
    over_ns = int(stamps_ns[-1] - stamps_ns[first])
    if over_ns < LEAST_OVER_NS:
        return np.zeros(3)
    earlier, last = rotations_from_quaternions(quaternions[[first, -1]])
    rate_rad_s = np.asarray(cv2.Rodrigues(earlier.T @ last)[0][:, 0] / (over_ns * 1e-9), dtype=np.float64)
    return rate_rad_s if SLOWEST_RAD_S < np.linalg.norm(rate_rad_s) < FASTEST_RAD_S else np.zeros(3)
