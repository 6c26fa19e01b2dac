"""MotionNet: DepthNet's trunk, fed with a plane sweep along the known motion instead of the earlier picture.

What DepthNet must learn from the weights up, which patch went where, the sweep lays open: at the right depth
the earlier picture, warped, equals the present one. The network sees the present picture, the differences to
the warped ones (signed, for parts of a pixel, and absolute means over 4x4 pixels, for texture) on pictures of
full, half and quarter size, and the motion field that says how far a pixel can have moved. No direction, focal
length or principal point is built into the weights. A plain convolutional graph: the warping is done before it.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from flightdepth.architectures.depthnet import conv, deconv, double_depth, he_normal, predict_depth
from flightdepth.sweep import LEVELS

CONTRAST = 20 / 255  # a difference of grey that counts as one
GREY = (0.299, 0.587, 0.114)  # as cv2.COLOR_RGB2GRAY


class MotionNet(nn.Module):
    """Sweeps to depth and its spread. `base_width` as of DepthNet: 32, or 16 for the tiny one."""

    def __init__(self, base_width: int = 32) -> None:
        super().__init__()
        w = base_width
        fine, half, quarter = (len(level.shifts_px) for level in LEVELS)
        self.conv1 = conv(3 + fine, w, 2)
        self.conv2 = conv(w + fine + half, 2 * w, 2)
        self.conv3 = conv(2 * w + half + quarter + 2, 4 * w, 2)
        self.conv3_1 = conv(4 * w, 4 * w)
        self.conv4 = conv(4 * w + quarter, 8 * w, 2)
        self.conv4_1 = conv(8 * w, 8 * w)
        self.conv5 = conv(8 * w, 8 * w, 2)
        self.conv5_1 = conv(8 * w, 8 * w)
        self.conv6 = conv(8 * w, 16 * w, 2)
        self.conv6_1 = conv(16 * w, 16 * w)
        self.deconv5 = deconv(16 * w, 8 * w)
        self.deconv4 = deconv(16 * w + 1, 4 * w)
        self.deconv3 = deconv(12 * w + 1, 2 * w)
        self.deconv2 = deconv(6 * w + 1, w)
        self.predict_depth6 = predict_depth(16 * w)
        self.predict_depth5 = predict_depth(16 * w + 1)
        self.predict_depth4 = predict_depth(12 * w + 1)
        self.predict_depth3 = predict_depth(6 * w + 1)
        self.predict_depth2 = predict_depth(3 * w + 1)
        self.predict_spread2 = predict_depth(3 * w + 1)
        self.upsampled_depth6_to_5 = double_depth()
        self.upsampled_depth5_to_4 = double_depth()
        self.upsampled_depth4_to_3 = double_depth()
        self.upsampled_depth3_to_2 = double_depth()
        he_normal(self)

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
        skip5 = self.conv5_1(self.conv5(skip4))
        features = self.conv6_1(self.conv6(skip5))
        raw = [self.predict_depth6(features)]
        for skip, up, double, predict in (
            (skip5, self.deconv5, self.upsampled_depth6_to_5, self.predict_depth5),
            (skip4, self.deconv4, self.upsampled_depth5_to_4, self.predict_depth4),
            (skip3, self.deconv3, self.upsampled_depth4_to_3, self.predict_depth3),
            (skip2, self.deconv2, self.upsampled_depth3_to_2, self.predict_depth2),
        ):
            features = torch.cat((skip, up(features), double(raw[-1])), dim=1)
            raw.append(predict(features))
        depths = [functional.elu(depth[:, 0].float()) + 1 for depth in reversed(raw)]
        share = functional.softplus(self.predict_spread2(features)[:, 0].float())
        return depths, share * depths[0].detach()


def _cost(difference: Tensor) -> Tensor:
    """Mean absolute difference over 4x4 pixels, at half the size; a convolution is faster than pooling in OpenVINO."""
    channels = difference.shape[1]
    box = difference.new_full((channels, 1, 4, 4), 1 / 16)
    return functional.conv2d(difference.abs(), box, stride=2, padding=1, groups=channels)
