"""Positions that jitter: how much, and what is left of it."""

import numpy as np
import pytest

from flightdepth.flight.metric_positions import samples_along
from flightdepth.flight.position_noise import jitter_m, jumps, parabolas, smoothed
from flightdepth.flight.records import PositionSample


def lively(rate_hz, seconds=20.0, speed=4.0, uneven=0.1):
    """Times that are not quite even, and a flight that curves, speeds up and slows down."""
    rng = np.random.default_rng(0)
    times_s = np.arange(0, seconds, 1 / rate_hz)
    times_s += rng.uniform(-uneven, uneven, len(times_s)) / rate_hz
    north = speed * times_s + 0.3 * speed * np.sin(1.3 * times_s)
    return times_s, np.stack(
        [north, 0.5 * speed * np.sin(0.9 * times_s + 1), 0.2 * speed * np.cos(times_s)], 1
    )


def jittered(ned, noise_m, seed=1):
    return ned + noise_m * np.random.default_rng(seed).standard_normal(ned.shape)


def off_m(found, ned):
    return float(np.sqrt(np.mean((found - ned) ** 2)))


@pytest.mark.parametrize("rate_hz", [10, 30, 100])
@pytest.mark.parametrize("noise_m", [0.003, 0.03])
def test_the_jitter_is_told(rate_hz, noise_m):
    times_s, ned = lively(rate_hz)
    assert jitter_m(times_s, jittered(ned, noise_m)) == pytest.approx(noise_m, rel=0.15)


def test_of_a_cubic_flight_that_does_not_jitter_none_is_told():
    times_s = np.sort(np.random.default_rng(2).uniform(0, 10, 50))
    ned = np.stack([times_s**3, 3 * times_s**2 - times_s, 0 * times_s], axis=1)
    assert jitter_m(times_s, ned) < 1e-9


def test_a_jump_is_no_jitter():
    times_s, ned = lively(30)
    ned = jittered(ned, 0.01)
    ned[300:] += 5.0
    assert jitter_m(times_s, ned) == pytest.approx(0.01, rel=0.15)


@pytest.mark.parametrize(
    ("rate_hz", "noise_m", "most_left"),
    [(10, 0.01, 0.65), (30, 0.01, 0.4), (100, 0.003, 0.25), (30, 0.1, 0.4)],
)
def test_smoothed_positions_are_nearer_to_the_flight(rate_hz, noise_m, most_left):
    times_s, ned = lively(rate_hz)
    found = smoothed(times_s, jittered(ned, noise_m))
    assert off_m(found, ned) < most_left * noise_m


@pytest.mark.parametrize("rate_hz", [1, 5, 30, 200])
def test_positions_that_do_not_jitter_stay_as_they_are(rate_hz):
    times_s, ned = lively(rate_hz)
    assert smoothed(times_s, ned) is ned


def test_positions_that_come_seldom_stay_as_they_are():
    times_s, ned = lively(2)
    ned = jittered(ned, 0.02)
    assert smoothed(times_s, ned) is ned


def test_positions_of_damaged_times_stay_as_they_are():
    """Of 20,000 within a fifth of a second each window held all: 38 s, and 1.4 GB."""
    times_s = np.arange(20_000) * 1e-5
    ned = jittered(np.zeros((20_000, 3)), 0.01)
    assert smoothed(times_s, ned) is ned


@pytest.mark.parametrize("count", [0, 1, 4])
def test_few_positions_stay_as_they_are(count):
    times_s, ned = lively(30)
    assert smoothed(times_s[:count], ned[:count]).shape == (count, 3)


def test_a_drone_that_shakes_is_not_smoothed_away():
    """By 5 cm twice a second, told to a millimetre 30 times: longer windows would take half of it for jitter."""
    times_s, ned = lively(30, uneven=0.0)
    ned = ned + 0.05 * np.sin(2 * np.pi * 2 * times_s)[:, None]
    assert off_m(smoothed(times_s, jittered(ned, 0.001)), ned) < 0.0011
    assert off_m(smoothed(times_s, jittered(ned, 0.01)), ned) < 0.006


def test_nothing_is_drawn_across_a_jump():
    times_s, ned = lively(30)
    ned[300:] += [3.0, -2.0, 0.5]
    noisy = jittered(ned, 0.01)
    assert jumps(times_s, noisy, 0.01).tolist() == [299]
    found = smoothed(times_s, noisy)
    assert np.abs(found - ned).max() < 0.05
    assert off_m(found[290:310], ned[290:310]) < 0.01


def test_a_flight_that_brakes_hard_does_not_jump():
    times_s = np.arange(0, 4, 0.1)
    north = np.where(
        times_s < 2, 8 * times_s, 16 + 8 * (times_s - 2) - 4 * (times_s - 2) ** 2 * (times_s < 3)
    )
    assert not len(jumps(times_s[:30], np.stack([north, 0 * north, 0 * north], 1)[:30], 0.001))


def test_a_parabola_passes_through_what_is_one():
    """Its leverage by hand: of five even places (0, 1, 2 beside it) the middle one has 17 / 35 in its own value."""
    times_s = np.arange(9) * 0.1
    ned = np.stack([times_s**2, 2 - 3 * times_s, 4 * times_s**2 + times_s], axis=1)
    drawn, leverage, count = parabolas(times_s, ned, np.array([0, 4]), 0.2)
    assert drawn == pytest.approx(ned[[0, 4]], abs=1e-9)
    assert count.tolist() == [3, 5]
    assert leverage == pytest.approx([1.0, 17 / 35])


def test_a_logs_positions_and_velocities_are_smoothed():
    times_s, ned = lively(30, uneven=0.0)
    samples = samples_along(np.round(times_s * 1e9).astype(np.int64), jittered(ned, 0.02))
    positions = np.array([each.position_ned for each in samples if isinstance(each, PositionSample)])
    assert off_m(positions, ned) < 0.4 * 0.02
