"""A flight without a log: a constant speed, nobody knows which way."""

from __future__ import annotations

import numpy as np

from flightdepth.errors import BadInput
from flightdepth.flight.records import FASTEST_M_S, VelocitySample


def forward_velocity(stamp_ns: int, speed_m_s: float) -> VelocitySample:
    """Northwards, since some way it must be: without an attitude only the length counts."""
    if not 0 <= speed_m_s <= FASTEST_M_S:
        raise BadInput("--speed", expected=f"0 to {FASTEST_M_S:g} m/s", got=f"{speed_m_s:g}")
    return VelocitySample(stamp_ns, np.array([speed_m_s, 0.0, 0.0]), "world")
