"""Rates and ages over the last seconds, by hand."""

import pytest

from flightdepth.live.meters import Ages, Rate

MS, S = 10**6, 10**9


def rate_of(*seconds):
    rate = Rate()
    for each in seconds:
        rate.add(round(each * S))
    return rate


def test_a_rate_is_that_of_the_last_three_seconds():
    """10 a second for four seconds, then 20: after one and a half of them half of the time is that of before."""
    rate = rate_of(*(i / 10 for i in range(41)))
    told = {}
    for i in range(1, 61):
        rate.add(4 * S + i * S // 20)
        told[i] = rate.hz(4 * S + i * S // 20)
    assert told[30] == pytest.approx(15) and told[60] == pytest.approx(20)


def test_a_rate_stays_while_nothing_comes_until_its_events_are_old():
    rate = rate_of(*(i / 10 for i in range(11)))
    assert rate.hz(3 * S) == rate.hz(3 * S + S // 2) == pytest.approx(10)
    assert rate.hz(4 * S + 1) == 0


@pytest.mark.parametrize(("apart_s", "hz"), [(0.045, 0), (0.055, 1 / 0.055)])
def test_events_within_a_tenth_of_a_second_are_no_rate(apart_s, hz):
    assert rate_of(1, 1 + apart_s, 1 + 2 * apart_s).hz(2 * S) == pytest.approx(hz)


@pytest.mark.parametrize(("pause_s", "hz"), [(1.5, 3 / 2.5), (1.51, 0)])
def test_a_pause_of_a_second_and_a_half_begins_a_rate_anew(pause_s, hz):
    assert rate_of(0, 0.5, 1, 1 + pause_s).hz(round((1 + pause_s) * S)) == pytest.approx(hz)


def test_a_rate_of_a_thousand_a_second_is_counted_and_a_greater_one_does_not_fill_the_memory():
    rate = rate_of(*(i / 1000 for i in range(3001)))
    assert rate.hz(3 * S) == pytest.approx(1000)
    for i in range(10_000):
        rate.add(3 * S + i * MS // 10)
    assert len(rate._stamps) == 4096


def test_ages_are_those_of_the_last_minute():
    ages = Ages()
    ages.add(0, 100.0)
    for second in range(1, 60):
        ages.add(second * S, 7.0)
    ages.add(60 * S, 7.0)
    assert ages._entries[0] == (0, 100.0)
    ages.add(60 * S + 1, 7.0)
    assert ages._entries[0] == (S, 7.0)


def test_the_95th_percentile_is_a_quarter_of_a_second_old_at_most():
    ages = Ages()
    ages.add(0, 1.0)
    assert ages.p95_ms == 1.0
    ages.add(249 * MS, 101.0)
    assert (ages.p95_ms, ages.last_ms) == (1.0, 101.0)
    ages.add(250 * MS, 101.0)
    assert ages.p95_ms == 101.0


def test_a_minute_of_a_hundred_a_second_is_kept_and_more_does_not_fill_the_memory():
    ages = Ages()
    for i in range(6000):
        ages.add(i * 10 * MS, float(i))
    assert len(ages._entries) == 6000 and ages.p95_ms == pytest.approx(0.95 * 5999)
    for i in range(6000):
        ages.add(60 * S + i, 0.0)
    assert len(ages._entries) == 8192
