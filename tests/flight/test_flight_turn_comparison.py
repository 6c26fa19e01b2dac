"""Turns seen beside turns told: made-up turns whose angles are known at any time."""

import math

import numpy as np
import pytest

from flightdepth.flight import turn_comparison
from flightdepth.flight.signals import Signal
from flightdepth.flight.turn_comparison import LAGS_S, Comparison, ToldTurns
from flightdepth.motion import rotation_from_euler

PAIR_S, PAIRS_HZ, LOG_HZ = 0.1, 15, 100


def angles(at_s):
    """About x, y and z, rad [n, 3]."""
    return np.stack(
        [0.2 * np.sin(1.7 * at_s), 0.3 * np.sin(1.3 * at_s + 1), 0.1 * np.sin(2.1 * at_s + 2)], axis=1
    )


def spans(until_s=12.0, *, from_s=0.0, hz=PAIRS_HZ):
    ends_s = np.arange(from_s + PAIR_S, until_s, 1 / hz)
    return np.stack([ends_s - PAIR_S, ends_s], axis=1)


def turned(spans_s, of=angles):
    """How the camera turned in each pair."""
    return of(spans_s[:, 1]) - of(spans_s[:, 0])


def told(hz=LOG_HZ, *, from_s=-2.0, until_s=14.0, late_s=0.0, of=angles, axes=True):
    """Mean rates between times of a log, told midway between them."""
    at_s = np.arange(from_s, until_s, 1 / hz)
    return Signal((at_s[1:] + at_s[:-1]) / 2 + late_s, np.diff(of(at_s), axis=0) * hz, axes)


def compared(seen, spans_s=None, log=None):
    return ToldTurns(spans() if spans_s is None else spans_s, told() if log is None else log).compared(seen)


@pytest.mark.parametrize("ratio", [0.7, 1.0, 1.3])
def test_what_is_seen_as_told_but_for_its_size(ratio):
    found = compared(ratio * turned(spans()))
    assert found.ratio == pytest.approx(ratio, rel=1e-3)
    assert found.correlation == pytest.approx(1, abs=1e-4)
    assert found.share == pytest.approx(0.02, rel=0.01)  # no better is claimed
    assert found.smoother < 1e-3 and found.drift < 1e-3
    assert found.lag_s == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("late_s", [0.1, -0.07])
def test_a_late_log_is_found_to_be_so(late_s):
    found = compared(turned(spans()), log=told(late_s=late_s))
    assert found.lag_s == pytest.approx(late_s)
    assert found.ratio == pytest.approx(1, rel=1e-3)


@pytest.mark.parametrize("lag", range(31))
def test_only_the_first_and_the_last_lag_may_have_a_better_one_beyond(lag):
    assert Comparison(lag_s=float(LAGS_S[lag])).at_the_end == (lag in (0, 30))


def test_what_flying_adds_evenly_is_taken_off():
    spans_s = spans()
    even = PAIR_S * (0.3 + 0.05 * spans_s.mean(axis=1, keepdims=True)) * [1, -1, 0]
    found = compared(turned(spans_s) + even)
    assert found.ratio == pytest.approx(1, rel=1e-3)
    assert found.correlation == pytest.approx(1, abs=1e-4)


def test_a_turn_about_the_axis_of_view_does_not_count():
    assert compared(turned(spans()) * [1, 1, 2]).ratio == pytest.approx(1, rel=5e-3)


def test_axes_that_are_not_told_are_found():
    turn = rotation_from_euler(0.3, 1.0, 2.0)
    log = told(of=lambda at_s: angles(at_s) @ turn, axes=False)
    found = compared(1.2 * turned(spans()), log=log)
    assert found.ratio == pytest.approx(1.2, rel=1e-3)
    assert found.correlation == pytest.approx(1, abs=1e-4)


def test_axes_that_are_told_are_taken_as_they_are():
    log = told(of=lambda at_s: angles(at_s) @ rotation_from_euler(0.3, 1.0, 2.0))
    assert compared(turned(spans()), log=log).correlation < 0.5


def test_a_ratio_that_grows_is_told_as_drift():
    """From 2 to 2.6: 0.26 of 2.3. What changes slowly is taken off, and some of the drift with it."""
    spans_s = spans()
    growing = 2 + 0.6 * spans_s[:, 1:] / spans_s[-1, 1]
    found = compared(turned(spans_s) * growing)
    assert found.drift == pytest.approx(0.26, rel=0.15)
    assert found.ratio == pytest.approx(2.3, rel=0.05)


def test_pictures_that_turn_more_smoothly_than_the_log_are_told_by_how_much():
    """Means over 0.4 s, as stabilisation makes them: without the second differences' part the turns are as told."""
    spans_s = spans()
    smooth = np.mean([turned(spans_s + step_s) for step_s in np.linspace(-0.2, 0.2, 9)], axis=0)
    found = compared(smooth)
    assert found.smoother > 0.01
    assert found.smoother == pytest.approx(1 / found.ratio - 1, rel=0.1)


