from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from range_oracle import CLAMPED, card

from flightdepth.ranges.fusion import (
    BETA_MAX,
    EPSILON,
    FARTHEST_TOLD_M,
    LEAST_SIGMA,
    LOWER_MARGIN,
    Fusion,
    chance,
    fuse,
    weight,
    within_reach,
)

CARD = card()
betas = arrays(np.float32, (3, 4, 5), elements=st.floats(0, 1, width=32))
both = pytest.mark.parametrize("fusion", get_args(Fusion))


def one(*beta: float) -> np.ndarray:
    """n ranges of a single pixel."""
    return np.array(beta, dtype=np.float32).reshape(-1, 1, 1)


@pytest.mark.parametrize(
    ("beta", "expected"),
    [(0, 0), (0.1, 0), (0.25, 0.5), (0.4, 1), (0.65, 0.5), (0.9, 0), (1, 0)],
)
def test_the_weight_is_the_papers(beta: float, expected: float) -> None:
    np.testing.assert_allclose(weight(np.float32([beta])), [expected], atol=1e-6)


def test_the_papers_fusion_by_hand() -> None:
    # alpha 1000/3; 0.3 m sees beta 0.25 (25 m, f 0.5), 0.1 m sees beta 0.65 (21.67 m, f 0.5).
    depth = fuse(one(0.25, 0.65), np.array([0.3, 0.1]), CARD, fusion="paper").depth_m
    np.testing.assert_allclose(depth, [[(25 + 65 / 3) / 2]], rtol=1e-5)


def test_epsilon_decides_when_every_range_is_off() -> None:
    depth = fuse(one(0.95, 0.05), np.array([0.3, 0.9]), CARD, fusion="paper").depth_m
    np.testing.assert_allclose(depth, [[(95 + 15) / 2]], rtol=1e-5)


@both
@given(arrays(np.float32, (4, 5), elements=st.floats(0.0625, 0.875, width=32)), st.integers(1, 4))
def test_identical_maps_fuse_to_themselves(fusion: Fusion, beta: np.ndarray, n: int) -> None:
    fused = fuse(np.repeat(beta[None], n, axis=0), np.full(n, 0.3), CARD, fusion=fusion)
    np.testing.assert_allclose(fused.depth_m, 100 * beta, rtol=1e-5)


