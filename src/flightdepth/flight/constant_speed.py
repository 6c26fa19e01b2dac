"""A flight without a log: a constant speed, nobody knows which way."""

from __future__ import annotations

import math

import numpy as np

from flightdepth.errors import BadInput
from flightdepth.flight.records import VelocitySample


def forward_velocity(stamp_ns: int, speed_m_s: float) -> VelocitySample:
    """Northwards, since some way it must be: without an attitude only the length counts."""
    if not (math.isfinite(speed_m_s) and speed_m_s >= 0):
        raise BadInput("--speed", expected="a finite number of m/s, 0 or more", got=str(speed_m_s))
    return VelocitySample(stamp_ns, np.array([speed_m_s, 0.0, 0.0]), "world")