def test_the_share_is_the_error_really_made(monkeypatch):
    monkeypatch.setattr(turn_comparison, "LAGS_S", np.zeros(2))
    turns, seen, errors, shares = ToldTurns(spans(), told()), 2 * turned(spans()), [], []
    for seed in range(20):
        found = turns.compared(seen + np.random.default_rng(seed).normal(0, 0.04, seen.shape))
        errors.append(found.ratio / 2 - 1)
        shares.append(math.sqrt(found.share**2 - 0.02**2))
    ratio = np.sqrt(np.mean(np.square(errors))) / np.sqrt(np.mean(np.square(shares)))
    assert 0.7 < ratio < 1.4


def test_what_turns_the_other_way_tells_no_ratio():
    found = compared(-turned(spans()))
    assert (found.ratio, found.share) == (1.0, math.inf)
    assert found.correlation < -0.9


def steady(at_s, rate_deg_s=10.0):
    """About the vertical, at a rate that is a fifth after 6 s."""
    yaw = np.radians(rate_deg_s) * (np.minimum(at_s, 6) + 0.2 * np.maximum(at_s - 6, 0))
    return yaw[:, None] * [0.0, 1.0, 0.0]


def test_it_says_by_how_much_the_camera_turned():
    """10 degrees a second for 6 s; 2 a second are too slow to be told from flying."""
    assert compared(turned(spans(), steady), log=told(of=steady)).turned_deg == pytest.approx(60, rel=0.02)


def test_a_turn_that_is_even_tells_no_ratio():
    even = compared(turned(spans(5.0), steady), spans(5.0), told(of=steady))
    assert (even.ratio, even.share) == (1.0, math.inf)
    assert even.turned_deg == pytest.approx(50, rel=0.02)


@pytest.mark.parametrize(("count", "enough"), [(11, False), (12, True)])
def test_a_turn_has_a_dozen_pairs(count, enough):
    spans_s = spans(hz=10)[:count]
    assert math.isfinite(compared(turned(spans_s), spans_s).share) == enough


@pytest.mark.parametrize(("count", "enough"), [(20, False), (21, True)])
def test_a_turn_has_three_halves_of_a_second_begun(count, enough):
    """Of 21 pairs, 20 a second, the last is a second after the first."""
    spans_s = spans(from_s=1.0, hz=20)[:count]
    assert math.isfinite(compared(turned(spans_s), spans_s).share) == enough


@pytest.mark.parametrize(("turns", "enough"), [(2, False), (3, True)])
def test_short_turns_are_parts_each(turns, enough):
    """Of a dozen pairs in 0.4 s, two seconds apart."""
    spans_s = np.concatenate([spans(from_s=2.0 * k, hz=30)[:12] for k in range(turns)])
    assert math.isfinite(compared(turned(spans_s), spans_s).share) == enough


@pytest.mark.parametrize(("apart_s", "two"), [(0.45, False), (0.55, True)])
def test_turns_half_a_second_apart_are_two_each_with_its_own_flight(apart_s, two):
    """The drone flies past other things in the second one."""
    first = spans(2.0)
    spans_s = np.concatenate([first, spans(4.0, from_s=first[-1, 0] + apart_s)])
    flown = PAIR_S * 0.5 * (spans_s[:, :1] > 2.0) * [1, 1, 0]
    assert (compared(turned(spans_s) + flown, spans_s).correlation > 0.999) == two


def test_a_turn_that_lasts_is_several_each_with_its_own_flight():
    """After each 4 s the drone flies past other things."""
    spans_s = spans(12.0, hz=16)
    number = ((spans_s[:, :1] - spans_s[0, 0]) / (4 + 1 / 16)).astype(int)
    flown = PAIR_S * np.array([0.5, -0.3, 0.8])[number] * [1, 1, 0]
    assert compared(turned(spans_s) + flown, spans_s).correlation > 0.999


@pytest.mark.parametrize(("apart_s", "known"), [(0.2, True), (0.3, False)])
def test_turns_are_known_where_the_log_tells_four_rates_a_second(apart_s, known):
    found = compared(turned(spans()), log=told(1 / apart_s))
    assert (found.turned_deg > 0) == known


def test_pairs_beyond_either_end_of_the_log_do_not_count():
    whole = compared(turned(spans()))
    half = compared(turned(spans()), log=told(from_s=3.0, until_s=9.0))
    assert half.ratio == pytest.approx(1, rel=1e-3)
    assert 0.3 * whole.turned_deg < half.turned_deg < 0.6 * whole.turned_deg


def test_pairs_in_a_gap_of_the_log_do_not_count():
    log = told()
    kept = (log.at_s < 4) | (log.at_s > 6)
    found = compared(turned(spans()), log=Signal(log.at_s[kept], log.values[kept]))
    assert found.ratio == pytest.approx(1, rel=1e-3)
    assert found.correlation == pytest.approx(1, abs=1e-4)


def test_rates_told_twice_or_out_of_order_do_not_count():
    log = told()
    wrong = np.full((3, 3), 9.0)
    at_s = np.insert(log.at_s, [700, 900, 900], [log.at_s[699], log.at_s[100], log.at_s[101]])
    found = compared(turned(spans()), log=Signal(at_s, np.insert(log.values, [700, 900, 900], wrong, axis=0)))
    assert found.ratio == pytest.approx(1, rel=1e-3)


def test_between_five_rates_a_second_angles_run_smoothly():
    """Straight lines between them leave two in a hundred."""
    found = compared(turned(spans()), log=told(5.0))
    assert found.ratio == pytest.approx(1, abs=0.01)
    assert found.correlation > 0.999
