"""MotionNet: sizes by hand, which input reaches what, and that it does not care how the motion is written."""

import pytest
import torch

from flightdepth.architectures import DepthNet, MotionNet
from flightdepth.architectures.motionnet import CORRECTED, Corrections, silent_blocks
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
    """Nine weights for each map that a layer takes more than DepthNet's; the head of the spread; the second look."""
    more = [
        (3 - 6, width),
        (FINE + HALF + 2 * 3, 2 * width),
        (HALF + QUARTER + 2 + 2 * 4, 4 * width),
        (QUARTER + 2 * 5, 8 * width),
    ]
    expected = sum(9 * taken * given for taken, given in more) + 9 * (3 * width + 1) + 1
    second_look = 16 * (3 * width + 2) + 9 * 32 * (14 + 16 + 32 + 32) + 3 * 2 * 32 + (9 * 32 + 1) * 8
    assert parameters(MotionNet(width)) - parameters(DepthNet(width)) == expected + second_look


def test_depths_come_refined_and_at_five_scales_and_the_spread_at_the_finest(small):
    depths, spread = small(*inputs())
    assert [tuple(depth.shape[1:]) for depth in depths] == [
        (16, 32),
        (16, 32),
        (8, 16),
        (4, 8),
        (2, 4),
        (1, 2),
    ]
    assert spread.shape == depths[0].shape
    assert (spread >= 0).all()


def test_each_look_starts_from_what_the_one_before_it_gave(small):
    torch.nn.init.normal_(small.refinement.head.weight, std=0.1)
    seen, look = [], small.refinement.forward

    def watched(depth, spread, features, difference):
        seen.append((depth, difference.every))
        return look(depth, spread, features, difference)

    small.refinement.forward = watched
    (_, *unrefined), _ = small(*inputs())
    assert seen.pop()[1] == 1
    small.looks = 3
    depths, spread = small(*inputs())
    assert len(depths) == 8
    assert torch.equal(depths[3], unrefined[0])
    assert [every for _, every in seen] == [2, 2, 1]
    for (start, _), depth in zip(seen, depths[3:0:-1], strict=True):
        assert torch.equal(start, depth)
    assert not torch.allclose(depths[0], depths[1])
    assert spread.shape == depths[0].shape


def test_more_looks_have_no_more_parameters():
    assert parameters(MotionNet(4, looks=3)) == parameters(MotionNet(4))


def test_a_thorough_last_look_has_weights_of_its_own():
    """A second look's, 20 clues more, and a convolution more."""
    look = 16 * (3 * 4 + 2) + 9 * 32 * (14 + 16 + 20 + 32 + 32 + 32) + 4 * 2 * 32 + (9 * 32 + 1) * 8
    added = parameters(MotionNet(4, looks=2, thorough_last_look=True)) - parameters(MotionNet(4))
    assert added == look
    assert not hasattr(MotionNet(4, looks=1, thorough_last_look=True), "refinement")


@pytest.mark.parametrize("looks", [1, 2, 3])
def test_only_the_last_look_is_thorough(looks):
    torch.manual_seed(0)
    network = MotionNet(4, looks=looks, thorough_last_look=True).eval()
    seen = []
    for name, module in network.named_children():
        if name in ("refinement", "last_look"):
            module.register_forward_pre_hook(lambda _, given, name=name: seen.append((name, given[3].every)))
    network(*inputs())
    assert seen == [("refinement", 2)] * (looks - 1) + [("last_look", 1)]


def test_residual_blocks_have_two_convolutions_each():
    """At base width 4: 32, 32, 64, 32, 16 and 8 maps, 3x3 kernels, a scale and a shift of each map twice."""
    added = sum(2 * (9 * maps * maps + 2 * maps) for maps in (32, 32, 64, 32, 16, 8))
    assert parameters(MotionNet(4, residual_blocks=True)) - parameters(MotionNet(4)) == added


def test_a_trained_network_goes_on_from_where_it_was_with_residual_blocks():
    torch.manual_seed(0)
    trained = MotionNet(4, looks=2).eval()
    grown = MotionNet(4, looks=2, residual_blocks=True).eval()
    assert not grown.load_state_dict(trained.state_dict(), strict=False).unexpected_keys
    given = inputs()
    before, after = trained(*given), grown(*given)
    for one, other in zip((*before[0], before[1]), (*after[0], after[1]), strict=True):
        assert torch.equal(one, other)
    for name, module in grown.named_modules():  # and what they then learn counts
        if name.endswith("added.4"):
            module.weight.data.fill_(0.3)
    assert not torch.allclose(grown(*given)[0][0], before[0][0])


def test_silent_blocks_add_nothing_whatever_they_had_learnt():
    torch.manual_seed(0)
    plain, grown = MotionNet(4).eval(), MotionNet(4, residual_blocks=True).eval()
    for each in grown.parameters():  # as though trained
        each.data.add_(0.1 * torch.randn_like(each))
    silenced = silent_blocks(grown.state_dict())
    assert not silenced.keys() & plain.state_dict().keys()
    grown.load_state_dict(plain.state_dict() | silenced)
    given = inputs()
    assert torch.equal(grown(*given)[0][0], plain(*given)[0][0])


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


def differences(true_px, level, size=32):
    """Waves of 24 pixels seen through each hypothesis of a level, less what they look like at `true_px`."""
    shifts = torch.tensor(LEVELS[level].shifts_px).view(-1, 1, 1)
    wave = 2 * torch.pi / 24 / LEVELS[level].scale
    columns = torch.arange(size).expand(size, size) * LEVELS[level].scale
    seen = torch.sin(wave * (columns + shifts - true_px)) - torch.sin(wave * columns)
    return 3 * seen[None]


@pytest.mark.parametrize(("level", "true_px"), [(0, 0.8), (0, 1.6), (1, 2.5), (1, 5.0), (2, 10.0)])
def test_a_correction_leads_from_its_hypothesis_to_the_right_shift(level, true_px):
    shifts, middle = LEVELS[level].shifts_px, CORRECTED[level]
    nearest = min(range(len(middle)), key=lambda k: abs(shifts[middle[k]] - true_px))
    found = Corrections(level)(differences(true_px, level))[0]
    chosen = middle[nearest]
    apart = shifts[chosen + 1] - shifts[chosen - 1]
    inside = found[nearest, 2:-2, 2:-2].median()
    assert float(shifts[chosen] + inside * apart) == pytest.approx(true_px, rel=0.12)


def test_a_blank_wall_corrects_nothing_and_knows_nothing():
    found = Corrections(0)(torch.zeros(1, FINE, 16, 16))
    assert found.shape == (1, 2 * len(CORRECTED[0]), 8, 8)
    assert not found.any()


def test_a_correction_stays_within_two_steps():
    found = Corrections(1)(100 * torch.randn(1, HALF, 16, 16, generator=torch.Generator().manual_seed(1)))
    assert found[:, : len(CORRECTED[1])].abs().max() <= 2


def test_what_convolutions_take_lies_channels_last():
    """Else each would lay it out anew, and again for its gradient: a twelfth of a step of training (docs/log.md)."""
    network = MotionNet(4, looks=2, thorough_last_look=True).to(memory_format=torch.channels_last)
    taken = []
    for layer in (
        network.conv2,
        network.conv3,
        network.conv4,
        network.refinement.trunk,
        network.last_look.trunk,
    ):
        layer.register_forward_pre_hook(lambda _, inputs: taken.append(inputs[0]))
    network(*inputs())
    assert len(taken) == 5
    assert all(maps.is_contiguous(memory_format=torch.channels_last) for maps in taken)
