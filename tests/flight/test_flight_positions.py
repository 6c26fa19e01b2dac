from collections import Counter

import numpy as np
import pytest

from flightdepth.flight.local_regression import half_window_s, line_slopes
from flightdepth.flight.places import SEA_LEVEL
from flightdepth.flight.positions import (
    JUMPING,
    decimal_step,
    filled,
    fixes,
    local_ned,
    on_earth,
    place_track,
    torn,
    velocities,
    velocities_by_places,
    without_jumps,
)
from tests_recordings import place


def flight(velocity, *, rate=10.0, seconds=20.0, noise=0.0, rounding=0.0, seed=0):
    rng = np.random.default_rng(seed)
    times_s = np.arange(int(seconds * rate)) / rate
    ned = times_s[:, None] * np.array(velocity) + rng.normal(0, noise, (len(times_s), 3))
    ned = np.round(ned / rounding) * rounding if rounding else ned
    return np.round(times_s * 1e9).astype(np.int64), ned


def test_a_degree_of_latitude_at_the_equator_and_at_45_degrees_has_the_known_length():
    # 110,574 m and 111,132 m: the tables of WGS 84.
    for latitude, metres in ((0.0, 110574.3), (45.0, 111131.8)):
        near = np.array([latitude, latitude + 0.001])
        north = local_ned(np.c_[near, np.zeros(2)], np.zeros(2))[1, 0]
        assert north == pytest.approx(metres / 1000, rel=1e-4)


def test_north_east_and_up_have_their_signs():
    ned = local_ned(np.array([(48.0, 2.0), (48.001, 2.001)]), np.array([10.0, 30.0]))
    assert ned[1, 0] > 0
    assert ned[1, 1] > 0
    assert ned[1, 2] - ned[0, 2] == -20


def test_what_is_a_place_on_earth():
    there = [(90, 180), (-90, -180), (0, 5), (5, 0)]
    nowhere = [(90.1, 5), (-90.1, 5), (5, 180.1), (5, -180.1), (0, 0), (np.nan, 5), (5, np.nan)]
    assert on_earth(np.array([*there, *nowhere])).tolist() == [True] * 4 + [False] * 7


def test_the_date_line_is_crossed():
    ned = local_ned(np.array([(0, 179.999), (0, -179.999)]), np.zeros(2))
    assert ned[1, 1] == pytest.approx(0.002 * 111319.49, rel=1e-6)


def test_positions_and_back():
    latitude, longitude = place(np.array([0.0, 300.0]), np.array([0.0, -200.0]))
    assert np.allclose(local_ned(np.c_[latitude, longitude], np.zeros(2))[1], (300, -200, 0), atol=0.05)


@pytest.mark.parametrize("rate", [1.0, 5.0, 10.0, 30.0])
def test_a_constant_velocity_comes_back(rate):
    stamps, ned = flight((3.0, -4.0, 0.5), rate=rate)
    found = velocities(stamps, ned, steps_m=(0, 0))
    assert np.allclose(found.velocity_ned, (3.0, -4.0, 0.5), atol=1e-9)


def test_repeated_positions_are_not_fixes():
    times_s = np.arange(60) / 30
    values = np.floor(times_s * 5 + 1e-9)[:, None] * 0.7
    assert fixes(times_s, values).tolist() == list(range(0, 60, 6))


def test_a_hovering_drone_has_fixes_too():
    times_s = np.arange(300) / 30
    moving = np.floor(times_s * 5 + 1e-9) * 0.7
    values = np.minimum(moving, moving[100])[:, None]  # stands still after 3.3 s
    found = fixes(times_s, values)
    assert np.diff(times_s[found]).max() <= 0.4
    stamps = (times_s * 1e9).astype(np.int64)
    hover = velocities(stamps, np.repeat(values, 3, 1), steps_m=(0.1, 0.1)).velocity_ned[-1]
    assert np.allclose(hover, 0, atol=1e-12)


def test_between_seldom_fixes_velocities_are_told_where_there_are_positions():
    times_s = np.array([0, 1, 2, 3, 4, 5, 6, 7, 8, 20, 21], dtype=float)
    found = filled(times_s, np.array([0, 1, 3, 8, 9, 10]))
    assert found.tolist() == list(range(11))  # none in the gap of 12 s
    often_s = np.arange(300) / 30
    every_second = np.arange(0, 300, 30)
    assert filled(often_s, every_second).tolist() == every_second.tolist()


@pytest.mark.parametrize(("noise", "rounding"), [(0.3, 0.0), (0.0, 0.11), (0.2, 0.11), (0.02, 1.1)])
def test_sigma_is_the_error_really_made(noise, rounding):
    errors, sigmas = [], []
    for seed in range(20):
        stamps, ned = flight((6.0, 2.0, 0.0), noise=noise, rounding=rounding, seed=seed)
        found = velocities(stamps, ned, steps_m=(rounding, rounding))
        errors.append(found.velocity_ned[:, :2] - (6.0, 2.0))
        sigmas.append(found.sigma)
    ratio = np.sqrt(np.mean(np.concatenate(errors) ** 2)) / np.sqrt(np.mean(np.concatenate(sigmas) ** 2))
    assert 0.35 < ratio < 1.3  # coarse steps are seen at the instant they happen, so better than rounding


