"""The exponential mean of a network's weights over the steps: what is shipped in the end."""

from __future__ import annotations

import torch
from torch import Tensor, nn


class MovingAverage:
    """Keeps `averaged` at the mean of `network`'s weights and batch statistics, in place."""

    def __init__(self, network: nn.Module, averaged: nn.Module, decay: float) -> None:
        source, target = network.state_dict(), averaged.state_dict()
        floats = [key for key, value in target.items() if value.is_floating_point()]
        # A state dict refers to the network's own memory: gathered once, good for all steps.
        self._source: list[Tensor] = [source[key] for key in floats]
        self._target: list[Tensor] = [target[key] for key in floats]
        self._decay = decay

    @torch.no_grad()
    def update(self, steps: int) -> None:
        """Take the weights after step number `steps` (from 0) in; the memory is short while that is small."""
        decay = min(self._decay, (1 + steps) / (10 + steps))
        torch._foreach_lerp_(self._target, self._source, 1 - decay)
