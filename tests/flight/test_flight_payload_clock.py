import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightdepth.flight.payload_clock import Interval, on_video_clock, sampling_period_ns, spread

MS = 1_000_000


def recorded(taken_ms, delay_ms, zero_ms, *, payload_ms=1001, count=12):
    """Samples taken at video times, arriving `delay_ms` later; their clock reads `zero_ms` at time 0."""
    intervals = [Interval(k * payload_ms * MS, (k + 1) * payload_ms * MS) for k in range(count)]
    arrived = np.asarray(taken_ms) + delay_ms
    clocks = [(np.asarray(taken_ms)[arrived // payload_ms == k] + zero_ms) / 1000 for k in range(count)]
    return clocks, intervals


def test_samples_without_a_clock_spread_over_their_payload():
    assert spread(4, Interval(1000, 2000)).tolist() == [1000, 1250, 1500, 1750]


def test_no_sample_spreads_to_none():
    assert spread(0, Interval(0, 1000)).tolist() == []


def test_own_spacing_is_kept_exactly():
    clocks, intervals = recorded([0, 250, 510, 750, 990, 1300], 0, 5000)
    assert np.diff(on_video_clock(clocks, intervals)).tolist() == [
        250 * MS,
        260 * MS,
        240 * MS,
        240 * MS,
        310 * MS,
    ]


@given(st.integers(0, 10**6), st.integers(40, 251), st.integers(0, 250))
def test_a_delay_of_one_period_is_found_to_within_the_phase(zero_ms, first_ms, extra):
    taken = first_ms + np.arange(40) * 252
    clocks, intervals = recorded(taken, 252, zero_ms + extra)
    assert np.abs(on_video_clock(clocks, intervals) - taken * MS).max() <= 126 * MS


def test_the_answer_does_not_depend_on_the_clocks_zero():
    taken = 100 + np.arange(40) * 252
    first = on_video_clock(*recorded(taken, 100, 0))
    second = on_video_clock(*recorded(taken, 100, 7_654_321))
    assert (first == second).all()


def test_payloads_without_samples_do_not_matter():
    clocks, intervals = recorded(100 + np.arange(20) * 252, 100, 0)
    assert not len(clocks[-1])
    assert (on_video_clock(clocks, intervals) == on_video_clock(clocks[:8], intervals[:8])).all()


def test_many_payloads_narrow_the_arrival_to_milliseconds():
    taken = 20 + np.arange(150) * 252  # 4 * 252 ms drift by 7 ms against each payload of 1001 ms
    found = on_video_clock(*recorded(taken, 252, 0, count=40))
    assert np.abs(found - taken * MS).max() <= 4 * MS


def test_samples_held_up_at_the_start_do_not_shift_the_rest():
    taken = 20 + np.arange(150) * 252
    clocks, intervals = recorded(taken, 252, 0, count=40)
    clocks = [clocks[0], np.empty(0), np.concatenate(clocks[1:3]), *clocks[3:]]
    assert np.abs(on_video_clock(clocks, intervals) - taken * MS).max() <= 8 * MS


@pytest.mark.parametrize(("stamps", "period"), [([5], 0), ([0, 10, 20, 90], 10)])
def test_the_period_is_the_median_spacing(stamps, period):
    assert sampling_period_ns(np.array(stamps)) == period
