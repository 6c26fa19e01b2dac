"""Positions in metres that are good to centimetres: of motion capture, SLAM, RTK, a simulator."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flightdepth.flight.position_noise import smoothed
from flightdepth.flight.positions import fixes
from flightdepth.flight.records import (
    FASTEST_M_S,
    MAX_GAP_S,
    NS_PER_S,
    PositionSample,
    Sample,
    VelocitySample,
)
from flightdepth.motion import Stamps, Vector

FARTHEST_M = 1e8  # of a position, such as UTM's
LEAST_STEP_S = 0.1  # over less, a centimetre of noise is a large velocity


def samples_along(stamps_ns: Stamps, ned: Vector) -> list[Sample]:
    """Positions [n, 3], metres north, east, down, at rising stamps [n >= 1], and velocities along them.

    Where a row repeats the position before until the receiver has a new one, it tells nothing; positions that jitter
    are `smoothed`. Velocities are told at positions LEAST_STEP_S apart, the mean of the slopes before and after; none
    across a gap of more than MAX_GAP_S, nor across a jump. Empty where no two positions belong together.
    """
    told = fixes((stamps_ns - stamps_ns[0]) / NS_PER_S, ned)
    stamps_ns = stamps_ns[told]
    ned = smoothed((stamps_ns - stamps_ns[0]) / NS_PER_S, ned[told])
    apart = _apart(stamps_ns.tolist())
    velocities = _velocities(stamps_ns[apart], ned[apart])
    if not velocities:
        return []
    positions = [PositionSample(at, each) for at, each in zip(stamps_ns.tolist(), ned, strict=True)]
    return [*velocities, *positions]


def _velocities(stamps_ns: Stamps, ned: Vector) -> list[VelocitySample]:
    step_s = np.diff(stamps_ns) / NS_PER_S
    slopes = np.diff(ned, axis=0) / step_s[:, None]
    flown = (step_s <= MAX_GAP_S) & (np.linalg.norm(slopes, axis=1) < FASTEST_M_S)
    beside = np.zeros((len(ned), 2, 3))  # the slopes before and after each
    beside[1:, 0][flown] = beside[:-1, 1][flown] = slopes[flown]
    count = np.append(flown, False).astype(int) + np.insert(flown, 0, False)
    return [
        VelocitySample(int(at), both.sum(axis=0) / of)
        for at, both, of in zip(stamps_ns, beside, count, strict=True)
        if of
    ]


def _apart(stamps_ns: Sequence[int]) -> list[int]:
    """Places of stamps that follow the one before at LEAST_STEP_S or later, less a rounding."""
    kept: list[int] = []
    for place, stamp_ns in enumerate(stamps_ns):
        if not kept or stamp_ns - stamps_ns[kept[-1]] > 0.99 * LEAST_STEP_S * NS_PER_S:
            kept.append(place)
    return kept
