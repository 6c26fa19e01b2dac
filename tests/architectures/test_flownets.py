"""FlowNetS's layers: names, kernels and sizes by hand from its paper's figure 2, with one channel out."""

import pytest
import torch

from flightdepth.architectures import DepthNet, FlowNetS

# Feature maps in and out, pixels of the kernel (Dosovitskiy et al. 2015, FlowNetSimple).
CONVS = {
    "conv1": (6, 64, 7),
    "conv2": (64, 128, 5),
    "conv3": (128, 256, 5),
    "conv3_1": (256, 256, 3),
    "conv4": (256, 512, 3),
    "conv4_1": (512, 512, 3),
    "conv5": (512, 512, 3),
    "conv5_1": (512, 512, 3),
    "conv6": (512, 1024, 3),
    "conv6_1": (1024, 1024, 3),
}
# Those that take a map of flow or depth besides: features in, features out.
DECONVS = {
    "deconv5": (1024, 0, 512),
    "deconv4": (1024, 1, 256),
    "deconv3": (768, 1, 128),
    "deconv2": (384, 1, 64),
}
PREDICTIONS = {
    "predict_depth6": (1024, 0),
    "predict_depth5": (1024, 1),
    "predict_depth4": (768, 1),
    "predict_depth3": (384, 1),
    "predict_depth2": (192, 1),
}
DOUBLINGS = ("6_to_5", "5_to_4", "4_to_3", "3_to_2")


def parameters_by_hand(channels):
    """Of the published network with so many channels of flow, or one of depth."""
    convs = sum(i * o * k * k + o for i, o, k in CONVS.values())
    deconvs = sum((i + flow * channels) * o * 16 + o for i, flow, o in DECONVS.values())
    predictions = sum(((i + flow * channels) * 9 + 1) * channels for i, flow in PREDICTIONS.values())
    return convs + deconvs + predictions + len(DOUBLINGS) * 16 * channels**2


def expected_shapes():
    shapes = {}
    for name, (inputs, outputs, kernel) in CONVS.items():
        shapes |= {f"{name}.0.weight": (outputs, inputs, kernel, kernel), f"{name}.0.bias": (outputs,)}
    for name, (inputs, flow, outputs) in DECONVS.items():
        shapes |= {f"{name}.0.weight": (inputs + flow, outputs, 4, 4), f"{name}.0.bias": (outputs,)}
    for name, (inputs, flow) in PREDICTIONS.items():
        shapes |= {f"{name}.weight": (1, inputs + flow, 3, 3), f"{name}.bias": (1,)}
    return shapes | {f"upsampled_depth{name}.weight": (1, 1, 4, 4) for name in DOUBLINGS}


@pytest.fixture(scope="module")
def published():
    """The whole network, drawn once; nothing is computed with it."""
    with torch.device("meta"):
        return FlowNetS()


@pytest.fixture
def small():
    torch.manual_seed(0)
    return FlowNetS(4)


def pictures(height=64, width=64, batch=2):
    return torch.randn((batch, 6, height, width), generator=torch.Generator().manual_seed(1))


def test_two_channels_by_hand_are_the_published_number():
    assert parameters_by_hand(2) / 1e6 == pytest.approx(38.68, abs=0.005)


def test_parameters_with_one_channel(published):
    assert sum(p.numel() for p in published.parameters()) == parameters_by_hand(1) == 38_638_505


def test_it_is_heavier_than_depthnet_by_what_the_paper_says(published):
    """'5 times heavier' in the paper; 3.8 times by its own figures of layers."""
    ratio = parameters_by_hand(1) / sum(p.numel() for p in DepthNet(32).parameters())
    assert ratio == pytest.approx(3.75, abs=0.01)


def test_keys_and_shapes(published):
    assert {key: tuple(value.shape) for key, value in published.state_dict().items()} == expected_shapes()


@pytest.mark.parametrize(("height", "width"), [(64, 64), (128, 192)])
def test_five_scales_finest_first(small, height, width):
    shapes = [tuple(depth.shape) for depth in small(pictures(height, width))]
    assert shapes == [(2, height // scale, width // scale) for scale in (4, 8, 16, 32, 64)]


def test_gradient_reaches_every_parameter(small):
    sum(depth.square().sum() for depth in small(pictures(128, 128))).backward()
    without = [name for name, p in small.named_parameters() if p.grad is None or not p.grad.abs().any()]
    assert without == []


def test_pictures_of_a_batch_do_not_mix(small):
    together, alone = small(pictures())[0], small(pictures()[1:])[0]
    assert torch.allclose(together[1:], alone, rtol=1e-4, atol=1e-5)


def test_signals_keep_their_size_from_the_start():
    """He's initialisation for the slope: nothing fades or explodes over sixteen layers without batch norm."""
    torch.manual_seed(0)
    network, sizes = FlowNetS(16), {}
    for name in CONVS:
        getattr(network, name).register_forward_hook(
            lambda _, __, out, name=name: sizes.update({name: float(out.detach().std())})
        )
    network(pictures(128, 128))
    assert all(0.2 < size < 3 for size in sizes.values()), sizes
