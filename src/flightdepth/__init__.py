"""flightdepth: metric depth from a drone's stabilised video and its flight log."""

from __future__ import annotations

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

# OpenVINO tells its makers of each import, by this package, and keeps an id for it at home; without it, it does not.
sys.modules.setdefault("openvino_telemetry", None)  # type: ignore[arg-type]

if TYPE_CHECKING:
    from flightdepth.camera import Camera
    from flightdepth.errors import BadInput, FlightDepthError
    from flightdepth.flight import AttitudeSample, Frame, PositionSample, VelocitySample, open_flight
    from flightdepth.outputs import FlightFolder
    from flightdepth.ranges import MultiRangeEstimator, RangedDepth
    from flightdepth.runtimes import load_network, networks

# Each name is imported when it is first asked for, so that `import flightdepth` costs nothing.
_HOMES = {
    "AttitudeSample": "flightdepth.flight",
    "BadInput": "flightdepth.errors",
    "Camera": "flightdepth.camera",
    "FlightDepthError": "flightdepth.errors",
    "FlightFolder": "flightdepth.outputs",
    "Frame": "flightdepth.flight",
    "MultiRangeEstimator": "flightdepth.ranges",
    "PositionSample": "flightdepth.flight",
    "RangedDepth": "flightdepth.ranges",
    "VelocitySample": "flightdepth.flight",
    "load_network": "flightdepth.runtimes",
    "networks": "flightdepth.runtimes",
    "open_flight": "flightdepth.flight",
}

__all__ = [
    "AttitudeSample",
    "BadInput",
    "Camera",
    "FlightDepthError",
    "FlightFolder",
    "Frame",
    "MultiRangeEstimator",
    "PositionSample",
    "RangedDepth",
    "VelocitySample",
    "load_network",
    "networks",
    "open_flight",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'flightdepth' has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value  # next time without this function
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
