"""The network that a recipe names."""

from __future__ import annotations

from flightdepth.architectures import DepthNet, MotionNet
from flightdepth.training.recipe import Recipe


def built(recipe: Recipe) -> DepthNet | MotionNet:
    """With random weights, in training mode."""
    if recipe.architecture == "MotionNet":
        return MotionNet(recipe.base_width)
    return DepthNet(recipe.base_width, recipe.activation)
