"""MotionNet: DepthNet's trunk, fed with a plane sweep along the known motion instead of the earlier picture.

What DepthNet must learn from the weights up, which patch went where, the sweep lays open: at the right depth
the earlier picture, warped, equals the present one. The network sees the present picture and, of the sweep on
pictures of full, half and quarter size, the mean absolute differences, the signed ones (not at full size), and
for each hypothesis that stands between two others by how much Lucas and Kanade's method would correct it, which
tells parts of a pixel. The motion field says how far a pixel can have moved at all. No direction, focal length or
principal point is built into the weights. A plain convolutional graph: the warping is done before it.
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor, nn
from torch.nn import functional

from flightdepth.architectures.depthnet import (
    BATCH_NORM_EPS,
    Trunk,
    activated,
    beside,
    conv,
    he_normal,
    predict_depth,
)
from flightdepth.architectures.refinement import Difference, Refinement
from flightdepth.levels import GREY
from flightdepth.sweep import LEVELS

# Layers whose maps a residual block looks at again, and how many maps they have, in base widths.
RESIDUAL = {"conv4_1": 8, "conv5_1": 8, "conv6_1": 16, "deconv5": 8, "deconv4": 4, "deconv3": 2}
SCALE = 4  # the last of a block's parts, which scales what it adds
CONTRAST = 20 / 255  # a difference of grey that counts as one
# Per level: hypotheses that are corrected; not the first (nothing moves there) and not the last.
CORRECTED = ((1, 2, 4), (1, 2, 3, 4), (1, 2, 3, 4, 5))
LEAST_GRADIENT = 0.05  # squared, contrasts a pixel: what a correction is divided by in a blank wall
LARGEST_CORRECTION = 2.0  # in distances between the hypotheses on either side


class MotionNet(Trunk):
    """Sweeps to depth and its spread.

    base_width            as of DepthNet: 32, or 16 for the tiny one
    shift_px_m, largest_m  of `Refinement`
    looks                  how many times depth is refined, by the same weights; all but the last look at a
                           quarter of the pixels, which costs less than 1 % of the error's size
    thorough_last_look     whether the last one has weights of its own, and sees more
    residual_blocks        whether the trunk has residual blocks, from 1/8 of the size down, where they cost little
    """

    grey: Tensor

    def __init__(
        self,
        base_width: int = 32,
        *,
        shift_px_m: float = 38.4,
        largest_m: float = 100.0,
        looks: int = 1,
        thorough_last_look: bool = False,
        residual_blocks: bool = False,
    ) -> None:
        fine, half, quarter = (len(level.shifts_px) for level in LEVELS)
        more = [2 * len(corrected) for corrected in CORRECTED]
        taken = (3, fine + half + more[0], half + quarter + 2 + more[1], quarter + more[2])
        super().__init__(base_width, taken)
        if residual_blocks:
            for layer, widths in RESIDUAL.items():
                self.get_submodule(layer).append(ResidualBlock(widths * base_width))  # type: ignore[operator]
        # Kept where the weights are: a step that takes numbers from Python can't be recorded (`training.graph`).
        self.register_buffer("grey", torch.tensor(GREY), persistent=False)
        self.corrections = nn.ModuleList(Corrections(level) for level in range(len(LEVELS)))
        self.predict_spread2 = predict_depth(3 * base_width + 1)
        he_normal(self.predict_spread2)
        if looks > 1 or not thorough_last_look:
            self.refinement = Refinement(3 * base_width + 1, shift_px_m, largest_m)
        self.looks = looks
        if thorough_last_look:
            self.last_look = Refinement(3 * base_width + 1, shift_px_m, largest_m, thorough=True)
        self.thorough_last_look = thorough_last_look

    def forward(
        self, current: Tensor, fine: Tensor, half: Tensor, quarter: Tensor, field: Tensor
    ) -> tuple[list[Tensor], Tensor]:
        """Depths in metres at D0 and the reference focal length, the refined ones, the last look's first, then
        finest first as DepthNet's.

        current [B, 3, H, W], fine [B, k, H, W], half [B, k, H/2, W/2], quarter [B, k, H/4, W/4]: 0..1;
        field [B, 2, H/4, W/4]. Then the spread, [B, H/4, W/4] in metres, of the first.
        """
        earlier = fine[:, 0:1]  # not shifted
        grey = (current * self.grey.view(1, 3, 1, 1)).sum(1, keepdim=True)
        fine, half, quarter = (
            (swept - functional.avg_pool2d(grey, scale) if scale > 1 else swept - grey) / CONTRAST
            for swept, scale in ((fine, 1), (half, 2), (quarter, 4))
        )
        skip1 = self.conv1((current - 0.5) / 0.2)
        skip2 = self.conv2(beside(skip1, _cost(fine), half, self.corrections[0](fine)))
        skip3 = self.conv3(beside(skip2, _cost(half), quarter, field, self.corrections[1](half)))
        skip3 = self.conv3_1(skip3)
        skip4 = self.conv4_1(self.conv4(beside(skip3, _cost(quarter), self.corrections[2](quarter))))
        raw, features = self.decoded(skip2, skip3, skip4)
        depths = [activated(depth, "elu+1") for depth in raw]
        share = functional.softplus(self.predict_spread2(features)[:, 0].float())
        spread = share * depths[0].detach()
        pictures = earlier / CONTRAST, grey / CONTRAST, field
        for look in range(self.looks):  # only the last at every pixel
            is_last = look == self.looks - 1
            refine = self.last_look if is_last and self.thorough_last_look else self.refinement
            difference = Difference(*pictures, every=1 if is_last else 2)
            refined, spread = refine(depths[0], spread, features, difference)
            depths.insert(0, refined)
        return depths, spread


class ResidualBlock(nn.Module):
    """Adds what two convolutions make of its maps (He et al. 2016); nothing at first, so that a trained network that is
    given some goes on from where it was.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.added = nn.Sequential(
            *conv(channels, channels),
            nn.Conv2d(channels, channels, 3, 1, 1, bias=False),
            nn.BatchNorm2d(channels, eps=BATCH_NORM_EPS),
        )
        he_normal(self.added)
        nn.init.zeros_(self.added[SCALE].weight)  # type: ignore[arg-type]

    def forward(self, maps: Tensor) -> Tensor:
        """[B, channels, h, w], not negative, to the same."""
        return functional.relu(maps + self.added(maps))


