"""The multi-scale L1 loss (paper, equation 1), its form for clipped targets, and the loss of a spread."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn import functional

from flightdepth.training.recipe import Recipe
from flightdepth.weights.card import INSIDE_ONE

SCALE_WEIGHTS = (0.32, 0.08, 0.02, 0.01, 0.005)  # finest first, as in the authors' code
SPREAD_WEIGHT = 0.05
UNIT_DEPTH_M = 10.0  # where an error of inverse depth counts as one of depth


def loss_m(recipe: Recipe, output: list[Tensor] | tuple[list[Tensor], Tensor], target_m: Tensor) -> Tensor:
    """The loss of a recipe, a scalar in metres.

    output    what the network's `forward` returned: depths in metres, [B, h, w] each, finest first; of a MotionNet a
              pair of those and the spread of the first, [B, H/4, W/4] in metres
    target_m  [B, H, W], within the recipe's range
    """
    ends = (
        {"lower": recipe.depth_min_m, "upper": recipe.depth_max_m} if recipe.loss == "saturating-l1" else {}
    )
    depths, spread_m = (output, None) if isinstance(output, list) else output
    inverse = recipe.loss_space == "inverse-depth"
    total = multi_scale_l1(depths, target_m, near_weight_m=recipe.near_weight_m, inverse=inverse, **ends)
    if spread_m is None:
        return total
    answer_m = depths[0].detach().clamp(recipe.depth_min_m, recipe.depth_max_m)
    error_m = (answer_m - _pooled(target_m, answer_m)).abs()
    return total + SPREAD_WEIGHT * pinball(spread_m, error_m, INSIDE_ONE)


def l1_m(recipe: Recipe, output: list[Tensor] | tuple[list[Tensor], Tensor], target_m: Tensor) -> Tensor:
    """Mean error of what is exported, the finest scale, clipped; a scalar in metres. The rest as for `loss_m`."""
    depths = output if isinstance(output, list) else output[0]
    answer_m = depths[0].float().clamp(recipe.depth_min_m, recipe.depth_max_m)
    return (answer_m - _pooled(target_m, answer_m)).abs().mean()


def multi_scale_l1(
    depths: Sequence[Tensor],
    target_m: Tensor,
    *,
    lower: float = -torch.inf,
    upper: float = torch.inf,
    near_weight_m: float = 0.0,
    inverse: bool = False,
) -> Tensor:
    """Sum over scales of weight * mean |depth - target|, the target average-pooled to each scale.

    depths: [B, h, w] each, finest first; target_m [B, H, W]; the result is a scalar in metres.
    With `lower` and `upper`, the ends of a clipped target, an answer beyond an end is no error where the
    target stands at that end: it will be clamped anyway. With `near_weight_m` an error at depth Z counts
    1 + near_weight_m / Z times; with `inverse` it is the error of inverse depth (`inverse_error_m`).
    """
    total = torch.zeros((), device=target_m.device)
    # More than the decoder's scales: the finest was refined, and each refinement counts as much again.
    weights = (SCALE_WEIGHTS[0],) * max(len(depths) - len(SCALE_WEIGHTS), 0) + SCALE_WEIGHTS
    for depth, weight in zip(depths, weights, strict=True):
        truth = _pooled(target_m, depth)
        beyond = ((truth >= upper) & (depth > upper)) | ((truth <= lower) & (depth < lower))
        error = inverse_error_m(depth, truth) if inverse else (depth - truth).abs()
        error = error.masked_fill(beyond, 0.0)
        if near_weight_m:
            error = error * (1 + near_weight_m / truth.clamp_min(1.0))
        total = total + weight * error.mean()
    return total


def inverse_error_m(depth: Tensor, truth: Tensor) -> Tensor:
    """|1 / (1 m + depth) - 1 / (1 m + truth)|, times (1 m + 10 m)^2: metres near 10 m, nothing is divided by 0.

    depth, truth and the result [B, h, w], in metres; a depth below 0 counts as 0.
    """
    return (UNIT_DEPTH_M + 1) ** 2 * (1 / (1 + depth.clamp_min(0)) - 1 / (1 + truth)).abs()


def pinball(quantile: Tensor, value: Tensor, share: float) -> Tensor:
    """Mean of max(share * (value - quantile), (share - 1) * (value - quantile)).

    Least where `share` (0..1) of the values are below `quantile`, given what `quantile` was computed from (Koenker and
    Bassett 1978). `quantile` and `value` of one shape and unit, which is that of the result, a scalar.
    """
    over = value - quantile
    return torch.maximum(share * over, (share - 1) * over).mean()


def _pooled(target_m: Tensor, like: Tensor) -> Tensor:
    return functional.adaptive_avg_pool2d(target_m[:, None], (like.shape[-2], like.shape[-1]))[:, 0]
