"""The network that a recipe names."""

from __future__ import annotations

from torch import nn

from flightdepth.architectures import DepthNet, FlowNetS, MotionNet
from flightdepth.training.recipe import Recipe


def network_of(recipe: Recipe) -> DepthNet | FlowNetS | MotionNet:
    """As the recipe has it, with random weights, in training mode."""
    network = _as_published(recipe)
    for module in list(network.modules()):
        if isinstance(module, nn.BatchNorm2d):
            module.momentum = recipe.batch_norm_momentum
        for name, part in module.named_children():
            if isinstance(part, nn.ReLU) and recipe.leaky_slope:
                setattr(module, name, nn.LeakyReLU(recipe.leaky_slope, inplace=True))
    return network


def _as_published(recipe: Recipe) -> DepthNet | FlowNetS | MotionNet:
    """The architecture in the recipe's size, before its knobs of layers are turned."""
    if recipe.architecture == "MotionNet":
        assert recipe.shift_px_m is not None  # the recipe sees to it
        return MotionNet(
            recipe.base_width,
            shift_px_m=recipe.shift_px_m,
            largest_m=recipe.depth_max_m,
            looks=recipe.looks,
            thorough_last_look=recipe.thorough_last_look,
            residual_blocks=recipe.residual_blocks,
        )
    if recipe.architecture == "FlowNetS":
        return FlowNetS(recipe.base_width, recipe.activation)
    return DepthNet(recipe.base_width, recipe.activation)
