"""DepthNet (Pinard et al. 2017, figure 5): an encoder, a decoder with skips, and depth at five scales.

The names of the layers follow the authors' public PyTorch code, so state dicts move both ways. Two slips in
the figure are mended: the last two upsampled depths are at 1/8 and 1/4, and Conv2 joins Deconv2.
"""

from __future__ import annotations

from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn import functional

Activation = Literal["elu+1", "none"]
BATCH_NORM_EPS = 1e-3


def conv(inputs: int, outputs: int, stride: int = 1) -> nn.Sequential:
    """3x3 convolution, batch norm, ReLU."""
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False),
        nn.BatchNorm2d(outputs, eps=BATCH_NORM_EPS),
        nn.ReLU(inplace=True),
    )


def deconv(inputs: int, outputs: int) -> nn.Sequential:
    """4x4 transposed convolution that doubles the size, 3x3 convolution, batch norm, ReLU."""
    return nn.Sequential(
        nn.ConvTranspose2d(inputs, outputs, 4, 2, 1),
        nn.Conv2d(outputs, outputs, 3, 1, 1, bias=False),
        nn.BatchNorm2d(outputs, eps=BATCH_NORM_EPS),
        nn.ReLU(inplace=True),
    )


def beside(*maps: Tensor) -> Tensor:
    """Maps [B, k, h, w] of one size joined along k, channels last in memory, as convolutions take them; k of 2 or more.

    Joined as they come, of both layouts, they would be laid out anew by a convolution, and again for its gradient. Of
    a single map torch can't tell the layout. Without gradients they are joined as they come: what was measured stays.
    """
    if not torch.is_grad_enabled():
        return torch.cat(maps, dim=1)
    return torch.cat([each.contiguous(memory_format=torch.channels_last) for each in maps], dim=1)


def predict_depth(inputs: int) -> nn.Conv2d:
    """3x3 convolution to one channel: depth in metres before the activation."""
    return nn.Conv2d(inputs, 1, 3, 1, 1)


def double_depth() -> nn.ConvTranspose2d:
    """Learned upsampling of a depth map to twice its size."""
    return nn.ConvTranspose2d(1, 1, 4, 2, 1, bias=False)


def he_normal(network: nn.Module) -> None:
    """He's normal initialisation by fan-out, as in the authors' code."""
    for module in network.modules():
        if isinstance(module, nn.Conv2d | nn.ConvTranspose2d):
            fan_out = module.kernel_size[0] * module.kernel_size[1] * module.out_channels
            nn.init.normal_(module.weight, 0.0, (2 / fan_out) ** 0.5)
            if module.bias is not None:
                nn.init.zeros_(module.bias)


class EncoderDecoder(nn.Module):
    """The order of the layers, which FlowNetS and DepthNet share; what the layers are differs.

    Whoever inherits gives the layers, then calls `add_heads` with the base width w.
    """

    conv1: nn.Sequential
    conv2: nn.Sequential
    conv3: nn.Sequential
    conv3_1: nn.Sequential
    conv4: nn.Sequential
    conv4_1: nn.Sequential
    conv5: nn.Sequential
    conv5_1: nn.Sequential
    conv6: nn.Sequential
    conv6_1: nn.Sequential
    deconv5: nn.Sequential
    deconv4: nn.Sequential
    deconv3: nn.Sequential
    deconv2: nn.Sequential

    def add_heads(self, base_width: int) -> None:
        """Depth at five scales, and its upsampling between them."""
        w = base_width
        self.predict_depth6 = predict_depth(16 * w)
        self.predict_depth5 = predict_depth(16 * w + 1)
        self.predict_depth4 = predict_depth(12 * w + 1)
        self.predict_depth3 = predict_depth(6 * w + 1)
        self.predict_depth2 = predict_depth(3 * w + 1)
        self.upsampled_depth6_to_5 = double_depth()
        self.upsampled_depth5_to_4 = double_depth()
        self.upsampled_depth4_to_3 = double_depth()
        self.upsampled_depth3_to_2 = double_depth()

    def decoded(self, skip2: Tensor, skip3: Tensor, skip4: Tensor) -> tuple[list[Tensor], Tensor]:
        """The deepest layers, then back up to 1/4 of the size.

        Takes the encoder's features: skip2 [B, 2w, H/4, W/4], skip3 [B, 4w, H/8, W/8], skip4 [B, 8w, H/16, W/16].
        Returns depths before the activation, finest first, [B, 1, H/4, W/4] ... [B, 1, H/64, W/64], and the features
        that the finest is made of, [B, 3w + 1, H/4, W/4]: 2w of skip2, w of deconv2, and the depth at 1/8, upsampled.
        """
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
        return raw[::-1], features

    def depths_of(self, images: Tensor, activation: Activation) -> list[Tensor]:
        """Depths, finest first, of a network that takes nothing but a pair of pictures [B, 6, H, W]."""
        skip2 = self.conv2(self.conv1(images))
        skip3 = self.conv3_1(self.conv3(skip2))
        skip4 = self.conv4_1(self.conv4(skip3))
        raw, _ = self.decoded(skip2, skip3, skip4)
        return [activated(depth, activation) for depth in raw]


class Trunk(EncoderDecoder):
    """Six encoders, four decoders with skips, and depth at five scales: DepthNet but for what it takes and gives.

    `inputs`: feature maps that conv1, conv2, conv3 and conv4 take besides those of the layer before.
    """

    def __init__(self, base_width: int, inputs: tuple[int, int, int, int]) -> None:
        super().__init__()
        w = base_width
        self.conv1 = conv(inputs[0], w, 2)
        self.conv2 = conv(w + inputs[1], 2 * w, 2)
        self.conv3 = conv(2 * w + inputs[2], 4 * w, 2)
        self.conv3_1 = conv(4 * w, 4 * w)
        self.conv4 = conv(4 * w + inputs[3], 8 * w, 2)
        self.conv4_1 = conv(8 * w, 8 * w)
        self.conv5 = conv(8 * w, 8 * w, 2)
        self.conv5_1 = conv(8 * w, 8 * w)
        self.conv6 = conv(8 * w, 16 * w, 2)
        self.conv6_1 = conv(16 * w, 16 * w)
        self.deconv5 = deconv(16 * w, 8 * w)
        self.deconv4 = deconv(16 * w + 1, 4 * w)
        self.deconv3 = deconv(12 * w + 1, 2 * w)
        self.deconv2 = deconv(6 * w + 1, w)
        self.add_heads(w)
        he_normal(self)


def activated(raw: Tensor, activation: Activation) -> Tensor:
    """Depth [B, h, w] in float32, of a prediction [B, 1, h, w]."""
    depth = raw[:, 0].float()
    return functional.elu(depth) + 1 if activation == "elu+1" else depth


class DepthNet(Trunk):
    """Images to depth. `base_width` 32 is the paper's network (10.3 M parameters), 16 the tiny one (2.6 M)."""

    def __init__(self, base_width: int = 32, activation: Activation = "elu+1") -> None:
        super().__init__(base_width, (6, 0, 0, 0))
        self.activation = activation

    def forward(self, images: Tensor) -> list[Tensor]:
        """Normalised images [B, 6, H, W] to depth in metres at D0, finest first.

        [B, H/4, W/4], [B, H/8, W/8] ... [B, H/64, W/64]; H and W are multiples of 64.
        """
        return self.depths_of(images, self.activation)
