"""MotionNet: DepthNet's trunk, fed with a plane sweep along the known motion instead of the earlier picture.

What DepthNet must learn from the weights up, which patch went where, the sweep lays open: at the right depth
the earlier picture, warped, equals the present one. The network sees the present picture, the differences to
the warped ones (signed, for parts of a pixel, and absolute means over 4x4 pixels, for texture) on pictures of
full, half and quarter size, and the motion field that says how far a pixel can have moved. No direction, focal
length or principal point is built into the weights. A plain convolutional graph: the warping is done before it.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from flightdepth.architectures.depthnet import Trunk, activated, he_normal, predict_depth
from flightdepth.sweep import LEVELS

CONTRAST = 20 / 255  # a difference of grey that counts as one
GREY = (0.299, 0.587, 0.114)  # as cv2.COLOR_RGB2GRAY


class MotionNet(Trunk):
    """Sweeps to depth and its spread. `base_width` as of DepthNet: 32, or 16 for the tiny one."""

    def __init__(self, base_width: int = 32) -> None:
        fine, half, quarter = (len(level.shifts_px) for level in LEVELS)
        super().__init__(base_width, (3 + fine, fine + half, half + quarter + 2, quarter))
        self.predict_spread2 = predict_depth(3 * base_width + 1)
        he_normal(self.predict_spread2)

    def forward(
        self, current: Tensor, fine: Tensor, half: Tensor, quarter: Tensor, field: Tensor
    ) -> tuple[list[Tensor], Tensor]:
        """Depths in metres at D0 and the reference focal length, finest first, as DepthNet's; then their spread.

        current [B, 3, H, W], fine [B, k, H, W], half [B, k, H/2, W/2], quarter [B, k, H/4, W/4]: 0..1;
        field [B, 2, H/4, W/4]. The spread, [B, H/4, W/4] in metres, is of the finest depth.
        """
        grey = GREY[0] * current[:, 0:1] + GREY[1] * current[:, 1:2] + GREY[2] * current[:, 2:3]
        fine, half, quarter = (
            (swept - functional.avg_pool2d(grey, scale) if scale > 1 else swept - grey) / CONTRAST
            for swept, scale in ((fine, 1), (half, 2), (quarter, 4))
        )
        skip1 = self.conv1(torch.cat(((current - 0.5) / 0.2, fine), 1))
        skip2 = self.conv2(torch.cat((skip1, _cost(fine), half), 1))
        skip3 = self.conv3_1(self.conv3(torch.cat((skip2, _cost(half), quarter, field), 1)))
        skip4 = self.conv4_1(self.conv4(torch.cat((skip3, _cost(quarter)), 1)))
        raw, features = self.decoded(skip2, skip3, skip4)
        depths = [activated(depth, "elu+1") for depth in raw]
        share = functional.softplus(self.predict_spread2(features)[:, 0].float())
        return depths, share * depths[0].detach()


def _cost(difference: Tensor) -> Tensor:
    """Mean absolute difference over 4x4 pixels, at half the size; a convolution is faster than pooling in OpenVINO."""
    channels = difference.shape[1]
    box = difference.new_full((channels, 1, 4, 4), 1 / 16)
    return functional.conv2d(difference.abs(), box, stride=2, padding=1, groups=channels)
