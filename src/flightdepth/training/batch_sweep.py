"""`sweep` of a whole batch in PyTorch: a GPU makes what it learns from of the pictures, and its processor is free to
render more of them. Rounded where OpenCV rounds, so that a network flies on what it learnt from.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from flightdepth.stillbox import Batch
from flightdepth.sweep import FIELD_SCALE, LEVELS, Level, unit_direction

STEPS_PER_PX = 32  # of the places at which OpenCV interpolates


def motions(batch: Batch) -> Tensor:
    """Unit direction, then fx, fy, cx, cy in pixels of each pair, float32 [B, 7]."""
    rows = [
        (
            *unit_direction(pair.displacement),
            *(getattr(pair.camera, name) for name in ("fx", "fy", "cx", "cy")),
        )
        for pair in batch.each
    ]
    return torch.from_numpy(np.array(rows, np.float32))


def swept_batch(pairs: Tensor, motion: Tensor) -> tuple[Tensor, ...]:
    """What `sweep.stacked` gives, of pairs uint8 [B, H, W, 6] and their `motions`, where they are."""
    previous, current = _grey(pairs[..., :3]), _grey(pairs[..., 3:])
    sweeps = (_swept(previous, current, motion, level) for level in LEVELS)
    return pairs[..., 3:], *sweeps, _field(motion, *pairs.shape[1:3])


def _grey(pictures: Tensor) -> Tensor:
    """RGB uint8 [B, H, W, 3] as whole numbers, float32 [B, 1, H, W]."""
    red, green, blue = pictures.to(torch.float32).unbind(-1)
    return _whole(0.299 * red + 0.587 * green + 0.114 * blue)[:, None]


def _swept(previous: Tensor, current: Tensor, motion: Tensor, level: Level) -> Tensor:
    """One level's warped pictures [B, hypotheses, h, w], of grey ones [B, 1, H, W] of full size."""
    if level.scale > 1:
        previous, current = (_whole(functional.avg_pool2d(each, level.scale)) for each in (previous, current))
    (batch, _, height, width), hypotheses = previous.shape, len(level.shifts_px)
    x, y = _sources(motion, level, height, width)
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    grid = torch.stack((2 * x / (width - 1) - 1, 2 * y / (height - 1) - 1), -1)
    warped = functional.grid_sample(
        previous[:, None].expand(-1, hypotheses, -1, -1, -1).reshape(-1, 1, height, width),
        grid.reshape(-1, height, width, 2),
        padding_mode="border",
        align_corners=True,
    )
    swept = torch.where(inside, _whole(warped.view(batch, hypotheses, height, width)), current)
    return swept.to(torch.uint8)


def _sources(motion: Tensor, level: Level, height: int, width: int) -> tuple[Tensor, Tensor]:
    """Where each pixel comes from in the earlier picture, x and y [B, hypotheses, h, w]: `sweep.warp_matrix`."""
    direction, camera = motion[:, :3, None], _resized(motion, level.scale)
    fx, fy, cx, cy = camera[:, :, None].unbind(1)
    delta = _on(level.shifts_px, motion.device) / level.scale / fx
    scale = 1 / (1 + delta * direction[:, 2])
    x_0 = cx + scale * (delta * direction[:, 0] * fx - cx)
    y_0 = cy + scale * (delta * direction[:, 1] * fy - cy)
    columns, rows = (torch.arange(side, device=motion.device) for side in (width, height))
    x = _at_a_step((scale[..., None] * columns + x_0[..., None])[:, :, None, :])
    y = _at_a_step((scale[..., None] * rows + y_0[..., None])[:, :, :, None])
    size = (-1, -1, height, width)
    return x.expand(size), y.expand(size)


def _field(motion: Tensor, height: int, width: int) -> Tensor:
    """`sweep.motion_field` of each pair."""
    direction, camera = motion[:, :3], _resized(motion, FIELD_SCALE)
    fx, fy, cx, cy = camera[:, :, None].unbind(1)
    columns, rows = (torch.arange(side // FIELD_SCALE, device=motion.device) for side in (width, height))
    x, y = (columns - cx) / fx, (rows - cy) / fy
    dx, dy, dz = direction[:, :, None].unbind(1)
    size = (-1, height // FIELD_SCALE, width // FIELD_SCALE)
    return torch.stack(
        ((dx - x * dz)[:, None, :].expand(size), (dy - y * dz)[:, :, None].expand(size)), dim=1
    )


def _resized(motion: Tensor, scale: int) -> Tensor:
    """fx, fy, cx, cy [B, 4] of pictures 1 / `scale` of the size: `Camera.resized`."""
    return torch.cat((motion[:, 3:5] / scale, (motion[:, 5:7] + 0.5) / scale - 0.5), dim=1)


def _whole(values: Tensor) -> Tensor:
    return torch.floor(values + 0.5)


def _at_a_step(places: Tensor) -> Tensor:
    return torch.floor(places * STEPS_PER_PX + 0.5) / STEPS_PER_PX


@lru_cache
def _on(shifts_px: tuple[float, ...], device: torch.device) -> Tensor:
    """Kept, since a step that is one graph must take no number from Python."""
    return torch.tensor(shifts_px, device=device)
