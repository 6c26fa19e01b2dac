"""Fitting the judge of `runtimes.alignment`: what it is told of a pair, the truth, and the weights that do best.

Errors count relative to the depth and, less, in metres; the error bar is to hold 68 % of them, of the small ones as
well as of the large. Of three pairs in ten the network is made to err more than it does, by a factor that changes
slowly across the picture: it knows rendered scenes better than any real ones, and flow does not.
"""

from __future__ import annotations

import copy
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from flightdepth.levels import grey
from flightdepth.runtimes.alignment import clues_of
from flightdepth.runtimes.arrays import Maps
from flightdepth.runtimes.error_bar import error_bar_scale
from flightdepth.runtimes.network import Network
from flightdepth.stillbox.pairs import Pair
from flightdepth.sweep import unit_direction

if TYPE_CHECKING:
    from torch import Tensor

    from flightdepth.architectures.judge import JudgeNet


STEPS, BLOCKS, RATE = 10_000, 12 * 64 * 64, 8e-3  # of a batch
METRE_WEIGHT = 0.03  # of an error in metres at D0 beside a relative one
LARGEST_ERROR = 3.0  # relative; more counts as this
INSIDE_ONE = 0.68
LEAST_ERROR = 1e-4  # relative; less counts as this
ASTRAY, ASTRAY_SHARE = 0.12, 0.3  # deviation of the logarithm of that factor, and of how many pairs
TURNS = 8  # quarter turns, mirrored or not: clues have no direction


@dataclass(frozen=True)
class Told:
    """What the judge is told of a pair, and what it should have said.

    clues    [k, h, w]
    depth    the network's, over its range, without what a rotation made, [h, w]
    truth    over the range too, NaN where there is none
    """

    clues: Maps
    depth: Maps
    truth: Maps


def told_of(network: Network, pair: Pair) -> Told:
    """What alignment would tell the judge of this pair; `network` is one that is not aligned."""
    grid, length_m = network.grid(pair.camera), float(np.linalg.norm(pair.displacement))
    pictures = grid.image(pair.previous), grid.image(pair.current)
    found = network.predict([pair.previous], pair.current, pair.displacement[None], pair.camera)
    depth_m, sigma_m = found.depth_m[0], found.sigma_m
    if sigma_m is None:
        raise ValueError(f"expected a network that tells sigma_m, got {network.card.name}")
    previous, current = map(grey, pictures)
    scale = error_bar_scale(network.card, found.beta, found.valid, grid.camera.fx)
    sigma = sigma_m[0] / depth_m / scale[0]
    direction = unit_direction(pair.displacement)
    clues, depth = clues_of(previous, current, depth_m / length_m, sigma, direction, camera=grid.camera)
    range_m = network.card.at_focal(grid.camera.fx).alpha * length_m
    truth_m = cv2.resize(pair.target_m.clip(0, range_m), depth.shape[::-1], interpolation=cv2.INTER_AREA)
    known = found.valid & (truth_m > 0)
    truth = np.where(known, truth_m / range_m, np.float32(np.nan))
    return Told(clues, np.asarray(depth * (length_m / range_m), np.float32), np.asarray(truth, np.float32))


def fitted_judge(
    told: Sequence[Told],
    *,
    steps: int = STEPS,
    rate: float = RATE,
    seed: int = 0,
    start: bytes | None = None,
    after_step: Callable[[], None] = lambda: None,
) -> bytes:
    """The judge with the least error, as an ONNX file.

    With `start`, an ONNX file too, that one learns better error bars and keeps to the depth that it had.
    """
    import torch

    from flightdepth.architectures.judge import JudgeNet

    torch.manual_seed(seed)
    sets, draws = _by_shape(told), np.random.default_rng(seed)
    some = torch.cat([clues[::8].transpose(0, 1).flatten(1) for clues, _, _ in sets], 1).float()
    judge = JudgeNet(some.mean(1), some.std(1).clamp_min(1e-3))
    kept = None
    if start is not None:
        judge.load_state_dict(_weights(start, judge))
        kept = copy.deepcopy(judge).requires_grad_(False)
    optimizer = torch.optim.AdamW(judge.parameters(), rate, weight_decay=1e-3)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, rate, total_steps=steps)
    sizes = np.array([depth.numel() for _, depth, _ in sets], np.float64)
    for _ in range(steps):
        chosen = sets[draws.choice(len(sets), p=sizes / sizes.sum())]
        count = max(1, round(BLOCKS / chosen[1][0].numel()))
        picked = torch.from_numpy(draws.integers(0, len(chosen[1]), count))
        clues, depth, truth = _turned([each[picked].float() for each in chosen], int(draws.integers(TURNS)))
        clues, depth = _astray(clues, depth)
        loss = _loss(judge(clues), depth, truth, None if kept is None else kept(clues))
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        schedule.step()
        after_step()
    return _as_onnx(judge)


