"""Learning rate: warm-up, cosine, floor."""

import pytest
from training_runs import small_recipe

from flightdepth.training.schedule import learning_rate

# Stage "a": 16 pairs in batches of 4, peak 1e-3.
RECIPE = small_recipe(floor=0.1, warmup_samples=0)
STAGE = RECIPE.stages[0]
PEAK = STAGE.learning_rate


def test_it_starts_at_the_peak_without_warm_up():
    assert learning_rate(RECIPE, STAGE, 0) == pytest.approx(PEAK)


def test_half_way_it_is_half_way_between_peak_and_floor():
    assert learning_rate(RECIPE, STAGE, STAGE.samples // 2) == pytest.approx(PEAK * 0.55)


@pytest.mark.parametrize("sample", [STAGE.samples, STAGE.samples + STAGE.batch])
def test_it_ends_at_the_floor(sample):
    assert learning_rate(RECIPE, STAGE, sample) == pytest.approx(PEAK * 0.1)


@pytest.mark.parametrize(("sample", "share"), [(0, 0.25), (4, 0.5), (8, 0.75), (12, 1), (16, 1)])
def test_warm_up_is_linear_in_batches(sample, share):
    warming, level = small_recipe(warmup_samples=16), small_recipe(warmup_samples=0)
    plain = learning_rate(level, STAGE, sample)
    assert learning_rate(warming, STAGE, sample) == pytest.approx(share * plain)


def test_it_never_rises_after_the_warm_up():
    rates = [learning_rate(RECIPE, STAGE, sample) for sample in range(0, STAGE.samples, STAGE.batch)]
    assert rates == sorted(rates, reverse=True)
