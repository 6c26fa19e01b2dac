"""From a batch of pairs to the tensors that a network takes."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from flightdepth.stillbox import Batch
from flightdepth.sweep import stacked, sweep
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


def normalised(pairs: Tensor) -> Tensor:
    """uint8 [B, H, W, 6] to float [B, 6, H, W], (x / 255 - 0.5) / 0.2, channels last in memory."""
    images = pairs.permute(0, 3, 1, 2).to(torch.float32)
    return (images * (1 / 255 / 0.2) - 0.5 / 0.2).contiguous(memory_format=torch.channels_last)


def motion_inputs(current: Tensor, *maps: Tensor) -> tuple[Tensor, ...]:
    """What MotionNet's `forward` takes, of the bytes of `current` [B, H, W, 3], sweeps and field."""
    planes = (current.permute(0, 3, 1, 2), *maps)
    return tuple(each.to(torch.float32) * (1 / 255) if each.dtype == torch.uint8 else each for each in planes)
