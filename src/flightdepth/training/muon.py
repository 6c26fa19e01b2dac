"""Muon (Jordan et al. 2024): a kernel moves along the orthogonal matrix that is nearest to its momentum, so that no
direction is left behind; all that is no matrix is left to AdamW. Steps are as large as AdamW's (Liu et al. 2025).

`torch.optim.Muon` takes matrices only, and multiplies them in bf16. Here large kernels move in blocks of channels
(Khaled et al. 2025, MuonBP, who take the whole now and then): an eighth of the time, and they learn as well.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor, nn, optim

MOMENTUM = 0.95
TURNS = 5
COEFFICIENTS = (3.4445, -4.7750, 2.0315)  # of the polynomial that draws singular values towards 1
ADAMW_RMS = 0.2  # of the entries of a usual step of AdamW, in learning rates
BLOCK = 64  # channels at most


class Muon(optim.Optimizer):
    """Convolution kernels by Muon; heads of one channel, biases and batch norm by AdamW.

    Both take the learning rate from their group in `param_groups`, and a share of `weight_decay` times that off.
    """

    def __init__(self, network: nn.Module, lr: float, weight_decay: float) -> None:
        kernels = [weights for weights in network.parameters() if _is_matrix(weights)]
        rest = [weights for weights in network.parameters() if not _is_matrix(weights)]
        self._adamw = optim.AdamW(rest, lr=lr, weight_decay=weight_decay, fused=True)
        super().__init__(
            [{"params": kernels}, *self._adamw.param_groups], {"lr": lr, "weight_decay": weight_decay}
        )

    @torch.no_grad()
    def step(self, closure: Callable[[], Any] | None = None) -> None:  # type: ignore[override]
        """One step along the gradients that are there."""
        assert closure is None
        group, *others = self.param_groups
        for kernel in group["params"]:
            if kernel.grad is not None:
                kernel.mul_(1 - group["lr"] * group["weight_decay"])
                kernel.sub_(group["lr"] * self._direction(kernel, kernel.grad))
        # One memory for both, which whoever saves or loads a state finds here.
        self._adamw.state, self._adamw.param_groups = self.state, others
        self._adamw.step()

    def _direction(self, kernel: Tensor, gradient: Tensor) -> Tensor:
        state = self.state[kernel]
        if not state:
            state["momentum_buffer"] = torch.zeros_like(kernel)
        momentum: Tensor = state["momentum_buffer"].lerp_(gradient, 1 - MOMENTUM)
        ahead = gradient.lerp(momentum, MOMENTUM).flatten(1)  # Nesterov
        wide = ahead.shape[0] <= ahead.shape[1]
        step = orthogonal_blocks(ahead) if wide else orthogonal_blocks(ahead.T).T
        scaled: Tensor = step * (ADAMW_RMS * max(ahead.shape) ** 0.5)
        return scaled.reshape(kernel.shape)


def orthogonal_blocks(matrix: Tensor) -> Tensor:
    """`orthogonal` of blocks of at most `BLOCK` rows of a wide matrix, each for itself, as even as can be."""
    blocks = -(-len(matrix) // BLOCK)
    if len(matrix) % blocks == 0:  # at once: a GPU takes as long for one block as for all
        return orthogonal(matrix.reshape(blocks, -1, matrix.shape[1])).flatten(0, 1)
    return torch.cat([orthogonal(rows) for rows in matrix.tensor_split(blocks)])


def orthogonal(wide: Tensor) -> Tensor:
    """About U V^T of a wide matrix U S V^T: singular values of 0.7 to 1.2, by Newton and Schulz's iteration.

    One matrix or several, [..., rows, columns], each for itself. Each turn multiplies by a polynomial of X X^T, and
    those commute: so they are multiplied with each other, small and square, and with the wide matrix once. Values below
    a thousandth of the Frobenius norm come out smaller.
    """
    x = wide / (wide.norm(dim=(-2, -1), keepdim=True) + 1e-7)
    square = x @ x.mT
    product = factor = _factor(square)
    for _ in range(TURNS - 1):
        square = factor @ square @ factor
        factor = _factor(square)
        product = factor @ product
    return torch.matmul(product, x)


def _factor(square: Tensor) -> Tensor:
    first, third, fifth = COEFFICIENTS
    factor = third * square + fifth * (square @ square)
    factor.diagonal(dim1=-2, dim2=-1).add_(first)
    return factor


def _is_matrix(weights: Tensor) -> bool:
    """[out, in, h, w] as [out, in h w], or, transposed, [in, out h w]: what it does to one place of a picture."""
    return weights.ndim == 4 and min(weights.shape[:2]) > 1
