"""Several processes, one run: each computes parts of every batch, and what they found is put together.

A batch of B pairs is some equal parts. Each part has its own stream of scenes and its own batch statistics, and
counts as much as another; so a run depends on how many parts there are, not on whether one process computes
them one after the other or several do at the same time.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from accelerate import Accelerator, PartialState
from torch import nn

from flightdepth.errors import BadInput
from flightdepth.training.recipe import STRIDE, Recipe


def without_gpu() -> bool:
    """Whether training is the processor's. accelerate joins processes there only if it is told so."""
    return not torch.accelerator.is_available()


def this_process() -> PartialState:
    """Which of the processes of a run this is; it waits for the others to be there."""
    return PartialState(cpu=without_gpu())


@dataclass(frozen=True)
class Share:
    """The numbers of the parts that one process computes, of `parts` in all."""

    parts: int
    mine: range

    @classmethod
    def of(cls, recipe: Recipe, process: int, processes: int) -> Share:
        """An equal share for each process; at least one part each.

        Raises:
            BadInput: parts or batches cannot be shared out equally, or a part is too small for batch statistics.
        """
        parts = max(recipe.accumulate, processes)
        for what, whole, share in (
            ("accumulate", parts, processes),
            *((f"batch of stage {stage.name}", stage.batch, parts) for stage in recipe.stages),
        ):
            if whole % share:
                raise BadInput(
                    f"recipe {recipe.name}, {what}", expected=f"a multiple of {share}", got=str(whole)
                )
        for stage in recipe.stages:
            places = stage.batch // parts * (stage.width // STRIDE) * (stage.height // STRIDE)
            if places < 2 and recipe.architecture != "FlowNetS":
                raise BadInput(
                    f"recipe {recipe.name}, batch of stage {stage.name}",
                    expected=f"at least {2 * parts}: batch norm needs two values of each map in each of {parts} parts",
                    got=str(stage.batch),
                )
        each = parts // processes
        return cls(parts, range(process * each, (process + 1) * each))


def weigh_part(network: nn.Module, momentum: float, part: int, parts: int) -> None:
    """Make batch norm's running statistics move by `momentum` towards the mean of `parts` parts, not part by part.

    r_(j+1) = (1 - a_j) r_j + a_j b_j with a_j = m / (k - (k - 1 - j) m), j = 0 ... k - 1, ends in
    r_k = (1 - m) r_0 + m mean(b).
    """
    share = momentum / (parts - (parts - 1 - part) * momentum)
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            module.momentum = share


def mean_over(accelerator: Accelerator, *modules: nn.Module) -> None:
    """Give all processes the mean of their batch statistics, in place.

    Running statistics and their averages are linear in the batches', so it is all the same when they are put
    together: each step, or before they are saved.
    """
    if accelerator.num_processes == 1:
        return
    for module in modules:
        for buffer in module.buffers():
            if buffer.is_floating_point():
                buffer.copy_(accelerator.reduce(buffer, "mean"))
