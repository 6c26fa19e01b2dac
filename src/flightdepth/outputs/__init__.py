"""Files of a flight's depth: written beside the frame loop, and read back."""

from flightdepth.outputs.preview import Preview
from flightdepth.outputs.read import FlightFolder, read_confidence, read_depth
from flightdepth.outputs.record import Source, Summary
from flightdepth.outputs.run import run_flight
from flightdepth.outputs.writer import FlightWriter

__all__ = [
    "FlightFolder",
    "FlightWriter",
    "Preview",
    "Source",
    "Summary",
    "read_confidence",
    "read_depth",
    "run_flight",
]