@both
@given(betas, st.floats(0.01, 100))
def test_scaling_the_displacements_scales_the_depth(fusion: Fusion, beta: np.ndarray, scale: float) -> None:
    lengths = np.array([0.1, 0.3, 1.0])
    plain = fuse(beta, lengths, CARD, fusion=fusion)
    scaled = fuse(beta, lengths * scale, CARD, fusion=fusion)
    # A micrometre: below it float32 has no four digits left.
    np.testing.assert_allclose(scaled.depth_m, plain.depth_m * scale, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(scaled.farther_than_m, plain.farther_than_m * scale, rtol=1e-4)
    np.testing.assert_array_equal(scaled.confidence, plain.confidence)


@both
@given(betas, st.permutations(range(3)))
def test_the_order_of_the_ranges_is_of_no_account(fusion: Fusion, beta: np.ndarray, order: list[int]) -> None:
    lengths = np.array([0.1, 0.3, 1.0])
    plain = fuse(beta, lengths, CARD, fusion=fusion)
    other = fuse(beta[order], lengths[order], CARD, fusion=fusion)
    np.testing.assert_allclose(other.depth_m, plain.depth_m, rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(other.confidence, plain.confidence)
    np.testing.assert_array_equal(other.nearer_than_m, plain.nearer_than_m)


@given(betas)
def test_confidence_is_zero_exactly_where_depth_is_unknown(beta: np.ndarray) -> None:
    fused = fuse(beta, np.array([0.1, 0.3, 1.0]), CARD)
    np.testing.assert_array_equal(fused.confidence == 0, np.isnan(fused.depth_m))
    assert fused.confidence.max() <= 1


@given(betas)
def test_depth_lies_between_those_of_the_ranges(beta: np.ndarray) -> None:
    lengths = np.array([0.1, 0.3, 1.0])
    depths = CARD.alpha * lengths[:, None, None] * beta
    fused = fuse(beta, lengths, CARD).depth_m
    known = np.isfinite(fused)
    assert (fused[known] <= depths.max(axis=0)[known] * 1.0001).all()
    assert (fused[known] >= depths.min(axis=0)[known] * 0.9999).all()


def test_full_confidence_at_the_best_output() -> None:
    np.testing.assert_allclose(fuse(one(0.4), np.array([0.3]), CARD).confidence, 1, rtol=1e-6)


def test_least_confidence_just_inside_the_range() -> None:
    confidence = fuse(one(0.05), np.array([0.3]), CARD).confidence
    np.testing.assert_allclose(confidence, EPSILON / (1 + EPSILON), rtol=1e-4)


def test_a_saturated_range_has_no_say() -> None:
    fused = fuse(one(1.0, 0.2), np.array([0.3, 3.0]), CARD)
    np.testing.assert_allclose(fused.depth_m, 200.0, rtol=1e-5)
    assert np.isnan(fused.farther_than_m).all()


def test_all_far_gives_the_largest_lower_bound() -> None:
    fused = fuse(one(1.0, 0.95), np.array([0.3, 3.0]), CARD)
    assert np.isnan(fused.depth_m).all()
    np.testing.assert_allclose(fused.farther_than_m, 1000 * BETA_MAX, rtol=1e-5)
    assert np.isnan(fused.nearer_than_m).all()


def test_all_near_gives_the_smallest_upper_bound() -> None:
    # The clamped network starts at 10 m of 60 m; at 0.5 m of displacement that is 10 m, at 0.1 m 2 m.
    fused = fuse(one(1 / 6, 1 / 6), np.array([0.5, 0.1]), CLAMPED)
    assert np.isnan(fused.depth_m).all()
    np.testing.assert_allclose(fused.nearer_than_m, 2 + 120 * 0.1 * LOWER_MARGIN, rtol=1e-5)
    assert np.isnan(fused.farther_than_m).all()


def test_between_two_ranges_both_bounds_stand() -> None:
    fused = fuse(one(1.0, 1 / 6), np.array([0.1, 5.0]), CLAMPED)
    np.testing.assert_allclose(fused.farther_than_m, 10.8, rtol=1e-5)
    np.testing.assert_allclose(fused.nearer_than_m, 112, rtol=1e-5)


def test_contradicting_bounds_are_no_bounds() -> None:
    fused = fuse(one(1 / 6, 1.0), np.array([0.1, 5.0]), CLAMPED)
    assert np.isnan([fused.depth_m, fused.farther_than_m, fused.nearer_than_m]).all()


def test_what_one_frame_did_not_show_has_no_say() -> None:
    seen = np.array([True, False]).reshape(2, 1, 1)
    fused = fuse(one(0.2, 0.4), np.array([0.3, 0.3]), CARD, seen=seen)
    np.testing.assert_allclose(fused.depth_m, 20.0, rtol=1e-5)


def test_what_no_frame_showed_is_unknown_without_a_bound() -> None:
    fused = fuse(one(1.0), np.array([0.3]), CARD, seen=np.zeros((1, 1, 1), dtype=np.bool_))
    assert np.isnan([fused.depth_m, fused.farther_than_m, fused.nearer_than_m]).all()


@both
def test_an_output_that_is_no_number_is_no_measurement(fusion: Fusion) -> None:
    fused = fuse(one(np.nan, 0.2), np.array([0.3, 0.3]), CARD, fusion=fusion)
    np.testing.assert_allclose(fused.depth_m, 20.0, rtol=1e-5)


def test_an_output_that_is_no_number_is_none_where_both_frames_show_the_pixel_either() -> None:
    fused = fuse(one(np.nan, 0.2), np.array([0.3, 0.3]), CARD, seen=np.ones((2, 1, 1), np.bool_))
    np.testing.assert_allclose(fused.depth_m, 20.0, rtol=1e-5)


def test_sigma_is_the_weighted_mean() -> None:
    fused = fuse(one(0.25, 0.65), np.array([0.3, 0.1]), CARD, fusion="paper", sigma_m=one(1.0, 3.0))
    np.testing.assert_allclose(fused.sigma_m, 2.0, rtol=1e-5)


def test_an_answer_that_ignores_the_displacement_is_not_believed():
    """The network says the same beta at 0.3 m and at 3 m: one depth cannot look like that."""
    fused = fuse(one(0.5, 0.5), np.array([0.3, 3.0]), CARD)
    assert np.isnan(fused.depth_m).all()
    assert (fused.confidence == 0).all()
    assert np.isnan(fused.farther_than_m).all()
    assert np.isnan(fused.nearer_than_m).all()


def test_ranges_that_differ_by_less_than_the_tolerance_are_fused():
    fused = fuse(one(0.6, 0.3), np.array([0.3, 0.45]), CARD)  # 60 m and 45 m
    assert 45 < fused.depth_m.item() < 60


def test_the_papers_fusion_believes_contradictions():
    assert np.isfinite(fuse(one(0.5, 0.5), np.array([0.3, 3.0]), CARD, fusion="paper").depth_m).all()


def test_a_bound_that_contradicts_a_measurement_voids_it():
    fused = fuse(one(0.95, 0.2), np.array([3.0, 0.3]), CARD)  # at least 900 m, and 20 m
    assert np.isnan(fused.depth_m).all()


def fused_with_sigma(beta, sigma_m, displacements=(0.1, 0.3)):
    sigma = np.array(sigma_m, dtype=np.float32).reshape(-1, 1, 1)
    return fuse(one(*beta), np.array(displacements), CARD, sigma_m=sigma)


def test_ranges_with_error_bars_weigh_by_them() -> None:
    # alpha 1000/3: 20 m by both ranges but for 2 m; sigma 1 m and 2 m weigh 4 to 1.
    found = fused_with_sigma((0.6, 0.22), (1.0, 2.0))
    np.testing.assert_allclose(found.depth_m, [[(4 * 20 + 22) / 5]], rtol=1e-5)
    np.testing.assert_allclose(found.sigma_m, [[(4 * 1 + 2) / 5]], rtol=1e-5)


def test_a_range_that_knows_nothing_has_no_say() -> None:
    found = fused_with_sigma((0.6, 0.22), (25.0, 2.0))
    np.testing.assert_allclose(found.depth_m, [[22.0]], rtol=1e-5)


def test_a_range_that_knows_nothing_contradicts_nobody() -> None:
    found = fused_with_sigma((0.6, 0.8), (1.0, 90.0))
    np.testing.assert_allclose(found.depth_m, [[20.0]], rtol=1e-5)


def test_where_no_range_knows_anything_depth_is_unknown() -> None:
    found = fused_with_sigma((0.6, 0.22), (25.0, 30.0))
    assert np.isnan(found.depth_m).all()
    assert found.confidence == 0


def test_a_bound_needs_no_small_error_bar() -> None:
    """Of sky a network knows no more than that it is far."""
    found = fused_with_sigma((0.95, 0.95), (90.0, 250.0))
    np.testing.assert_allclose(found.farther_than_m, [[90.0]], rtol=1e-5)


def test_an_error_bar_of_nothing_does_no_harm() -> None:
    found = fused_with_sigma((0.0, 0.3), (0.0, 3.0), displacements=(0.3, 0.1))
    np.testing.assert_allclose(found.nearer_than_m, [[np.nan]])
    np.testing.assert_allclose(found.depth_m, [[np.nan]])
    found = fused_with_sigma((0.0, 0.02), (0.0, 0.0))
    np.testing.assert_allclose(found.nearer_than_m, [[100 / 3 * LOWER_MARGIN]], rtol=1e-5)


@given(st.floats(0.02, 0.39))
def test_confidence_is_the_chance_to_be_right_within_a_quarter(share: float) -> None:
    """Against Laplace's distribution, drawn."""
    found = fused_with_sigma((0.6, 0.2), (20 * share, 20 * share))
    scale = 20 * share / np.quantile(np.abs(np.random.default_rng(0).laplace(0, 1, 200_000)), 0.6827)
    errors = np.abs(np.random.default_rng(1).laplace(0, scale, 200_000))
    assert float(found.confidence[0, 0]) == pytest.approx((errors < 5).mean(), abs=0.01)


def test_the_papers_fusion_ignores_error_bars() -> None:
    sigma = np.ones((2, 1, 1), np.float32)
    plain, told = (
        fuse(one(0.6, 0.22), np.array([0.1, 0.3]), CARD, fusion="paper", sigma_m=s) for s in (None, sigma)
    )
    assert plain.depth_m == told.depth_m


def test_with_an_error_bar_confidence_is_a_chance_in_the_papers_fusion_too() -> None:
    sigma = np.array([0.5, 2.0], np.float32)[:, None, None]
    told = fuse(one(0.6, 0.22), np.array([0.1, 0.3]), CARD, fusion="paper", sigma_m=sigma)
    assert told.confidence == chance(told.depth_m, told.sigma_m)


@given(st.floats(0.05, 0.39))
def test_sigma_can_be_read_from_the_confidence(share: float) -> None:
    """As docs/files.md says."""
    found = fused_with_sigma((0.6, 0.2), (20 * share, 20 * share))
    sigma_m = -0.287 * found.depth_m / np.log(1 - np.clip(found.confidence, 0, 0.999))
    np.testing.assert_allclose(sigma_m, found.sigma_m, rtol=1e-3)


def test_an_output_just_above_the_lower_end_is_no_measurement_where_a_shorter_pair_saw_nearer() -> None:
    """Clamped at 10 of 60 m: 1.25 m at 0.025 m, and 24 m at 1 m, where 20 m is the least that can be said."""
    fused = fuse(one(5 / 12, 0.2), np.array([0.025, 1.0]), CLAMPED)
    np.testing.assert_allclose(fused.depth_m, 1.25, rtol=1e-5)


@pytest.mark.parametrize("displacements_m", [(1.0,), (1.0, 1.0), (1.0, 1.1)])
def test_an_output_just_above_the_lower_end_is_a_measurement_where_none_did(displacements_m) -> None:
    beta = one(*(0.2 / np.array(displacements_m)))
    np.testing.assert_allclose(fuse(beta, np.array(displacements_m), CLAMPED).depth_m, 24, rtol=1e-5)


@given(st.floats(0.27, 0.87))
def test_an_answer_well_inside_the_range_still_contradicts(beta: float) -> None:
    fused = fuse(one(0.3, beta), np.array([0.025, 1.0]), CLAMPED)
    assert np.isnan(fused.depth_m).all()


def test_no_depth_is_better_known_than_a_hundredth() -> None:
    """Whatever the network says: the weights heeded that, and what was told did not."""
    found = fused_with_sigma((0.6, 0.2), (0.001, 0.001))
    np.testing.assert_allclose(found.sigma_m, LEAST_SIGMA * found.depth_m, rtol=1e-5)


def test_what_lies_beyond_reach_is_a_bound() -> None:
    """Sky that seemed to move had a depth of a kilometre."""
    fused = fuse(
        np.float32([[[0.1, 0.5, 0.95]]]), np.array([6.0]), CARD
    )  # alpha 1000 / 3: 200 m, 1000 m, a bound
    cut = within_reach(fused)
    np.testing.assert_allclose(cut.depth_m, [[200, np.nan, np.nan]], rtol=1e-5)
    np.testing.assert_allclose(cut.farther_than_m, [[np.nan, FARTHEST_TOLD_M, 1800]], rtol=1e-5)
    assert cut.confidence[0, 1] == 0
    assert cut.confidence[0, 0] == fused.confidence[0, 0]


def test_what_is_cut_has_no_error_bar() -> None:
    fused = fuse(
        np.float32([[[0.1, 0.5]]]), np.array([6.0]), CARD, sigma_m=np.full((1, 1, 2), 10, np.float32)
    )
    np.testing.assert_allclose(within_reach(fused).sigma_m, [[10, np.nan]])
