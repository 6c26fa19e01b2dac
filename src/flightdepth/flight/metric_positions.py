"""Velocity from positions in metres that are good to a small part of a step: motion capture, SLAM, RTK, a simulator.

Summed as velocities are, trapezoid by trapezoid, it leads back to each of the positions.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from flightdepth.flight.positions import JUMPING
from flightdepth.flight.records import FASTEST_M_S, MAX_GAP_S, NS_PER_S, VelocitySample
from flightdepth.motion import Vector

LEAST_STEP_S = (
    0.05  # of denser positions some are left out: over less, a centimetre of noise is a large velocity
)


def velocities_along(stamps_ns: NDArray[np.int64], ned: Vector, counts: Counter[str]) -> list[VelocitySample]:
    """Velocities along positions [n, 3], metres north, east, down, at rising stamps [n].

    None across a gap of more than MAX_GAP_S, nor across a jump, which is counted. Of each stretch between two
    positions, s its slope: at its ends the mean of its and its neighbour's slope, half-way what makes the integral
    over both halves right, 2 s - (the mean of the two ends).
    """
    kept = _apart(stamps_ns)
    stamps_ns, ned = stamps_ns[kept], ned[kept]
    samples: list[VelocitySample] = []
    for part in _connected(stamps_ns, ned, counts):
        slopes = np.diff(ned[part], axis=0) / (np.diff(stamps_ns[part]) / NS_PER_S)[:, None]
        ends = np.concatenate([slopes[:1], (slopes[1:] + slopes[:-1]) / 2, slopes[-1:]])
        velocity = np.empty((len(ends) + len(slopes), 3))
        velocity[::2], velocity[1::2] = ends, 2 * slopes - (ends[1:] + ends[:-1]) / 2
        at_ns = np.empty(len(velocity), np.int64)
        at_ns[::2] = stamps_ns[part]
        at_ns[1::2] = at_ns[:-1:2] + np.diff(stamps_ns[part]) // 2
        samples += [VelocitySample(at, each) for at, each in zip(at_ns.tolist(), velocity, strict=True)]
    return samples


def _apart(stamps_ns: NDArray[np.int64]) -> list[int]:
    """Places of stamps that follow the one before at LEAST_STEP_S or later, less a rounding."""
    kept: list[int] = []
    for place, stamp_ns in enumerate(stamps_ns.tolist()):
        if not kept or stamp_ns - stamps_ns[kept[-1]] > 0.99 * LEAST_STEP_S * NS_PER_S:
            kept.append(place)
    return kept


def _connected(stamps_ns: NDArray[np.int64], ned: Vector, counts: Counter[str]) -> Iterator[slice]:
    """Two positions or more without a gap or a jump between them."""
    step_s = np.diff(stamps_ns) / NS_PER_S
    jumps = np.linalg.norm(np.diff(ned, axis=0), axis=1) > FASTEST_M_S * step_s
    counts[JUMPING] += int(jumps.sum())
    ends = [0, *(np.flatnonzero(jumps | (step_s > MAX_GAP_S)) + 1).tolist(), len(stamps_ns)]
    return (slice(first, last) for first, last in pairwise(ends) if last - first > 1)
