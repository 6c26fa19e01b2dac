"""From a batch of pairs to the tensors that a network takes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from flightdepth.stillbox import Batch
from flightdepth.sweep import stacked, sweep
from flightdepth.training.batch_sweep import motions, swept_batch
from flightdepth.training.recipe import Recipe


@dataclass(frozen=True)
class TensorBatch:
    """One batch as a network learns from it, on the processor, pictures still as bytes.

    inputs    pairs uint8 [B, H, W, 6]; of a MotionNet current [B, H, W, 3], sweeps and field, as of `sweep.stacked`
    target_m  float32 [B, H, W]
    unswept   of a MotionNet whose sweeps are made where it learns: `inputs` are what `swept_batch` takes
    """

    inputs: tuple[Tensor, ...]
    target_m: Tensor
    unswept: bool = False

    def pin_memory(self) -> TensorBatch:
        """In memory that a GPU reads by itself; a DataLoader calls this."""
        return self._each(Tensor.pin_memory)

    def to(self, device: torch.device) -> TensorBatch:
        """It there; from pinned memory to a GPU, once that has come so far."""
        return self._each(lambda each: each.to(device, non_blocking=True))

    def _each(self, change: Callable[[Tensor], Tensor]) -> TensorBatch:
        return replace(self, inputs=tuple(map(change, self.inputs)), target_m=change(self.target_m))

    def copy_(self, other: TensorBatch) -> None:
        """Become another of the same size, in place."""
        for mine, new in zip((*self.inputs, self.target_m), (*other.inputs, other.target_m), strict=True):
            mine.copy_(new, non_blocking=True)

    @classmethod
    def of(cls, recipe: Recipe, batch: Batch, *, sweep_later: bool = False) -> TensorBatch:
        """Swept along the motion where the network is told that, unless that is left to where it learns."""
        target_m = torch.from_numpy(batch.target_m)
        if recipe.architecture != "MotionNet":
            return cls((torch.from_numpy(batch.pairs),), target_m)
        if sweep_later:
            return cls((torch.from_numpy(batch.pairs), motions(batch)), target_m, unswept=True)
        arrays = stacked(
            sweep(pair.previous, pair.current, pair.displacement, pair.camera) for pair in batch.each
        )
        return cls(tuple(map(torch.from_numpy, arrays)), target_m)


def network_inputs(recipe: Recipe, batch: TensorBatch) -> tuple[Tensor, ...]:
    """Arguments of the network's `forward`, where the batch is."""
    if recipe.architecture == "MotionNet":
        return motion_inputs(*(swept_batch(*batch.inputs) if batch.unswept else batch.inputs))
    return (normalised(*batch.inputs),)


def normalised(pairs: Tensor) -> Tensor:
    """uint8 [B, H, W, 6] to float [B, 6, H, W], (x / 255 - 0.5) / 0.2, channels last in memory."""
    images = pairs.permute(0, 3, 1, 2).to(torch.float32)
    return (images * (1 / 255 / 0.2) - 0.5 / 0.2).contiguous(memory_format=torch.channels_last)


def motion_inputs(current: Tensor, *maps: Tensor) -> tuple[Tensor, ...]:
    """What MotionNet's `forward` takes, of the bytes of `current` [B, H, W, 3], sweeps and field."""
    planes = (current.permute(0, 3, 1, 2), *maps)
    return tuple(each.to(torch.float32) * (1 / 255) if each.dtype == torch.uint8 else each for each in planes)
