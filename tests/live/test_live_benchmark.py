"""The arithmetic of benchmarks/live.py: what it says of an hour must be what the hour was."""

import importlib
import time
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from flightdepth.evaluation.provenance import network_facts
from flightdepth.runtimes.network import load_network

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def benchmark(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module("live")


def result(age_ms, ranges=1, age_from="sender"):
    return SimpleNamespace(age_ms=age_ms, status=SimpleNamespace(ranges=ranges, age_from=age_from))


def minute(benchmark, age_ms_p95=40, rss_mib=300, others=0.0):
    return benchmark.Minute(30, 30, 20, age_ms_p95, 60, 2, 40, rss_mib, 1, others)


def test_a_straight_line_has_its_slope_and_no_error(benchmark):
    minutes = np.arange(60)
    assert benchmark.slope_an_hour(minutes, 40 + minutes / 120) == pytest.approx((0.5, 0), abs=1e-12)


def test_the_error_of_a_slope_is_by_hand(benchmark):
    """Of 0, 1, 0 in an hour each nothing rises; 2/3 are left, over one degree of freedom and a spread of 2."""
    assert benchmark.slope_an_hour(60 * np.arange(3), np.array([0, 1, 0])) == pytest.approx((0, 3**-0.5))


def test_two_points_tell_no_slope(benchmark):
    assert np.isnan(benchmark.slope_an_hour(np.arange(2), np.arange(2))).all()


def test_age_and_memory_each_have_their_slope(benchmark):
    age, rss = benchmark.slopes([minute(benchmark, 40 + i, 300 + 2 * i) for i in range(5)])
    assert age[0] == pytest.approx(60)
    assert rss[0] == pytest.approx(120)


def test_the_watch_tells_percentiles_of_one_minute_only(benchmark):
    watch = benchmark.Watch()
    watch(result(5000.0))  # before it begins
    watch.begin(1000)
    for age in range(101):
        watch(result(float(age), ranges=1 + age % 2, age_from="sender" if age < 50 else "reception"))
    found = watch.end(1202)
    assert (found.age_ms_p50, found.age_ms_p95, found.age_ms_p99) == (50, 95, 99)
    assert found.ranges_mean == pytest.approx(1 + 50 / 101)
    assert found.from_sender == pytest.approx(50 / 101)
    assert found.received_a_second == pytest.approx(2 * found.results_a_second)
    watch(result(7.0))
    assert watch.end(1203).age_ms_p99 == 7


def test_no_result_is_said(benchmark):
    watch = benchmark.Watch()
    watch.begin(0)
    with pytest.raises(SystemExit, match="no result"):
        watch.end(0)


def test_the_quietest_minutes_are_in_a_row(benchmark):
    shares = [0.0, 0.9, 0.0, 0.2, 0.1, 0.2, 0.9, 0.0]
    found = [minute(benchmark, others=share) for share in shares]
    assert benchmark.quietest(found, length=3) == 2  # 0.0 + 0.2 + 0.1
    assert benchmark.quietest(found[:2], length=3) == 0


def test_pictures_dropped_while_it_warmed_up_do_not_count(benchmark, monkeypatch):
    frames = SimpleNamespace(received=100, dropped={"late": 5})

    class AMinute:
        def begin(self, received):
            pass

        def end(self, received):
            frames.dropped = {"late": 7, "damaged": 1}
            return minute(benchmark)

    flown = SimpleNamespace(status=lambda: SimpleNamespace(frames=frames)), AMinute(), None
    monkeypatch.setattr(benchmark, "flying", lambda *_: nullcontext(flown))
    monkeypatch.setattr(benchmark.time, "sleep", lambda _: None)
    found = benchmark.run_minutes(SimpleNamespace(minutes=1), None)
    assert found["dropped"] == {"late": 2, "damaged": 1}


def test_figures_say_which_network_they_are_of(benchmark, monkeypatch):
    network = load_network("tiny-clamped-256")
    monkeypatch.setattr(benchmark, "load_network", lambda name, precision: network)
    monkeypatch.setattr(benchmark, "run_once", lambda arguments, network: {"fps": 30})
    found = benchmark.run(SimpleNamespace(minutes=None, network="tiny-clamped-256"), None)
    assert found == {"fps": 30, "network": network_facts(network)}


def test_this_process_does_not_count_as_others(benchmark):
    before, own = benchmark.busy_s(), time.process_time()
    while time.process_time() - own < 0.3:
        pass
    assert benchmark.busy_s() - before >= 0.25


def test_each_stage_that_it_times_is_there(benchmark):
    before = [getattr(owner, name) for _, owner, name in benchmark.STAGES]
    with benchmark.StageTimes().taken():
        during = [getattr(owner, name) for _, owner, name in benchmark.STAGES]
    after = [getattr(owner, name) for _, owner, name in benchmark.STAGES]
    assert after == before and not any(a is b for a, b in zip(during, before, strict=True))
