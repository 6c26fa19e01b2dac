"""The learning rate over a stage."""

from __future__ import annotations

import math

from flightdepth.training.recipe import Recipe, Stage


def learning_rate(recipe: Recipe, stage: Stage, sample: int) -> float:
    """Linear warm-up from 0, then half a cosine down to `floor` times the peak at the stage's last sample."""
    warm = min(1.0, (sample + stage.batch) / max(recipe.warmup_samples, 1))
    done = min(1.0, sample / stage.samples)
    cosine = recipe.floor + (1 - recipe.floor) * (1 + math.cos(math.pi * done)) / 2
    return stage.learning_rate * warm * cosine
