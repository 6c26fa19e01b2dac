"""What benchmarks/obstacle_distances.py keeps: a flight of other weights is another flight."""

import importlib
from pathlib import Path

import numpy as np

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


def test_flights_of_other_weights_are_flown_again(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    benchmark = importlib.import_module("obstacle_distances")
    flown = []

    def compared(number):
        flown.append(number)
        return [benchmark.Compared(np.ones(1), np.ones(1), np.ones(1, bool)) for _ in benchmark.WAYS]

    monkeypatch.setattr(benchmark, "compared", compared)
    for network in ("motion", "motion", "motion-tiny"):
        monkeypatch.setattr(benchmark, "nearest_network", lambda _, name=network: name)
        benchmark.part(0, tmp_path)
    assert flown == [0, 0]
