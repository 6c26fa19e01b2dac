"""What judges between a motion network's depth and that of optical flow; `runtimes.alignment` tells why."""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

LAYERS, WIDTH = 4, 16
LARGEST_OTHER = 0.5  # logarithm of the depth: what it may change beyond the way from the one to the other


class JudgeNet(nn.Module):
    """Clues of each block to how its depth changes and how large its error is then.

    The first clue is the logarithm of the inverse depth by flow over the network's, the second that of the network's
    own error bar, as a share of its depth, the last is 1 where the earlier picture holds the block: elsewhere the
    network's depth stays as it is (`runtimes.alignment.clues_of`).
    """

    mean: Tensor
    deviation: Tensor

    def __init__(self, mean: Tensor, deviation: Tensor) -> None:
        """`mean`, `deviation`: of each clue, [k]."""
        super().__init__()
        self.register_buffer("mean", mean.reshape(1, -1, 1, 1))
        self.register_buffer("deviation", deviation.reshape(1, -1, 1, 1))
        sizes = pairwise((mean.numel(), *[WIDTH] * LAYERS))
        layers = [(nn.Conv2d(before, after, 3, padding=1), nn.ReLU()) for before, after in sizes]
        self.layers = nn.Sequential(*(part for layer in layers for part in layer))
        self.head = nn.Conv2d(WIDTH, 3, 1)
        nn.init.zeros_(self.head.weight)

    def forward(self, clues: Tensor) -> Tensor:
        """Clues [n, k, h, w] to [n, 2, h, w].

        Of these the first is the logarithm of the new depth over the network's, the second the error bar, as a share of
        the new depth.
        """
        answers = self.head(self.layers((clues - self.mean) / self.deviation))
        trust, other, spread = answers[:, :1], answers[:, 1:2], answers[:, 2:]
        held = clues[:, -1:]
        change = held * (LARGEST_OTHER * torch.tanh(other) - torch.sigmoid(trust) * clues[:, :1])
        return torch.cat([change, functional.softplus(spread) * torch.exp(clues[:, 1:2])], dim=1)
