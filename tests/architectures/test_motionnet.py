"""MotionNet: sizes by hand, which input reaches what, and that it does not care how the motion is written."""

import pytest
import torch

from flightdepth.architectures import DepthNet, MotionNet
from flightdepth.sweep import LEVELS

FINE, HALF, QUARTER = (len(level.shifts_px) for level in LEVELS)


@pytest.fixture
def small():
    torch.manual_seed(0)
    return MotionNet(4).eval()


def inputs(batch=2, height=64, width=128, seed=0):
    generator = torch.Generator().manual_seed(seed)
    sizes = [(3, 1), (FINE, 1), (HALF, 2), (QUARTER, 4), (2, 4)]
    return [torch.rand(batch, k, height // s, width // s, generator=generator) for k, s in sizes]


def parameters(network):
    return sum(p.numel() for p in network.parameters())


@pytest.mark.parametrize("width", [16, 32])
def test_parameters_are_depthnets_but_for_the_inputs_and_the_spread(width):
    """Nine weights for each map that a layer takes more than DepthNet's, and the head of the spread."""
    more = [
        (3 + FINE - 6, width),
        (FINE + HALF, 2 * width),
        (HALF + QUARTER + 2, 4 * width),
        (QUARTER, 8 * width),
    ]
    expected = sum(9 * taken * given for taken, given in more) + 9 * (3 * width + 1) + 1
    assert parameters(MotionNet(width)) - parameters(DepthNet(width)) == expected


def test_depths_come_at_five_scales_and_the_spread_at_the_finest(small):
    depths, spread = small(*inputs())
    assert [tuple(depth.shape[1:]) for depth in depths] == [(16, 32), (8, 16), (4, 8), (2, 4), (1, 2)]
    assert spread.shape == depths[0].shape
    assert (spread >= 0).all()


@pytest.mark.parametrize("which", range(5))
def test_every_input_matters(small, which):
    given = inputs()
    before = small(*given)[0][0]
    given[which] = given[which].flip(-1) + 0.1
    assert not torch.allclose(before, small(*given)[0][0])


def test_the_spread_does_not_pull_at_the_depth(small):
    small.train()
    depths, spread = small(*inputs())
    spread.sum().backward()
    assert small.predict_depth2.weight.grad is None
    assert small.predict_spread2.weight.grad is not None
    assert depths[0].requires_grad


def test_a_pair_does_not_see_its_neighbour_in_the_batch(small):
    both = inputs()
    alone = [each[:1] for each in both]
    assert torch.allclose(small(*both)[0][0][:1], small(*alone)[0][0], rtol=1e-4, atol=1e-3)
