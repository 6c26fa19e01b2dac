"""The figures of an error bar, on errors whose spread is known."""

import numpy as np
import pytest

from flightdepth.evaluation.spread import growing_scale, left_over, sigma_scale, spread_summary


@pytest.fixture(scope="module")
def honest():
    """Normal errors with known deviations from 0.1 to 10 m."""
    rng = np.random.default_rng(0)
    sigma = np.exp(rng.uniform(np.log(0.1), np.log(10), 100_000))
    return np.abs(rng.normal(0, sigma)), sigma


def test_normal_errors_lie_inside_as_a_table_says(honest):
    found = spread_summary(*honest)
    assert found["inside_one"] == pytest.approx(0.683, abs=0.005)
    assert found["inside_two"] == pytest.approx(0.954, abs=0.005)
    assert all(group["inside_one"] == pytest.approx(0.683, abs=0.02) for group in found["by_sigma"])


def test_errors_grow_with_an_honest_sigma(honest):
    rows = spread_summary(*honest)["by_sigma"]
    ratio = [row["l1_m"] / row["sigma_m"] for row in rows]
    assert ratio == pytest.approx([np.sqrt(2 / np.pi)] * 10, rel=0.05)


def test_a_sigma_that_knows_nothing_orders_nothing(honest):
    error, sigma = honest
    shuffled = np.random.default_rng(1).permutation(sigma)
    found = spread_summary(error, shuffled)
    assert found["sparsification"]["by_sigma"] == pytest.approx([1.0] * 10, abs=0.05)
    assert found["area"] > 2 * spread_summary(error, sigma)["area"]


def test_the_error_itself_is_the_best_order(honest):
    error, sigma = honest
    assert spread_summary(error, error)["area"] == 0
    assert spread_summary(error, sigma)["area"] > 0


def test_groups_rise_with_sigma_and_tell_means():
    """Sigma 29^2 + 1 down to 1, three a group."""
    sigma = np.arange(29.0, -1, -1) ** 2 + 1
    rows = spread_summary(2 * sigma, sigma)["by_sigma"]
    assert [row["sigma_m"] for row in rows] == sorted(row["sigma_m"] for row in rows)
    assert (rows[0]["sigma_m"], rows[0]["l1_m"]) == pytest.approx((8 / 3, 16 / 3))  # of 1, 2 and 5


def test_the_area_by_hand():
    """One of ten errs, and has the least sigma: n pixels that are left have 10 / n of the mean error, or none of it."""
    error = np.array([1.0] + [0.0] * 9)
    found = spread_summary(error, 1 - error + 0.1)
    assert found["area"] == pytest.approx(1 / 2 + sum(1 / n for n in range(2, 10)))


def test_left_over_by_hand():
    error = np.array([4.0, 1.0, 2.0, 3.0, 0.0, 5.0, 6.0, 7.0, 8.0, 9.0])
    assert left_over(error, error)[5] == pytest.approx(2.0 / 4.5)
    assert left_over(error, -error)[5] == pytest.approx(7.0 / 4.5)


def test_of_few_errors_one_is_left():
    assert left_over(np.array([1.0, 2.0, 6.0]), np.array([1.0, 2.0, 3.0]))[-1] == pytest.approx(1 / 3)


def test_errors_of_nothing_ask_for_no_scale():
    """0 would have made every bar 0."""
    assert sigma_scale(np.zeros(4), np.ones(4)) == 1.0


def test_pixels_that_tell_nothing_do_not_move_the_growth():
    rng = np.random.default_rng(3)
    sigma, far = np.exp(rng.normal(size=2000)), rng.choice([0.0, 0.5], 2000)
    error = np.abs(rng.normal(0, sigma)) * np.exp(far)
    told = growing_scale(error, sigma, far)
    assert told[1] > 0.5
    nothing = (np.append(values, last) for values, last in ((error, np.nan), (sigma, 1.0), (far, 0.5)))
    assert growing_scale(*nothing) == pytest.approx(told)


@pytest.mark.parametrize("factor", [0.5, 1.0, 3.0])
def test_scaled_sigmas_hold_the_share(honest, factor):
    """Fitted on one half of the errors, tested on the other."""
    error, sigma = honest[0], factor * honest[1]
    scale = sigma_scale(error[::2], sigma[::2])
    assert scale == pytest.approx(1 / factor, rel=0.02)
    assert spread_summary(error[1::2], scale * sigma[1::2])["inside_one"] == pytest.approx(0.683, abs=0.01)


@pytest.mark.parametrize("growth", [0.0, 0.35, 1.2])
def test_a_scale_that_grows_is_found(honest, growth):
    """Pictures of which between nothing and two thirds is far, whose errors are larger by as much."""
    error, sigma = honest
    far = np.random.default_rng(2).choice([0.0, 0.1, 0.4, 0.66], len(error))
    scale, found = growing_scale(error * np.exp(growth * far), 2 * sigma, far)
    assert found == pytest.approx(growth, abs=0.051)
    assert scale == pytest.approx(0.5, rel=0.03)
    assert growing_scale(error, sigma, np.full_like(far, 0.3)) == (sigma_scale(error, sigma), 0.0)


def test_pixels_that_tell_nothing_do_not_move_the_scale(honest):
    error, sigma = (
        np.concatenate([values, nothing]) for values, nothing in zip(honest, NOTHING, strict=True)
    )
    assert sigma_scale(error, sigma) == pytest.approx(sigma_scale(*honest), rel=1e-9)
    assert sigma_scale(*NOTHING) == 1.0


NOTHING = np.array([np.nan, 1.0, 1.0]), np.array([1.0, np.nan, 0.0])