def test_half_a_window_by_hand():
    """Half a second; one period and a half; at most 5 s; or by rounding: (3 T q^2 / (24 * 0.2^2))^(1/3)."""
    expected = {(10, 0.0): 0.5, (1, 0.0): 1.5, (0.1, 0.0): 5.0, (10, 1.0): 0.678604, (10, 99.0): 5.0}
    found = {(hz, step_m): half_window_s(np.arange(20) / hz, step_m) for hz, step_m in expected}
    assert found == pytest.approx(expected, rel=1e-5)
    assert half_window_s(np.zeros(1), 0.0) == 1.5  # of one fix, which may come once a second


def test_coarse_positions_get_a_longer_window():
    stamps, ned = flight((10.0, 0.0, 0.0), rate=1.0, seconds=60, rounding=11.0)
    errors = velocities(stamps, ned, steps_m=(11.0, 0.1)).velocity_ned[5:-5, 0] - 10
    assert np.abs(errors).max() < 1.5  # neighbours alone differ by 11 m/s


def test_a_jump_is_left_out_and_a_fast_flight_is_not():
    _, ned = flight((30.0, 0.0, 0.0), rate=1.0)
    assert without_jumps(ned).all()
    ned[7, 1] += 500
    assert np.flatnonzero(~without_jumps(ned)).tolist() == [7]


@pytest.mark.parametrize("count", [4, 5, 20])
@pytest.mark.parametrize("wrong", [0, 1, 2, -2, -1])
def test_a_jump_is_found_at_either_end_too(count, wrong):
    _, ned = flight((30.0, -10.0, 2.0), rate=1.0, seconds=count)
    assert without_jumps(ned).all()
    ned[wrong, 0] += 500
    assert np.flatnonzero(~without_jumps(ned)).tolist() == [wrong % count]


@pytest.mark.parametrize("seed", [0, 1])
def test_positions_that_all_jump_tell_no_way(seed):
    stamps = np.arange(12) * 10**9
    places = np.random.default_rng(seed).uniform((-60, -170), (60, 170), (12, 2))
    counts = Counter()
    assert not len(velocities_by_places(stamps, places, np.zeros(12), counts))
    assert counts[JUMPING] >= 11
    assert place_track(stamps, places, np.zeros(12), SEA_LEVEL, counts) is None


def test_of_few_positions_none_jumps_for_sure():
    _, ned = flight((30.0, 0.0, 0.0), rate=1.0, seconds=3)
    assert all(without_jumps(ned[:count]).all() for count in (1, 2, 3))


def test_a_wrong_fix_spoils_the_sigma_of_its_surroundings_only():
    """60 m are not sure to be a jump, and are 40 times what such a receiver scatters in five minutes."""
    stamps, ned = flight((5.0, 0.0, 0.0), seconds=300, noise=0.1)
    right = velocities(stamps, ned, steps_m=(0.01, 0.01))
    ned[1500, 0] += 60
    found = velocities(stamps, ned, steps_m=(0.01, 0.01))
    near = np.abs(found.stamps_ns - stamps[1500]) <= 0.6e9
    assert found.sigma[~near] == pytest.approx(right.sigma[~near], rel=0.01)
    errors = np.abs(found.velocity_ned - (5, 0, 0)).max(axis=1)
    assert errors[near].max() > 5
    assert (found.sigma[errors > 1] > 5).all()


@pytest.mark.parametrize(("step_m", "is_torn"), [(29.0, False), (31.0, True)])
def test_windows_that_hold_a_step_faster_than_any_drone_are_torn(step_m, is_torn):
    """Fixes 0.2 s apart, so 30 m are 150 m/s; windows of half a second to either side."""
    times_s = np.arange(50) * 0.2
    places = np.where(times_s[:, None] > 5.1, step_m, 0.0) * [1, 0]
    found = torn(times_s, places, times_s, 0.0)
    assert np.flatnonzero(found).tolist() == ([24, 25, 26, 27] if is_torn else [])


def test_rounding_alone_tears_no_window():
    """Latitude and longitude may step by their rounding one picture after the other."""
    times_s, places = np.arange(20) / 30, np.zeros((20, 2))
    places[10:, 0] = places[11:, 1] = 11.0
    assert not torn(times_s, places, times_s, 11.0).any()


def test_slopes_of_one_fix_are_unknown():
    assert np.isnan(line_slopes(np.zeros(1), np.zeros((1, 2)), np.zeros(1), 0.1).slopes).all()


def test_the_step_of_rounded_numbers_is_found():
    assert decimal_step(np.array([48.7, 48.700001])) == pytest.approx(1e-6)
    assert decimal_step(np.array([50.0, 51.5])) == pytest.approx(0.1)
    assert decimal_step(np.array([np.pi])) == 1e-9
