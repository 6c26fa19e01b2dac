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
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from flightdepth.architectures.depthnet import beside

BLOCK = 4  # pixels of the pictures across a pixel of depth
MIDDLE = (BLOCK - 1) / 2  # of a block, where a pixel of depth lies
STEP = math.log(1.3)  # between the hypotheses, in log of the shift
LEAST_GRADIENT = 0.01  # squared, contrasts between the hypotheses on either side
NEAREST_SHARE, FARTHEST_SHARE = 0.003, 1.4  # of the largest depth: what can be refined at all
LEAST_AHEAD = 0.05  # of its depth now, that a point may have had in the earlier picture
NEIGHBOURHOOD = 5  # pixels of depth across, which hold both sides of an edge nearby
SQUEEZED, WIDTH = 16, 32
CANDIDATES = 6  # the five hypotheses, and the second corrected
CLUES = 14
OFF_GAIN, GRADIENT_GAIN, SHIFT_GAIN = 2, 0.3, 0.5  # which bring these clues to the size of the others
QUARTERS = 4 * 5  # further clues of a thorough look: for each hypothesis
FAR_AROUND = 4  # dilation of its last convolution, pixels of depth
FIRST_TRUST = 3.0  # in the corrected hypothesis before anything is learnt, a logit: the others have 0
FREE_GAIN = 0.3  # log of the shift: what is added to the candidates' mean, where the network answers 1


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
            self.head.bias[CANDIDATES - 1] = FIRST_TRUST  # begin with the corrected one

    def forward(
        self, depth: Tensor, spread: Tensor, features: Tensor, difference: Difference
    ) -> tuple[Tensor, Tensor]:
        """Look once; depth and its spread come back better, [B, h, w] each, in the same metres.

        depth, spread  [B, h, w] in metres at D0 and the reference focal length; no gradient goes back into depth
        features       [B, k, h, w] of the trunk
        difference     of pictures that are BLOCK times as large
        """
        depth = depth.detach().clamp(*self.range_m)
        shift = torch.log(self.shift_px_m / depth)[:, None]
        near, far = _nearest_and_farthest(shift)
        hypotheses = torch.cat((shift - STEP, shift, shift + STEP, near, far), 1)
        left, inside = difference(torch.exp(hypotheses))
        block = BLOCK // difference.every
        off, square = _correction(left, inside, block)
        apart = left.abs()
        clues = [
            functional.avg_pool2d(apart, block) * inside,
            OFF_GAIN * off,
            GRADIENT_GAIN * torch.log1p(square / LEAST_GRADIENT),
            near - shift,
            far - shift,
            SHIFT_GAIN * shift,
            spread[:, None] / depth[:, None],
            difference.field,
            inside[:, 1:2],
        ]
        quarters = _quarters(apart, inside, block) if self.thorough else []
        answer = self._answer(beside(torch.cat(clues, 1), self.squeeze(features), *quarters))
        return self._refined(answer, torch.cat((hypotheses, shift + 2 * STEP * off), 1))

    def _answer(self, clues: Tensor) -> Tensor:
        """Clues [B, k, h, w] to a logit of each candidate, a change of the shift's log, a spread: [B, 8, h, w]."""
        seen = self.trunk(clues)
        if self.thorough:
            seen = functional.relu(seen + self.around(seen))
        answer: Tensor = self.head(seen)
        return answer

    def _refined(self, answer: Tensor, candidates: Tensor) -> tuple[Tensor, Tensor]:
        """Depth and spread in metres, [B, h, w] each, of the answer and the candidates, logs of shifts [B, 6, h, w]."""
        weights = answer[:, :CANDIDATES].softmax(1)
        refined = (weights * candidates).sum(1) + FREE_GAIN * answer[:, CANDIDATES]
        refined_m = self.shift_px_m * torch.exp(-refined)
        return refined_m, functional.softplus(answer[:, CANDIDATES + 1]) * refined_m.detach()


