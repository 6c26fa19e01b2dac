"""How memory and other figures rise in the course of a long run."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

PAGE_MIB = os.sysconf("SC_PAGE_SIZE") / 2**20


def resident_mib() -> float:
    """Memory of this process that is in RAM."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE_MIB


def slope_an_hour(minutes: np.ndarray[Any, Any], values: np.ndarray[Any, Any]) -> tuple[float, float]:
    """Least squares: by how much `values` rise in an hour, and the standard error of that; NaN for fewer than three."""
    if len(minutes) < 3:
        return float("nan"), float("nan")
    (slope, _), covariance = np.polyfit(minutes / 60, values, 1, cov=True)
    return float(slope), float(np.sqrt(covariance[0, 0]))
