"""DepthNet's layers: names, shapes and sizes by hand from the paper's figure, then what flows through them."""

import pytest
import torch

from flightdepth.architectures import DepthNet

# Feature maps in and out of each layer of the paper's figure (with its two slips mended).
CONVS = {
    "conv1": (6, 32),
    "conv2": (32, 64),
    "conv3": (64, 128),
    "conv3_1": (128, 128),
    "conv4": (128, 256),
    "conv4_1": (256, 256),
    "conv5": (256, 256),
    "conv5_1": (256, 256),
    "conv6": (256, 512),
    "conv6_1": (512, 512),
}
DECONVS = {"deconv5": (512, 256), "deconv4": (513, 128), "deconv3": (385, 64), "deconv2": (193, 32)}
PREDICTIONS = {
    "predict_depth6": 512,
    "predict_depth5": 513,
    "predict_depth4": 385,
    "predict_depth3": 193,
    "predict_depth2": 97,
}
DOUBLINGS = (
    "upsampled_depth6_to_5",
    "upsampled_depth5_to_4",
    "upsampled_depth4_to_3",
    "upsampled_depth3_to_2",
)


def batch_norm(name, maps):
    vectors = {f"{name}.{key}": (maps,) for key in ("weight", "bias", "running_mean", "running_var")}
    return vectors | {f"{name}.num_batches_tracked": ()}


def expected_shapes():
    shapes = {}
    for name, (inputs, outputs) in CONVS.items():
        shapes |= {f"{name}.0.weight": (outputs, inputs, 3, 3), **batch_norm(f"{name}.1", outputs)}
    for name, (inputs, outputs) in DECONVS.items():
        shapes |= {f"{name}.0.weight": (inputs, outputs, 4, 4), f"{name}.0.bias": (outputs,)}
        shapes |= {f"{name}.1.weight": (outputs, outputs, 3, 3), **batch_norm(f"{name}.2", outputs)}
    for name, inputs in PREDICTIONS.items():
        shapes |= {f"{name}.weight": (1, inputs, 3, 3), f"{name}.bias": (1,)}
    return shapes | {f"{name}.weight": (1, 1, 4, 4) for name in DOUBLINGS}


@pytest.fixture
def small():
    torch.manual_seed(0)
    return DepthNet(4)


def pictures(height=64, width=64, batch=2):
    return torch.randn((batch, 6, height, width), generator=torch.Generator().manual_seed(1))


def test_keys_and_shapes_are_those_of_the_public_code():
    found = {key: tuple(value.shape) for key, value in DepthNet(32).state_dict().items()}
    assert found == expected_shapes()


@pytest.mark.parametrize(("base_width", "parameters"), [(32, 10_290_473), (16, 2_579_401)])
def test_parameters(base_width, parameters):
    assert sum(p.numel() for p in DepthNet(base_width).parameters()) == parameters


def parameters_by_hand(width):
    """From the figure, with all feature maps scaled by width / 32; the six input channels and depth maps stay."""

    def maps(count):
        share, odd = divmod(count, 32)
        return 6 if count == 6 else share * width + odd

    convs = sum(maps(o) * (maps(i) * 9 + 2) for i, o in CONVS.values())  # 2: batch norm
    deconvs = sum(maps(o) * (maps(i) * 16 + 1 + maps(o) * 9 + 2) for i, o in DECONVS.values())
    return convs + deconvs + sum(maps(i) * 9 + 1 for i in PREDICTIONS.values()) + 16 * len(DOUBLINGS)


@pytest.mark.parametrize("activation", ["elu+1", "none"])
@pytest.mark.parametrize("width", [4, 8, 16, 24, 32, 48])
def test_parameters_of_variants(width, activation):
    with torch.device("meta"):
        network = DepthNet(width, activation)
    assert sum(p.numel() for p in network.parameters()) == parameters_by_hand(width)


@pytest.mark.parametrize(("height", "width"), [(64, 64), (128, 192)])
def test_five_scales_finest_first(small, height, width):
    shapes = [tuple(depth.shape) for depth in small(pictures(height, width))]
    assert shapes == [(2, height // scale, width // scale) for scale in (4, 8, 16, 32, 64)]


def test_gradient_reaches_every_parameter(small):
    sum(depth.square().sum() for depth in small(pictures(128, 128))).backward()
    without = [name for name, p in small.named_parameters() if p.grad is None or not p.grad.abs().any()]
    assert without == []


def with_bias(network, bias):
    """All depths before the activation are `bias`."""
    with torch.no_grad():
        for name in PREDICTIONS:
            getattr(network, name).weight.zero_()
            getattr(network, name).bias.fill_(bias)
    return network.eval()


def test_elu_plus_1_is_positive(small):
    depths = with_bias(small, -5)(pictures())
    assert all(torch.allclose(depth, torch.tensor(-5.0).exp()) for depth in depths)


def test_elu_plus_1_adds_1_above_0(small):
    assert all((depth == 31).all() for depth in with_bias(small, 30)(pictures()))


def test_no_activation_leaves_the_output_alone():
    assert all((depth == -5).all() for depth in with_bias(DepthNet(4, "none"), -5)(pictures()))


def test_pictures_of_a_batch_do_not_mix_in_evaluation(small):
    small.eval()
    together, alone = small(pictures())[0], small(pictures()[1:])[0]
    assert torch.allclose(together[1:], alone, rtol=1e-4, atol=1e-5)


def test_a_shift_by_the_stride_shifts_the_answer(small):
    """Convolutions all the way: 64 px in the input are 16 px at the finest scale, away from the borders."""
    small.eval()
    wide = pictures(64, 1280, 1)
    moved = torch.roll(wide, 64, dims=3)
    kept = slice(152, 168)  # the middle: the receptive field reaches some 400 px to either side
    shifted = slice(kept.start + 16, kept.stop + 16)
    assert torch.allclose(small(wide)[0][..., kept], small(moved)[0][..., shifted], rtol=1e-3, atol=1e-3)
