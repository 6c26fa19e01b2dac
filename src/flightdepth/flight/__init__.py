"""Video and telemetry of a flight: frames, velocities, positions and attitudes on one clock."""

from flightdepth.flight.open import Flight, open_flight
from flightdepth.flight.records import (
    AttitudeSample,
    BodyAttitudeSample,
    Frame,
    GyroscopeTrack,
    PositionSample,
    Telemetry,
    VelocitySample,
)
from flightdepth.flight.steadiness import Steadiness, TurnRate
from flightdepth.flight.telemetry import read_telemetry
from flightdepth.flight.telemetry_csv import read_csv, write_csv
from flightdepth.flight.universal_time import UniversalTime

__all__ = [
    "AttitudeSample",
    "BodyAttitudeSample",
    "Flight",
    "Frame",
    "GyroscopeTrack",
    "PositionSample",
    "Steadiness",
    "Telemetry",
    "TurnRate",
    "UniversalTime",
    "VelocitySample",
    "open_flight",
    "read_csv",
    "read_telemetry",
    "write_csv",
]
