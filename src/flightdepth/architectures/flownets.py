"""FlowNetS (Dosovitskiy et al. 2015, FlowNetSimple) with one channel of depth where it had two of flow.

As its paper draws it: kernels of 7 and 5 pixels first, twice DepthNet's feature maps, no batch norm, LeakyReLU. What
the layers are called follows DepthNet; sizes, slope and initialisation follow the public PyTorch code, the biases
the published network.
"""

from __future__ import annotations

from torch import Tensor, nn

from flightdepth.architectures.depthnet import Activation, EncoderDecoder

SLOPE = 0.1  # of LeakyReLU below 0


def leaky_conv(inputs: int, outputs: int, kernel: int, stride: int = 1) -> nn.Sequential:
    """Convolution, LeakyReLU."""
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2), nn.LeakyReLU(SLOPE, inplace=True)
    )


def leaky_deconv(inputs: int, outputs: int) -> nn.Sequential:
    """4x4 transposed convolution that doubles the size, LeakyReLU."""
    return nn.Sequential(nn.ConvTranspose2d(inputs, outputs, 4, 2, 1), nn.LeakyReLU(SLOPE, inplace=True))


def he_normal_leaky(network: nn.Module) -> None:
    """He's normal initialisation by fan-in for the slope, biases 0."""
    for module in network.modules():
        if isinstance(module, nn.Conv2d | nn.ConvTranspose2d):
            nn.init.kaiming_normal_(module.weight, SLOPE)
            if module.bias is not None:
                nn.init.zeros_(module.bias)


class FlowNetS(EncoderDecoder):
    """Images to depth, as DepthNet. `base_width` 64 is the published network (38.6 M parameters)."""

    def __init__(self, base_width: int = 64, activation: Activation = "elu+1") -> None:
        super().__init__()
        self.activation = activation
        w = base_width
        self.conv1 = leaky_conv(6, w, 7, 2)
        self.conv2 = leaky_conv(w, 2 * w, 5, 2)
        self.conv3 = leaky_conv(2 * w, 4 * w, 5, 2)
        self.conv3_1 = leaky_conv(4 * w, 4 * w, 3)
        self.conv4 = leaky_conv(4 * w, 8 * w, 3, 2)
        self.conv4_1 = leaky_conv(8 * w, 8 * w, 3)
        self.conv5 = leaky_conv(8 * w, 8 * w, 3, 2)
        self.conv5_1 = leaky_conv(8 * w, 8 * w, 3)
        self.conv6 = leaky_conv(8 * w, 16 * w, 3, 2)
        self.conv6_1 = leaky_conv(16 * w, 16 * w, 3)
        self.deconv5 = leaky_deconv(16 * w, 8 * w)
        self.deconv4 = leaky_deconv(16 * w + 1, 4 * w)
        self.deconv3 = leaky_deconv(12 * w + 1, 2 * w)
        self.deconv2 = leaky_deconv(6 * w + 1, w)
        self.add_heads(w)
        he_normal_leaky(self)

    def forward(self, images: Tensor) -> list[Tensor]:
        """Normalised images [B, 6, H, W] to depth in metres at D0, finest first.

        [B, H/4, W/4], [B, H/8, W/8] ... [B, H/64, W/64]; H and W are multiples of 64.
        """
        return self.depths_of(images, self.activation)