def _by_shape(told: Sequence[Told]) -> list[tuple[Tensor, Tensor, Tensor]]:
    """Clues [n, k, h, w] in half precision, depth and truth [n, h, w] of all pairs of each shape."""
    import torch

    groups: dict[tuple[int, ...], list[Told]] = defaultdict(list)
    for each in told:
        groups[each.depth.shape].append(each)
    return [
        (
            torch.from_numpy(np.stack([each.clues.astype(np.float16) for each in group])),
            torch.from_numpy(np.stack([each.depth for each in group])),
            torch.from_numpy(np.stack([each.truth for each in group])),
        )
        for group in groups.values()
    ]


def _turned(maps: Sequence[Tensor], turn: int) -> list[Tensor]:
    turned = [each.rot90(turn % 4, (-2, -1)) for each in maps]
    return [each.flip(-1) for each in turned] if turn >= 4 else turned


def _astray(clues: Tensor, depth: Tensor) -> tuple[Tensor, Tensor]:
    """The same with some networks farther from the truth than they were, which half of them know."""
    import torch
    from torch.nn import functional

    count, _, height, width = clues.shape
    coarse = ASTRAY * torch.randn(count, 1, 3, 3) * (torch.rand(count, 1, 1, 1) < ASTRAY_SHARE)
    off = functional.interpolate(coarse, (height, width), mode="bilinear", align_corners=True)
    known = torch.where(torch.rand(count, 1, 1, 1) < 0.5, off.abs(), 0)
    ratio, doubt, moved, held = clues[:, :1], clues[:, 1:2], clues[:, 2:3], clues[:, -1:]
    changed = [ratio + off * held, torch.maximum(doubt, torch.log(known + 1e-9)), moved - off]
    return torch.cat([*changed, clues[:, 3:]], 1), depth * torch.exp(off[:, 0])


def _loss(answer: Tensor, network: Tensor, truth: Tensor, kept: Tensor | None = None) -> Tensor:
    """Of depth and error bar; where the depth is to be that of `kept`, [n, 2, h, w], of what it strays from that."""
    import torch

    depth = network * torch.exp((answer if kept is None else kept)[:, 0])
    known = torch.isfinite(truth)
    truth = truth.nan_to_num(1.0)  # else the derivative of what does not count is NaN
    in_range = known & (truth < 0.99)
    off = (depth - truth).abs()
    if kept is None:
        loss = (off / truth)[in_range].clamp(max=LARGEST_ERROR).mean()
        loss = loss + METRE_WEIGHT * 100 * off[known].mean()
    else:
        loss = (answer[:, 0] - kept[:, 0]).abs().mean()
    return loss + bar_loss((off / depth).detach()[in_range], answer[:, 1][in_range])


def bar_loss(error: Tensor, bar: Tensor) -> Tensor:
    """Least where `bar` holds 68 % of the errors, both as shares of the depth, [n].

    The quantile loss of logarithms: errors of one per cent count as much as those of thirty.
    """
    from flightdepth.training.loss import pinball

    return pinball(bar.clamp_min(LEAST_ERROR).log(), error.clamp_min(LEAST_ERROR).log(), INSIDE_ONE)


def _weights(onnx: bytes, judge: JudgeNet) -> dict[str, Tensor]:
    """What `_as_onnx` wrote down under each name that a judge has."""
    import onnx as format_of
    import torch

    stored = format_of.load_from_string(onnx).graph.initializer
    arrays = {each.name: format_of.numpy_helper.to_array(each) for each in stored}
    return {name: torch.from_numpy(arrays[name].copy()) for name in judge.state_dict()}


def _as_onnx(judge: JudgeNet) -> bytes:
    import torch

    from flightdepth.training.export import serialised

    example, free = torch.zeros(1, judge.mean.numel(), 48, 64), torch.export.Dim.DYNAMIC
    return serialised(judge.eval(), [example], ["clues"], ["judgement"], [{2: free, 3: free}], optimize=True)
