from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightdepth.evaluation.metrics import (
    picture_errors,
    pooled,
    summary,
    travel_angle_deg,
)

maps = st.lists(st.floats(0.5, 200, width=32), min_size=4, max_size=4).map(
    lambda values: np.array(values, np.float32).reshape(2, 2)
)
NOTHING = np.full((2, 2), np.nan, np.float32)
ONES = np.ones((2, 2), np.float32)


@given(truth=maps)
def test_the_truth_has_no_error(truth: np.ndarray) -> None:
    errors = picture_errors(truth, truth)
    assert (errors.l1_m, errors.rmse_m, errors.abs_rel, errors.delta, errors.known) == (0, 0, 0, 1, 1)


@given(a=maps, b=maps)
def test_l1_rmse_and_delta_are_symmetric(a: np.ndarray, b: np.ndarray) -> None:
    there, back = picture_errors(a, b), picture_errors(b, a)
    assert (there.l1_m, there.rmse_m, there.delta) == (back.l1_m, back.rmse_m, back.delta)


@given(a=maps, b=maps)
def test_rmse_is_at_least_l1(a: np.ndarray, b: np.ndarray) -> None:
    errors = picture_errors(a, b)
    assert errors.rmse_m >= errors.l1_m * (1 - 1e-9)


@given(a=maps, b=maps, scale=st.sampled_from([0.5, 2.0, 4.0]))
def test_metres_scale_and_ratios_do_not(a: np.ndarray, b: np.ndarray, scale: float) -> None:
    once, scaled = picture_errors(a, b), picture_errors(a * np.float32(scale), b * np.float32(scale))
    assert scaled.l1_m == pytest.approx(once.l1_m * scale)
    assert scaled.abs_rel == pytest.approx(once.abs_rel)
    assert scaled.delta == once.delta


def test_numbers_by_hand() -> None:
    truth = np.array([[10, 20], [50, np.nan]], np.float32)
    prediction = np.array([[12, 15], [50, 7]], np.float32)
    errors = picture_errors(prediction, truth)
    assert errors.l1_m == pytest.approx(7 / 3)
    assert errors.rmse_m == pytest.approx(math.sqrt(29 / 3))
    assert errors.abs_rel == pytest.approx((0.2 + 0.25) / 3)
    assert errors.delta == pytest.approx(2 / 3)  # 20 / 15 = 1.33
    assert errors.known == 1


def test_1_25_itself_is_outside() -> None:
    assert picture_errors(ONES * 1.25, ONES).delta == 0


def test_an_unknown_prediction_lowers_known_and_nothing_else() -> None:
    prediction = np.array([[3, np.nan], [np.nan, np.nan]], np.float32)
    errors = picture_errors(prediction, ONES)
    assert (errors.l1_m, errors.known) == (2, 0.25)


def test_a_truth_of_0_has_an_error_in_metres_alone() -> None:
    errors = picture_errors(ONES * 3, np.array([[0, 2], [0, 2]], np.float32))
    assert (errors.l1_m, errors.abs_rel, errors.delta) == (2, 0.5, 0)


def test_a_depth_is_known_whether_or_not_its_truth_is_0() -> None:
    assert picture_errors(ONES * 3, np.array([[0, 2], [0, 2]], np.float32)).known == 1


def test_an_infinite_depth_is_none() -> None:
    errors = picture_errors(np.array([[3, np.inf], [3, 3]], np.float32), ONES)
    assert (errors.l1_m, errors.known) == (2, 0.75)


def test_an_infinite_truth_as_of_a_sky_is_none() -> None:
    errors = picture_errors(ONES * 3, np.array([[1, np.inf], [1, 1]], np.float32))
    assert (errors.pixels, errors.l1_m) == (3, 2)


@pytest.mark.parametrize(("prediction", "truth"), [(NOTHING, ONES), (ONES, NOTHING), (NOTHING, NOTHING)])
def test_nothing_valid_is_nan(prediction: np.ndarray, truth: np.ndarray) -> None:
    errors = picture_errors(prediction, truth)
    assert np.isnan([errors.l1_m, errors.rmse_m, errors.abs_rel, errors.delta]).all()


def test_maps_of_two_sizes_are_our_bug() -> None:
    with pytest.raises(ValueError, match="expected a prediction"):
        picture_errors(ONES, np.ones((2, 3), np.float32))


