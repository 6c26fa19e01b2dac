"""A second look: the earlier picture warped by the depth just found, and what the difference says about it.

The trunk chooses between hypotheses that are the same for all pixels, whole pixels apart where things are near.
Here each pixel has hypotheses of its own: a little farther than its own depth, the same, a little nearer, and the
nearest and the farthest depth around it, one of which it takes for its own at an edge. Least squares over a block of
4x4 pixels says where between the first three the pictures agree (Lucas and Kanade 1981, along a known line), and a
small network what to believe. What it gives may be looked at again: so depth crosses an edge that is more than a pixel
of depth off. The last of several looks may be a thorough one, with weights of its own: it sees by which quarter of a
block the pictures differ, so how much of a pixel of depth lies before an edge, and farther around.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn import functional

STEP = math.log(1.3)  # between the hypotheses, in log of the shift
LEAST_GRADIENT = 0.01  # squared, contrasts a step
NEAREST_SHARE, FARTHEST_SHARE = 0.003, 1.4  # of the largest depth: what can be refined at all
NEIGHBOURHOOD = 5  # pixels of depth across, which hold both sides of an edge nearby
SQUEEZED, WIDTH = 16, 32
CANDIDATES = 6  # the five hypotheses, and the second corrected
CLUES = 14
QUARTERS = 4 * 5  # further clues of a thorough look: for each hypothesis
FAR_AROUND = 4  # dilation of its last convolution, pixels of depth


class Refinement(nn.Module):
    """Depth and spread to better ones, of the same size.

    features    how many maps come from the trunk
    shift_px_m  shift in pixels of a point at 1 m that moves sideways: D0 times the focal length
    largest_m   where the network's range ends
    thorough    whether it sees quarters of blocks, and farther around; at every pixel, not at every second
    """

    def __init__(self, features: int, shift_px_m: float, largest_m: float, *, thorough: bool = False) -> None:
        super().__init__()
        self.shift_px_m, self.thorough = shift_px_m, thorough
        self.range_m = (NEAREST_SHARE * largest_m, FARTHEST_SHARE * largest_m)
        self.squeeze = nn.Sequential(nn.Conv2d(features, SQUEEZED, 1), nn.ReLU(inplace=True))
        taken = CLUES + SQUEEZED + (QUARTERS if thorough else 0)
        self.trunk = nn.Sequential(*_conv(taken), *_conv(WIDTH), *_conv(WIDTH, dilation=2))
        if thorough:
            self.around = nn.Sequential(*_conv(WIDTH, dilation=FAR_AROUND)[:2])
        self.head = nn.Conv2d(WIDTH, CANDIDATES + 2, 3, padding=1)
        nn.init.zeros_(self.head.weight)
        assert self.head.bias is not None
        nn.init.zeros_(self.head.bias)
        with torch.no_grad():
            self.head.bias[-3] = 3.0  # begin with the corrected one

    def forward(
        self, depth: Tensor, spread: Tensor, features: Tensor, difference: Difference
    ) -> tuple[Tensor, Tensor]:
        """depth, spread [B, h, w]; features [B, k, h, w]; the pictures are 4 times as large."""
        depth = depth.detach().clamp(*self.range_m)
        shift = torch.log(self.shift_px_m / depth)[:, None]
        reach = functional.pad(shift, (NEIGHBOURHOOD // 2,) * 4, mode="replicate")
        near = functional.max_pool2d(reach, NEIGHBOURHOOD, 1)
        far = -functional.max_pool2d(-reach, NEIGHBOURHOOD, 1)
        hypotheses = torch.cat((shift - STEP, shift, shift + STEP, near, far), 1)
        left, inside = difference(torch.exp(hypotheses))
        # Means over blocks of 4x4 pixels. A convolution is faster in OpenVINO, but in bf16 costs 7 % of the error:
        # `runtimes.block_means` makes them one where that is not asked for.
        block = 4 // difference.every
        gradient = left[:, 2:3] - left[:, 0:1]
        square = functional.avg_pool2d(gradient * gradient, block) * inside[:, 1:2]
        product = functional.avg_pool2d(gradient * left[:, 1:2], block) * inside[:, 1:2]
        off = (-product / (square + LEAST_GRADIENT)).clamp(-1, 1)
        apart = left.abs()
        clues = [
            functional.avg_pool2d(apart, block) * inside,
            2 * off,
            0.3 * torch.log1p(square / LEAST_GRADIENT),
            near - shift,
            far - shift,
            0.5 * shift,
            spread[:, None] / depth[:, None],
            difference.field,
            inside[:, 1:2],
            self.squeeze(features),
        ]
        if self.thorough:
            quarters = functional.avg_pool2d(apart, block // 2)
            clues += [quarters[:, :, row::2, column::2] * inside for row in (0, 1) for column in (0, 1)]
        seen = self.trunk(torch.cat(clues, 1))
        if self.thorough:
            seen = functional.relu(seen + self.around(seen))
        answer = self.head(seen)
        candidates = torch.cat((hypotheses, shift + 2 * STEP * off), 1)
        weights = answer[:, :CANDIDATES].softmax(1)
        refined = (weights * candidates).sum(1) + 0.3 * answer[:, CANDIDATES]
        refined_m = self.shift_px_m * torch.exp(-refined)
        return refined_m, functional.softplus(answer[:, CANDIDATES + 1]) * refined_m.detach()


class Difference:
    """Warped earlier picture minus the present one, in contrasts, for a shift per pixel of depth.

    previous, current  grey, in contrasts, [B, 1, H, W]
    field              [B, 2, H/4, W/4], `flightdepth.sweep.motion_field`
    every              1, or 2 to look at every second pixel of every second row: a quarter of the work
    """

    def __init__(self, previous: Tensor, current: Tensor, field: Tensor, *, every: int = 1) -> None:
        self.previous, self.current, self.field, self.every = previous, current, field, every

    def __call__(self, shift_px: Tensor) -> tuple[Tensor, Tensor]:
        """shift_px [B, k, H/4, W/4] to the differences [B, k, H / every, W / every], and 1 where the earlier picture
        holds the middle of a block of 4x4 pixels, else 0, [B, k, H/4, W/4]."""
        batch, hypotheses, rows, columns = shift_px.shape
        height, width = 4 * rows, 4 * columns
        across, down = self.field[:, 0:1], self.field[:, 1:2]
        # The field is linear: a corner of it and its growth by pixel are all. Indices, not slices, leave sizes free.
        corner, right = across[:, 0, 0, 0].view(-1, 1, 1, 1), across[:, 0, 0, 1].view(-1, 1, 1, 1)
        top, below = down[:, 0, 0, 0].view(-1, 1, 1, 1), down[:, 0, 1, 0].view(-1, 1, 1, 1)
        closing = (corner - right) / 4  # d_z / fx
        scale = shift_px / (1 + shift_px * closing).clamp_min(0.05)
        x = _middles(columns, shift_px) + scale * across * (2 / width)
        y = _middles(rows, shift_px)[:, None] + scale * down * (2 / height)
        inside = ((x.abs() < 1) & (y.abs() < 1)).to(scale.dtype)
        # Written as one sum over (x, y), so that no picture of coordinates is copied; all hypotheses of a picture
        # below one another, so that neither is the picture.
        every = self.every
        column = torch.arange(0, width, every, device=shift_px.device, dtype=shift_px.dtype)[:, None]
        row = torch.arange(0, height, every, device=shift_px.device, dtype=shift_px.dtype)[:, None, None]
        # [B, 1, 1, W / every, 1] and [B, 1, H / every, 1, 1]
        across_full = (corner - closing * (column - 1.5))[:, :, None] * (2 / width)
        down_full = (top + (below - top) / 4 * (row - 1.5)[None])[:, None] * (2 / height)
        first, second = shift_px.new_tensor((1.0, 0.0)), shift_px.new_tensor((0.0, 1.0))
        moves = across_full * first + down_full * second
        stands = (
            _middles(width, shift_px)[::every, None] * first
            + _middles(height, shift_px)[::every, None, None] * second
        )
        large = functional.interpolate(scale, scale_factor=4 // every, mode="nearest")[..., None]
        grid = (stands + large * moves).reshape(batch, hypotheses * (height // every), width // every, 2)
        warped = functional.grid_sample(self.previous, grid, padding_mode="border", align_corners=False)
        current = self.current[:, :, ::every, ::every]
        return warped.reshape(batch, hypotheses, *current.shape[2:]) - current, inside


def _middles(pixels: int, like: Tensor) -> Tensor:
    """Middles of pixels in a row, -1..1 from edge to edge of the picture, as grid_sample counts."""
    return (2 * torch.arange(pixels, device=like.device, dtype=like.dtype) + 1) / pixels - 1


def _conv(taken: int, dilation: int = 1) -> tuple[nn.Module, ...]:
    kernel = nn.Conv2d(taken, WIDTH, 3, padding=dilation, dilation=dilation, bias=False)
    return kernel, nn.BatchNorm2d(WIDTH), nn.ReLU(inplace=True)
