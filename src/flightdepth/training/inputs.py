"""From a batch of pairs to the tensors that a network takes."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from flightdepth.stillbox import Batch
from flightdepth.sweep import stacked, sweep
from flightdepth.training.pictures import normalised
from flightdepth.training.recipe import Recipe


def network_inputs(recipe: Recipe, batch: Batch, device: torch.device) -> tuple[Tensor, ...]:
    """Arguments of the network's `forward`."""
    if recipe.architecture != "MotionNet":
        return (normalised(torch.from_numpy(batch.pairs).to(device)),)
    swept = stacked(
        sweep(np.ascontiguousarray(pair[..., :3]), np.ascontiguousarray(pair[..., 3:]), moved, camera)
        for pair, moved, camera in zip(batch.pairs, batch.displacement, batch.cameras, strict=True)
    )
    return motion_inputs(*(torch.from_numpy(array).to(device) for array in swept))


def motion_inputs(current: Tensor, *maps: Tensor) -> tuple[Tensor, ...]:
    """What MotionNet's `forward` takes, of the bytes of `current` [B, H, W, 3], sweeps and field."""
    planes = (current.permute(0, 3, 1, 2), *maps)
    return tuple(each.to(torch.float32) * (1 / 255) if each.dtype == torch.uint8 else each for each in planes)
