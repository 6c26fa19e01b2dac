"""The multi-scale L1 loss (paper, equation 1) and its form for clipped targets."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn import functional

SCALE_WEIGHTS = (0.32, 0.08, 0.02, 0.01, 0.005)  # finest first, as in the authors' code


def multi_scale_l1(
    depths: Sequence[Tensor], target_m: Tensor, *, lower: float = -torch.inf, upper: float = torch.inf
) -> Tensor:
    """Sum over scales of weight * mean |depth - target|, the target average-pooled to each scale.

    depths: [B, h, w] each, finest first; target_m [B, H, W]; the result is a scalar in metres.
    With `lower` and `upper`, the ends of a clipped target, an answer beyond an end is no error where the
    target stands at that end: it will be clamped anyway.
    """
    total = torch.zeros((), device=target_m.device)
    for depth, weight in zip(depths, SCALE_WEIGHTS, strict=True):
        truth = functional.adaptive_avg_pool2d(target_m[:, None], (depth.shape[-2], depth.shape[-1]))[:, 0]
        beyond = ((truth >= upper) & (depth > upper)) | ((truth <= lower) & (depth < lower))
        total = total + weight * (depth - truth).abs().masked_fill(beyond, 0.0).mean()
    return total
