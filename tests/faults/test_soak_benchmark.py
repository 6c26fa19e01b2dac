"""benchmarks/soak.py flies the sample flight with smaller pictures, through all that `flightdepth run` does."""

import importlib
from pathlib import Path

import pytest

from flightdepth.flight import open_flight
from flightdepth.outputs.run import depths
from flightdepth.ranges import MultiRangeEstimator
from flightdepth.runtimes.network import load_network

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def soak(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module("soak")


@pytest.fixture
def sample(soak):
    with open_flight(
        soak.SAMPLE / "flight.mp4", soak.SAMPLE / "telemetry.csv", soak.SAMPLE / "camera.json"
    ) as opened:
        yield opened


def test_a_shrunk_flight_has_all_that_the_frame_loop_reads(soak, sample):
    """It was a class of its own without `turns`, and the soak ended at its first frame."""
    flight = soak.Shrunk(sample, 4, 60.0)
    estimator = MultiRangeEstimator(load_network("motion-tiny"), flight.camera)
    frame, result = next(iter(depths(flight, estimator)))
    assert frame.image.shape == (flight.camera.height, flight.camera.width, 3)
    assert flight.camera.width == sample.camera.width // 4
    assert result.depth_m.shape == frame.image.shape[:2]


def test_a_shrunk_flight_ends_when_its_time_is_over(soak, sample):
    assert not list(soak.Shrunk(sample, 4, 0.0))
