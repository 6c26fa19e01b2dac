"""Slopes and their deviations, worked out by hand on few fixes."""

import math

import numpy as np
import pytest

from flightdepth.flight.local_regression import line_slopes

# Of the slope through 0, 1, 0, a second apart: squares of residuals 2/3, one degree of freedom, squares of times 2.
BUMP_SIGMA = math.sqrt(1 / 3)


def bumps(*heights):
    """Three fixes a second apart around 1, 101, 201 s ...; the middle one is off a straight line by its height."""
    times_s = np.array([100.0 * k + at for k in range(len(heights)) for at in (0, 1, 2)])
    values = np.array([x for height in heights for x in (0.0, height, 0.0)])
    return times_s, values[:, None], 100.0 * np.arange(len(heights)) + 1


def test_three_fixes_by_hand():
    found = line_slopes(*bumps(1.0), 0.0)
    assert found.slopes.tolist() == [[0.0]]
    assert found.sigma == pytest.approx([BUMP_SIGMA])


def test_two_columns_that_scatter_alike_are_as_sure_as_one():
    times_s, values, at_s = bumps(1.0)
    assert line_slopes(times_s, np.hstack([values, -values]), at_s, 0.0).sigma == pytest.approx([BUMP_SIGMA])


@pytest.mark.parametrize(("step_m", "sigma"), [(0.6, math.sqrt(0.36 / 12 / 2)), (0.0, 0.0)])
def test_a_straight_line_is_as_sure_as_rounding_lets_it_be(step_m, sigma):
    found = line_slopes(*bumps(0.0), step_m)
    assert found.slopes.tolist() == [[0.0]]
    assert found.sigma == pytest.approx([sigma], abs=1e-12)


def test_of_two_fixes_the_slope_is_told_and_the_rest_is_rounding():
    found = line_slopes(np.array([0.0, 1.0]), np.array([[0.0], [3.0]]), np.array([0.5]), 0.6)
    assert found.slopes.tolist() == [[3.0]]
    assert found.sigma == pytest.approx([math.sqrt(0.36 / 12 / 0.5)])


def test_a_window_holds_the_fixes_at_its_ends():
    """Half a second of ten fixes a second: eleven, whatever 0.8 - 0.5 is in binary; their times' squares are 1.1."""
    times_s = np.arange(21) / 10
    found = line_slopes(times_s, np.zeros((21, 1)), times_s[5:16], 0.1)
    assert found.sigma == pytest.approx(math.sqrt(0.01 / 12 / 1.1))


def test_windows_scatter_as_all_of_them_together():
    assert line_slopes(*bumps(1.0, 2.0, 3.0), 0.0).sigma == pytest.approx(BUMP_SIGMA * math.sqrt(14 / 3))


def test_a_window_of_nine_times_the_usual_variance_does_not_stand_out():
    assert line_slopes(*bumps(1.0, 1.0, 1.0, 3.0), 0.0).sigma == pytest.approx(BUMP_SIGMA * math.sqrt(12 / 4))


def test_a_window_of_eleven_times_the_usual_variance_errs_by_itself():
    found = line_slopes(*bumps(1.0, 1.0, 1.0, math.sqrt(11)), 0.0)
    assert found.sigma == pytest.approx(BUMP_SIGMA * np.sqrt([1, 1, 1, 11]))


def test_windows_of_two_fixes_do_not_make_the_others_stand_out():
    """A line through two fixes leaves nothing, and says nothing of how they scatter."""
    times_s = np.array([0.0, 1, 2, 100, 101, 102, 200, 201, 300, 301, 400, 401])
    values = np.array([0.0, 1, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0])
    at_s = np.array([1.0, 101, 200.5, 300.5, 400.5])
    found = line_slopes(times_s, values[:, None], at_s, 0.0)
    assert found.sigma == pytest.approx([BUMP_SIGMA] * 2 + [2 * BUMP_SIGMA] * 3)


def test_what_rounding_may_leave_does_not_stand_out_beside_straight_lines():
    """Coordinates of 0.6 m: three windows happen to be straight, and one is a step off."""
    found = line_slopes(*bumps(0.0, 0.0, 0.0, 0.6), 0.6)
    assert found.sigma == pytest.approx(math.sqrt(0.36 * 2 / 3 / 4 / 2))
