"""What a log tells over time, for comparison with the pictures."""

import numpy as np
import pytest

from flightdepth.flight.records import GyroscopeTrack, Telemetry, VelocitySample
from flightdepth.flight.signals import attitude_rates, turn_signal


def turned_at(rate_hz, rates):
    stamps_ns = np.round(np.arange(len(rates)) * 1e9 / rate_hz).astype(np.int64)
    track = GyroscopeTrack(stamps_ns, np.repeat(rates[:, None], 3, axis=1))
    return turn_signal(Telemetry("log", (VelocitySample(0, np.ones(3)),), gyroscope=track))


@pytest.mark.parametrize("rate_hz", [25, 50, 75, 100, 200, 400, 1000])
def test_a_gyroscope_turns_at_the_time_that_it_says(rate_hz):
    """Of 50 samples a second it turned 10 ms late, of 200 2.5 ms: a mean of an even number lies beside them."""
    signal = turned_at(rate_hz, np.arange(2 * rate_hz) / rate_hz)
    inner = slice(rate_hz // 10, -rate_hz // 10)
    assert signal.values[inner] == pytest.approx(np.repeat(signal.at_s[inner, None], 3, axis=1), abs=1e-9)


def test_a_gyroscope_of_fewer_samples_than_a_mean_takes_is_told_as_it_is():
    assert turned_at(1000, np.arange(5.0)).values[:, 0] == pytest.approx(np.arange(5.0))


@pytest.mark.parametrize(
    ("step_deg", "rate_hz"), [(3.3, 30), (20, 5), (90, 1), (120, 1), (1e-9, 10), (0, 10)]
)
def test_an_attitude_s_turn_is_an_angle_however_large_the_step(step_deg, rate_hz):
    """It was the sine: of 100 degrees/s told 5 times a second 98 were left."""
    axis, half_rad = np.array([2.0, -1.0, 2.0]) / 3, np.radians(step_deg) / 2 * np.arange(5)
    turned = np.c_[np.cos(half_rad), np.sin(half_rad)[:, None] * axis]
    signal = attitude_rates(np.arange(5) * 10**9 // rate_hz, turned)
    expected = np.tile(np.radians(step_deg) * rate_hz * axis, (4, 1))
    np.testing.assert_allclose(signal.values, expected, rtol=1e-6, atol=1e-15)
