"""From a batch of pairs to the tensors that a network takes."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from flightdepth.stillbox import Batch
from flightdepth.sweep import sweep
from flightdepth.training.pictures import normalised
from flightdepth.training.recipe import Recipe


def network_inputs(recipe: Recipe, batch: Batch, device: torch.device) -> tuple[Tensor, ...]:
    """Arguments of the network's `forward`."""
    if recipe.architecture != "MotionNet":
        return (normalised(torch.from_numpy(batch.pairs).to(device)),)
    current, *maps = (torch.from_numpy(array).to(device) for array in swept(batch))
    return motion_inputs(current, *maps)


def swept(batch: Batch) -> tuple[np.ndarray, ...]:
    """current [B, H, W, 3], the levels' warped pictures [B, k, h, w], field [B, 2, h, w]."""
    sweeps = [
        sweep(np.ascontiguousarray(pair[..., :3]), np.ascontiguousarray(pair[..., 3:]), moved, camera)
        for pair, moved, camera in zip(batch.pairs, batch.displacement, batch.cameras, strict=True)
    ]
    columns = zip(*((each.current, *each.swept, each.field) for each in sweeps), strict=True)
    return tuple(np.stack(column) for column in columns)


def motion_inputs(current: Tensor, *maps: Tensor) -> tuple[Tensor, ...]:
    """What MotionNet's `forward` takes, of the bytes of `current` [B, H, W, 3], sweeps and field."""
    planes = (current.permute(0, 3, 1, 2), *maps)
    return tuple(each.to(torch.float32) * (1 / 255) if each.dtype == torch.uint8 else each for each in planes)