def _nearest_and_farthest(shift: Tensor) -> tuple[Tensor, Tensor]:
    """The largest and the smallest shift around each pixel, [B, 1, h, w] as `shift`."""
    reach = functional.pad(shift, (NEIGHBOURHOOD // 2,) * 4, mode="replicate")
    near = functional.max_pool2d(reach, NEIGHBOURHOOD, 1)
    far = -functional.max_pool2d(-reach, NEIGHBOURHOOD, 1)
    return near, far


def _correction(left: Tensor, inside: Tensor, block: int) -> tuple[Tensor, Tensor]:
    """By how much the second hypothesis is off, and how well that is known, [B, 1, h, w] each.

    left, inside  what `Difference` gives for the hypotheses; `block` pixels of `left` across a pixel of depth

    The difference is taken for r + g x, where x is 0 at the second hypothesis and grows by 1 from the first to the
    third. Least squares over a block gives x = -<r g> / <g g> (Lucas and Kanade 1981), of which -1..1 is believed; it
    comes back with <g g>, squared contrasts.
    """
    # Means over blocks of 4x4 pixels. A convolution is faster in OpenVINO, but in bf16 costs 7 % of the error:
    # `runtimes.block_means` makes them one where that is not asked for.
    gradient = left[:, 2:3] - left[:, 0:1]
    square = functional.avg_pool2d(gradient * gradient, block) * inside[:, 1:2]
    product = functional.avg_pool2d(gradient * left[:, 1:2], block) * inside[:, 1:2]
    return (-product / (square + LEAST_GRADIENT)).clamp(-1, 1), square


def _quarters(apart: Tensor, inside: Tensor, block: int) -> list[Tensor]:
    """Absolute differences in the quarters of each block, upper left and right, lower left and right: [B, k, h, w]."""
    quarters = functional.avg_pool2d(apart, block // 2)
    return [quarters[:, :, row::2, column::2] * inside for row in (0, 1) for column in (0, 1)]


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
        field = _LinearField.of(self.field)
        scale = shift_px / (1 + shift_px * field.closing).clamp_min(LEAST_AHEAD)
        inside = self._inside(scale)
        grid = self._sampling_grid(scale, field)
        # All hypotheses of a picture below one another, so that the picture is not copied.
        warped = functional.grid_sample(
            self.previous, grid.flatten(1, 2), padding_mode="border", align_corners=False
        )
        current = self.current[:, :, :: self.every, :: self.every]
        return warped.reshape(*scale.shape[:2], *current.shape[2:]) - current, inside

    def _inside(self, scale: Tensor) -> Tensor:
        """1 where the earlier picture holds what is `scale` (as in `_sampling_grid`) along the field, else 0."""
        rows, columns = scale.shape[2:]
        x = _middles(columns, scale) + scale * self.field[:, 0:1] * (2 / (BLOCK * columns))
        y = _middles(rows, scale)[:, None] + scale * self.field[:, 1:2] * (2 / (BLOCK * rows))
        return ((x.abs() < 1) & (y.abs() < 1)).to(scale.dtype)

    def _sampling_grid(self, scale: Tensor, field: _LinearField) -> Tensor:
        """Where the earlier picture is looked at, -1..1 as grid_sample counts: [B, k, H / every, W / every, (x, y)].

        scale  pixels that a point moves where the field is 1, [B, k, H/4, W/4]
        """
        every, height, width = self.every, BLOCK * scale.shape[2], BLOCK * scale.shape[3]
        column = torch.arange(0, width, every, device=scale.device, dtype=scale.dtype)[:, None]
        row = torch.arange(0, height, every, device=scale.device, dtype=scale.dtype)[:, None, None]
        # [B, 1, 1, W / every, 1] and [B, 1, H / every, 1, 1]
        across = field.across(column)[:, :, None] * (2 / width)
        down = field.down(row[None])[:, None] * (2 / height)
        # Written as one sum over (x, y), so that no picture of coordinates is copied.
        second = torch.arange(2, device=scale.device, dtype=scale.dtype)
        first = 1 - second
        moves = across * first + down * second
        stands = (
            _middles(width, scale)[::every, None] * first
            + _middles(height, scale)[::every, None, None] * second
        )
        large = functional.interpolate(scale, scale_factor=BLOCK // every, mode="nearest")[..., None]
        return stands + large * moves


@dataclass(frozen=True)
class _LinearField:
    """A motion field by its value at the first pixel of depth and its growth by pixel of the pictures: it is linear.

    left, top         what moves across at the first column, and down at the first row, [B, 1, 1, 1] each
    closing, sinking  by how much a column moves less across than the one before, and a row more down; the first is
                      d_z / fx, the second -d_z / fy
    """

    left: Tensor
    top: Tensor
    closing: Tensor
    sinking: Tensor

    @classmethod
    def of(cls, field: Tensor) -> _LinearField:
        """Read off a field [B, 2, h, w], whose pixels lie in the middle of blocks of the pictures'."""
        # Indices, not slices, leave sizes free.
        left, right = field[:, 0, 0, 0].view(-1, 1, 1, 1), field[:, 0, 0, 1].view(-1, 1, 1, 1)
        top, below = field[:, 1, 0, 0].view(-1, 1, 1, 1), field[:, 1, 1, 0].view(-1, 1, 1, 1)
        return cls(left, top, (left - right) / BLOCK, (below - top) / BLOCK)

    def across(self, column: Tensor) -> Tensor:
        """The field's first part in columns of the pictures, counted from 0."""
        return self.left - self.closing * (column - MIDDLE)

    def down(self, row: Tensor) -> Tensor:
        """Its second part in rows of them."""
        return self.top + self.sinking * (row - MIDDLE)


def _middles(pixels: int, like: Tensor) -> Tensor:
    """Middles of pixels in a row, -1..1 from edge to edge of the picture, as grid_sample counts."""
    return (2 * torch.arange(pixels, device=like.device, dtype=like.dtype) + 1) / pixels - 1


def _conv(taken: int, dilation: int = 1) -> tuple[nn.Module, ...]:
    kernel = nn.Conv2d(taken, WIDTH, 3, padding=dilation, dilation=dilation, bias=False)
    return kernel, nn.BatchNorm2d(WIDTH), nn.ReLU(inplace=True)
