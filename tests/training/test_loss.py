"""The multi-scale L1 loss against plain numpy, and its forgiving ends."""

import numpy as np
import pytest
import torch
from training_runs import small_recipe

from flightdepth.training.loss import SCALE_WEIGHTS, inverse_error_m, l1_m, loss_m, multi_scale_l1, pinball

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


def flat(*depths_m):
    """Five scales, finest first, of one depth each; the last counts for those that are left."""
    depths_m = (*depths_m, *[depths_m[-1]] * (5 - len(depths_m)))
    return [torch.full((1, 16 >> k, 16 >> k), depth_m) for k, depth_m in enumerate(depths_m)]


def target(depth_m):
    return torch.full((1, 64, 64), depth_m)


def test_a_recipe_chooses_whether_an_end_forgives():
    found = [loss_m(small_recipe(loss=loss), flat(130.0), target(100.0)) for loss in ("l1", "saturating-l1")]
    assert [loss.item() for loss in found] == pytest.approx([30 * sum(WEIGHTS), 0])


def test_a_recipe_chooses_how_much_more_near_errors_count():
    found = loss_m(small_recipe(near_weight_m=10.0), flat(6.0), target(5.0)).item()
    assert found == pytest.approx(3 * sum(WEIGHTS))


def test_nearer_than_a_metre_errors_count_as_at_a_metre():
    found = loss_m(small_recipe(near_weight_m=10.0), flat(1.25), target(0.25)).item()
    assert found == pytest.approx(11 * sum(WEIGHTS))


@pytest.mark.parametrize("depth_m", [8.0, 12.0])
@pytest.mark.parametrize(("spread_m", "pinball_m"), [(1.0, 0.6827 * 1), (4.0, 0.3173 * 2)])
def test_a_spread_is_learnt_beside_the_depth(depth_m, spread_m, pinball_m):
    """Of an error of 2 m, too near or too far."""
    spread = torch.full((1, 16, 16), spread_m)
    found = loss_m(small_recipe(), (flat(depth_m), spread), target(10.0)).item()
    assert found == pytest.approx(2 * sum(WEIGHTS) + 0.05 * pinball_m, rel=1e-5)


def test_a_spread_is_that_of_the_clipped_depth():
    """Which is right, at the end of the range."""
    found = loss_m(small_recipe(), (flat(130.0), torch.full((1, 16, 16), 1.0)), target(100.0)).item()
    assert found == pytest.approx(0.05 * 0.3173, rel=1e-5)


def test_a_spread_does_not_pull_at_the_depth():
    pulls = []
    for spread in ((), (torch.full((1, 16, 16), 1.0),)):
        depths = flat(12.0)
        depths[0].requires_grad_()
        loss_m(small_recipe(), (depths, *spread) if spread else depths, target(10.0)).backward()
        pulls.append(depths[0].grad)
    assert torch.equal(*pulls)


@pytest.mark.parametrize("spread", [False, True])
def test_the_error_that_is_told_is_that_of_the_finest_depth_clipped(spread):
    output = (flat(130.0, 0.0), torch.ones((1, 16, 16))) if spread else flat(130.0, 0.0)
    assert l1_m(small_recipe(), output, target(90.0)).item() == pytest.approx(10)


def test_errors_of_both_signs_add_up():
    depths = flat(10.0)
    depths[0][:, ::2], depths[0][:, 1::2] = 6.0, 14.0
    assert l1_m(small_recipe(), depths, target(10.0)).item() == pytest.approx(4)