def silent_blocks(weights: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The residual blocks of a state dict, their last scale and shift set to 0: so they add nothing."""
    last = tuple(f".added.{SCALE}.{part}" for part in ("weight", "bias"))
    blocks = {name: each for name, each in weights.items() if ".added." in name}
    return {name: torch.zeros_like(each) if name.endswith(last) else each for name, each in blocks.items()}


class Corrections(nn.Module):
    """By how much the hypotheses CORRECTED of a level are off, and how well that is known; at half the size.

    Around hypothesis s the difference is r + g ds with g, its change by hypothesis, from the neighbours on either side;
    over a window of 4x4 pixels least squares gives ds = -<r g> / <g g> (Lucas and Kanade 1981, along a known line).
    """

    before: Tensor
    middle: Tensor
    after: Tensor
    apart_px: Tensor

    def __init__(self, level: int) -> None:
        super().__init__()
        middle = torch.tensor(CORRECTED[level])
        shifts_px = torch.tensor(LEVELS[level].shifts_px, dtype=torch.float32)
        apart_px = shifts_px[middle + 1] - shifts_px[middle - 1]
        self.register_buffer("before", middle - 1, persistent=False)
        self.register_buffer("middle", middle, persistent=False)
        self.register_buffer("after", middle + 1, persistent=False)
        self.register_buffer("apart_px", apart_px, persistent=False)

    def forward(self, difference: Tensor) -> Tensor:
        """Warped minus present picture [B, hypotheses, h, w] to [B, 2k, h/2, w/2]: ds in distances between the
        neighbours, then the logarithm of what it was divided by."""
        apart_px = self.apart_px.view(1, -1, 1, 1)
        around = difference.index_select(1, self.after) - difference.index_select(1, self.before)
        gradient = around / apart_px
        square = _mean(gradient * gradient)
        product = _mean(gradient * difference.index_select(1, self.middle))
        off = -product / (square + LEAST_GRADIENT) / apart_px
        known = 0.3 * torch.log1p(square * apart_px**2 / LEAST_GRADIENT)
        return torch.cat((off.clamp(-LARGEST_CORRECTION, LARGEST_CORRECTION), known), 1)


def _cost(difference: Tensor) -> Tensor:
    """Mean absolute difference over 4x4 pixels, at half the size."""
    return _mean(difference.abs())


def _mean(maps: Tensor) -> Tensor:
    """Mean over 4x4 pixels, at half the size; a convolution is faster than pooling in OpenVINO."""
    channels = maps.shape[1]
    box = maps.new_full((channels, 1, 4, 4), 1 / 16)
    return functional.conv2d(maps, box, stride=2, padding=1, groups=channels)
