import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightdepth.errors import BadInput
from flightdepth.ranges.timeline import FIRST_CAPACITY, Timeline


def filled(count: int, **options: int) -> Timeline:
    timeline = Timeline(1, **options)
    for k in range(count):
        assert timeline.add(10 * k, [k])
    return timeline


@given(st.integers(1, 50), st.integers(-20, 520), st.integers(0, 300))
def test_between_holds_a_sample_on_either_side(count: int, first: int, span: int) -> None:
    stamps, rows = filled(count).between(first, first + span)
    assert len(stamps) == len(rows)
    if first >= 0 and first + span <= 10 * (count - 1):
        assert stamps[0] <= first
        assert stamps[-1] >= first + span


def test_only_later_stamps_are_taken() -> None:
    timeline = filled(3)
    assert not timeline.add(20, [9])
    assert not timeline.add(5, [9])
    assert len(timeline) == 3


def test_growing_loses_nothing() -> None:
    stamps, rows = filled(3 * FIRST_CAPACITY).between(0, 10**9)
    np.testing.assert_array_equal(rows[:, 0], np.arange(3 * FIRST_CAPACITY))
    np.testing.assert_array_equal(stamps, 10 * np.arange(3 * FIRST_CAPACITY))


def test_the_oldest_go_beyond_the_limit() -> None:
    timeline = filled(3000, limit=100)
    assert len(timeline) == 100
    assert timeline.between(0, 10**9)[0][0] == 29000


def test_forgetting_keeps_what_interpolation_needs() -> None:
    timeline = filled(10)
    timeline.forget(55)
    assert timeline.between(0, 1000)[0][0] == 50


def test_forgetting_while_adding_stays_in_the_first_block() -> None:
    timeline = Timeline(1)
    for k in range(10 * FIRST_CAPACITY):
        timeline.add(k, [k])
        timeline.forget(k - 100)
    assert len(timeline._stamps) == FIRST_CAPACITY
    assert timeline.newest == (10 * FIRST_CAPACITY - 1, [10 * FIRST_CAPACITY - 1])


@pytest.mark.parametrize("stamp_ns", [12.5, np.float64(3.0), "7"])
def test_times_are_whole_nanoseconds(stamp_ns):
    """Seconds as floats became the same time over and over, and "no motion known" came of it."""
    timeline = Timeline(1)
    with pytest.raises(BadInput, match=r"whole nanoseconds, got (float|str)"):
        timeline.add(stamp_ns, [0.0])
    assert timeline.add(np.int64(7), [0.0])


@pytest.mark.parametrize("stamp_ns", [2**63, -(2**63), np.uint64(2**63)])
def test_times_beyond_64_bits_are_refused(stamp_ns):
    with pytest.raises(BadInput, match="146 years of nanoseconds at most"):
        Timeline(1).add(stamp_ns, [0.0])
