"""The network that a recipe names."""

from __future__ import annotations

from torch import nn

from flightdepth.architectures import DepthNet, FlowNetS, MotionNet
from flightdepth.training.recipe import Recipe


def built(recipe: Recipe) -> DepthNet | FlowNetS | MotionNet:
    """With random weights, in training mode."""
    network = drawn(recipe)
    for module in list(network.modules()):
        if isinstance(module, nn.BatchNorm2d):
            module.momentum = recipe.batch_norm_momentum
        for name, part in module.named_children():
            if isinstance(part, nn.ReLU) and recipe.leaky_slope:
                setattr(module, name, nn.LeakyReLU(recipe.leaky_slope, inplace=True))
    return network


def drawn(recipe: Recipe) -> DepthNet | FlowNetS | MotionNet:
    """As the architecture is published."""
    if recipe.architecture == "MotionNet":
        last = recipe.stages[-1]
        focal_px = recipe.reference_focal_px or recipe.scenes.focal_px(last.full_width)
        shift_px_m = recipe.nominal_shift * recipe.scenes.step_m * focal_px
        return MotionNet(
            recipe.base_width,
            shift_px_m=shift_px_m,
            largest_m=recipe.depth_max_m,
            looks=recipe.looks,
            thorough_last_look=recipe.thorough_last_look,
            residual_blocks=recipe.residual_blocks,
        )
    if recipe.architecture == "FlowNetS":
        return FlowNetS(recipe.base_width, recipe.activation)
    return DepthNet(recipe.base_width, recipe.activation)