@given(a=maps, b=maps)
def test_depth_bins_add_up_to_the_l1(a: np.ndarray, b: np.ndarray) -> None:
    errors = picture_errors(a, b / 2)  # within the bins
    assert errors.bins[:, 0].sum() == 4
    assert errors.bins[:, 3].sum() / 4 == pytest.approx(errors.l1_m)


def test_the_largest_depth_falls_into_the_last_bin() -> None:
    assert picture_errors(ONES, ONES * 100).bins[:, 0].tolist() == [0, 0, 0, 0, 0, 4]


def test_a_bin_edge_belongs_to_the_bin_above() -> None:
    assert picture_errors(ONES, ONES * 5).bins[:, 0].tolist() == [0, 4, 0, 0, 0, 0]


def test_pooling_takes_means_of_blocks() -> None:
    small = pooled(np.arange(16, dtype=np.float32).reshape(4, 4), (2, 2))
    assert small.tolist() == [[2.5, 4.5], [10.5, 12.5]]


def test_pooling_keeps_the_mean() -> None:
    noise = np.random.default_rng(0).random((64, 128), np.float32)
    assert pooled(noise, (16, 32)).mean() == pytest.approx(noise.mean(), rel=1e-5)


def test_pooling_spreads_unknown_over_its_block_only() -> None:
    holed = np.ones((4, 4), np.float32)
    holed[0, 0] = np.nan
    assert np.isnan(pooled(holed, (2, 2))).tolist() == [[True, False], [False, False]]


def test_pooling_to_a_size_that_does_not_divide_is_our_bug() -> None:
    with pytest.raises(ValueError, match="whole multiple"):
        pooled(np.ones((4, 6), np.float32), (3, 3))


@pytest.mark.parametrize(
    ("displacement", "degrees"),
    [((0, 0, 2), 0), ((1, 0, 0), 90), ((0, -3, 0), 90), ((0, 0, -1), 180), ((1, 0, 1), 45)],
)
def test_angles_of_travel(displacement: tuple[float, ...], degrees: float) -> None:
    assert travel_angle_deg(displacement) == pytest.approx(degrees)


def test_a_set_is_the_mean_over_its_pictures() -> None:
    pictures = [picture_errors(ONES * 3, ONES), picture_errors(ONES * 5, ONES)]
    result = summary(pictures, [(0, 0, 1), (1, 0, 0)])
    assert result["l1_m"] == result["rmse_m"] == 3
    angles = {row["from_deg"]: row["l1_m"] for row in result["travel_angles"] if row["pictures"]}
    assert angles == {0: 2, 90: 4}


def test_a_picture_without_truth_does_not_count() -> None:
    pictures = [picture_errors(ONES * 3, ONES), picture_errors(ONES, NOTHING)]
    assert summary(pictures, [(0, 0, 1), (0, 0, 1)])["l1_m"] == 2


def test_a_picture_without_truth_does_not_spoil_its_angle_of_travel() -> None:
    pictures = [picture_errors(ONES * 3, ONES), picture_errors(ONES, NOTHING)]
    row = summary(pictures, [(0, 0, 1), (0, 0, 1)])["travel_angles"][0]
    assert (row["pictures"], row["l1_m"]) == (2, 2)


def test_straight_back_is_the_last_angle_of_travel() -> None:
    row = summary([picture_errors(ONES * 3, ONES)], [(0, 0, -1)])["travel_angles"][-1]
    assert (row["from_deg"], row["to_deg"], row["pictures"], row["l1_m"]) == (150, 180, 1, 2)


def test_a_depth_bin_tells_how_many_pixels_have_a_depth() -> None:
    half = picture_errors(np.array([[3, np.nan], [3, np.nan]], np.float32), ONES)
    assert summary([half], [(0, 0, 1)])["depth_bins"][0]["pixels"] == 2


def test_depth_bins_pool_the_pixels_of_all_pictures() -> None:
    one = picture_errors(ONES * 3, ONES)
    mixed = picture_errors(np.full((2, 2), 4, np.float32), np.array([[2, 30], [30, 30]], np.float32))
    rows = summary([one, mixed], [(0, 0, 1)] * 2)["depth_bins"]
    assert [row["pixels"] for row in rows] == [5, 0, 0, 3, 0, 0]
    assert rows[0]["l1_m"] == pytest.approx((4 * 2 + 2) / 5)
    assert rows[3]["abs_rel"] == pytest.approx(26 / 30)


def test_an_empty_set_is_nan() -> None:
    assert np.isnan(summary([], [])["l1_m"])
