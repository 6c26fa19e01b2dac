"""From a batch of pairs to the tensors that a network takes."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from flightdepth.stillbox import Batch
from flightdepth.sweep import stacked, sweep
from flightdepth.training.batch_sweep import motions, swept_batch
from flightdepth.training.recipe import Recipe


@dataclass(frozen=True)
class TensorBatch:
    """One batch as a network learns from it, on the processor, pictures still as bytes.

    inputs    pairs uint8 [B, H, W, 6]; of a MotionNet, those and their motions, swept where it learns (`swept_batch`),
              or current [B, H, W, 3], sweeps and field as `sweep.stacked` has them
    target_m  float32 [B, H, W]
    """

    inputs: tuple[Tensor, ...]
    target_m: Tensor

    def pin_memory(self) -> TensorBatch:
        """In memory that a GPU reads by itself; a DataLoader calls this."""
        return TensorBatch(tuple(each.pin_memory() for each in self.inputs), self.target_m.pin_memory())

    def to(self, device: torch.device) -> TensorBatch:
        """It there; from pinned memory to a GPU, once that has come so far."""
        moved = (each.to(device, non_blocking=True) for each in self.inputs)
        return TensorBatch(tuple(moved), self.target_m.to(device, non_blocking=True))

    def copy_(self, other: TensorBatch) -> None:
        """Become another of the same size, in place."""
        for mine, new in zip((*self.inputs, self.target_m), (*other.inputs, other.target_m), strict=True):
            mine.copy_(new, non_blocking=True)

    @classmethod
    def of(cls, recipe: Recipe, batch: Batch, *, sweep_later: bool = False) -> TensorBatch:
        """Swept along the motion where the network is told that, unless that is left to where it learns."""
        inputs: tuple[Tensor, ...]
        if recipe.architecture != "MotionNet":
            inputs = (torch.from_numpy(batch.pairs),)
        elif sweep_later:
            inputs = (torch.from_numpy(batch.pairs), motions(batch))
        else:
            arrays = stacked(
                sweep(pair.previous, pair.current, pair.displacement, pair.camera) for pair in batch.each
            )
            inputs = tuple(map(torch.from_numpy, arrays))
        return cls(inputs, torch.from_numpy(batch.target_m))


def network_inputs(recipe: Recipe, batch: TensorBatch) -> tuple[Tensor, ...]:
    """Arguments of the network's `forward`, where the batch is."""
    if recipe.architecture == "MotionNet":
        return motion_inputs(*(swept_batch(*batch.inputs) if len(batch.inputs) == 2 else batch.inputs))
    return (normalised(*batch.inputs),)


def normalised(pairs: Tensor) -> Tensor:
    """uint8 [B, H, W, 6] to float [B, 6, H, W], (x / 255 - 0.5) / 0.2, channels last in memory."""
    images = pairs.permute(0, 3, 1, 2).to(torch.float32)
    return (images * (1 / 255 / 0.2) - 0.5 / 0.2).contiguous(memory_format=torch.channels_last)


def motion_inputs(current: Tensor, *maps: Tensor) -> tuple[Tensor, ...]:
    """What MotionNet's `forward` takes, of the bytes of `current` [B, H, W, 3], sweeps and field."""
    planes = (current.permute(0, 3, 1, 2), *maps)
    return tuple(each.to(torch.float32) * (1 / 255) if each.dtype == torch.uint8 else each for each in planes)
