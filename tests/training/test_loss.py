"""The multi-scale L1 loss against plain numpy, and its forgiving ends."""

import numpy as np
import pytest
import torch
from training_runs import small_recipe

from flightdepth.training.loss import SCALE_WEIGHTS, inverse_error_m, loss_m, multi_scale_l1, pinball

WEIGHTS = (0.32, 0.08, 0.02, 0.01, 0.005)


def five_scales(seed=0):
    rng = np.random.default_rng(seed)
    depths = [rng.uniform(0, 100, (2, 64 // s, 128 // s)).astype(np.float32) for s in (4, 8, 16, 32, 64)]
    return depths, rng.uniform(0, 100, (2, 64, 128)).astype(np.float32)


def reference(depths, target):
    total = 0.0
    for weight, depth in zip(WEIGHTS, depths, strict=True):
        batch, h, w = depth.shape
        blocks = target.reshape(batch, h, target.shape[1] // h, w, target.shape[2] // w)
        total += weight * np.abs(depth - blocks.mean(axis=(2, 4))).mean()
    return total


def loss_of(depths, target, **ends):
    return float(multi_scale_l1([torch.from_numpy(d) for d in depths], torch.from_numpy(target), **ends))


def test_five_scales_against_numpy():
    depths, target = five_scales()
    assert loss_of(depths, target) == pytest.approx(reference(depths, target), rel=1e-5)


def test_ends_far_away_change_nothing():
    depths, target = five_scales()
    assert loss_of(depths, target, lower=-1e9, upper=1e9) == loss_of(depths, target)


def test_the_averaged_target_costs_nothing():
    target = np.full((1, 64, 64), 7, np.float32)
    target[:, ::2] = 9
    depths = [np.full((1, 64 // s, 64 // s), 8, np.float32) for s in (4, 8, 16, 32, 64)]
    assert loss_of(depths, target) == pytest.approx(0)


def gradient_at_the_finest(depth_m, target_m):
    """Gradient of one pixel of the finest scale, as a share of its weight; range 10..60 m."""
    depths = [torch.full((1, 64 // s, 64 // s), depth_m, requires_grad=True) for s in (4, 8, 16, 32, 64)]
    multi_scale_l1(depths, torch.full((1, 64, 64), target_m), lower=10, upper=60).backward()
    return float(depths[0].grad[0, 0, 0]) * depths[0].numel() / WEIGHTS[0]


@pytest.mark.parametrize(
    ("depth_m", "target_m", "gradient"),
    [
        (70.0, 60.0, 0),  # beyond the upper end, where the target stands at it: will be clamped
        (50.0, 60.0, -1),  # on the wrong side of it
        (5.0, 10.0, 0),
        (20.0, 10.0, 1),
        (70.0, 59.0, 1),  # beyond the end, but the target is not at it
        (5.0, 11.0, -1),
        (5.0, 60.0, -1),  # beyond the other end
    ],
)
def test_ends(depth_m, target_m, gradient):
    assert gradient_at_the_finest(depth_m, target_m) == pytest.approx(gradient)


def test_what_lies_beyond_an_end_costs_nothing():
    target = np.full((1, 64, 64), 60, np.float32)
    depths = [np.full((1, 64 // s, 64 // s), 1e6, np.float32) for s in (4, 8, 16, 32, 64)]
    assert loss_of(depths, target, lower=10, upper=60) == 0


def test_each_refined_depth_counts_as_the_finest():
    depths, target = five_scales()
    once, twice = loss_of([depths[0], *depths], target), loss_of([depths[0], depths[0], *depths], target)
    assert twice - once == pytest.approx(once - loss_of(depths, target), rel=1e-4)
    assert once > loss_of(depths, target)


def test_a_missing_scale_is_our_bug():
    depths, target = five_scales()
    with pytest.raises(ValueError, match="zip"):
        loss_of(depths[:4], target)


def test_near_errors_count_more():
    depths, target = five_scales()
    flat = np.full_like(target, 5.0)
    assert loss_of(depths, flat, near_weight_m=10.0) == pytest.approx(3 * loss_of(depths, flat), rel=1e-5)
    assert loss_of(depths, target, near_weight_m=0.0) == loss_of(depths, target)


def test_pinball_is_least_at_the_quantile():
    values = torch.from_numpy(np.random.default_rng(0).exponential(3.0, 50_000))
    guesses = torch.linspace(1, 6, 101, dtype=torch.float64)
    losses = torch.stack([pinball(guess.expand_as(values), values, 0.6827) for guess in guesses])
    assert float(guesses[losses.argmin()]) == pytest.approx(np.quantile(values, 0.6827), abs=0.06)


def test_pinball_by_hand():
    quantile, value = torch.tensor([1.0, 1.0]), torch.tensor([3.0, 0.0])
    assert float(pinball(quantile, value, 0.75)) == pytest.approx((0.75 * 2 + 0.25 * 1) / 2)


@pytest.mark.parametrize(
    ("depth", "truth", "error_m"), [(10.0, 10.0, 0.0), (0.0, 10.0, 110.0), (21.0, 10.0, 5.5)]
)
def test_the_error_of_inverse_depth_by_hand(depth, truth, error_m):
    """121 |1 / (1 + depth) - 1 / (1 + truth)|."""
    assert inverse_error_m(torch.tensor(depth), torch.tensor(truth)).item() == pytest.approx(
        error_m, rel=1e-5
    )


def test_near_10_m_an_error_of_inverse_depth_is_in_metres():
    error = inverse_error_m(torch.tensor(10.01), torch.tensor(10.0))
    assert error.item() == pytest.approx(0.01, rel=0.01)


def test_a_negative_answer_is_finite_in_inverse_depth():
    assert torch.isfinite(inverse_error_m(torch.tensor([-1.0, -5.0]), torch.tensor([10.0, 10.0]))).all()


def test_a_recipe_chooses_the_space_of_its_loss():
    depths = [torch.full((1, 16 >> k, 16 >> k), 20.0) for k in range(5)]
    target = torch.full((1, 64, 64), 10.0)
    found = {
        space: loss_m(small_recipe(loss_space=space), depths, target).item()
        for space in ("depth", "inverse-depth")
    }
    assert found["depth"] == pytest.approx(10 * sum(SCALE_WEIGHTS))
    assert found["inverse-depth"] == pytest.approx((11 - 121 / 21) * sum(SCALE_WEIGHTS), rel=1e-5)
