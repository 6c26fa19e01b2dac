"""The second look: its warp is the sweep's, and where pictures tell, it finds parts of a pixel."""

import cv2
import numpy as np
import pytest
import torch

from flightdepth.architectures.refinement import QUARTERS, Difference, Refinement
from flightdepth.camera import Camera
from flightdepth.sweep import LEVELS, motion_field, sweep, unit_direction, warp_matrix

CAMERA = Camera(128, 64, 100.0, 100.0, 60.0, 35.0)
MOVES = [(0.3, 0.0, 0.0), (0.1, -0.05, 0.3), (0.0, 0.2, -0.2)]
SHIFT_PX_M = 38.4


def texture(seed=0):
    """Grey picture with detail of a few pixels, RGB uint8 [H, W, 3]."""
    noise = np.random.default_rng(seed).uniform(0, 255, (CAMERA.height, CAMERA.width)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.0)
    spread = (smooth - smooth.min()) / (smooth.max() - smooth.min()) * 255
    return np.repeat(spread.astype(np.uint8)[..., None], 3, axis=2)


def planes(image):
    return torch.from_numpy(image[..., 0].astype(np.float32))[None, None]


def difference(previous, current, move, every=1):
    field = torch.from_numpy(motion_field(unit_direction(move), CAMERA))[None]
    return Difference(planes(previous), planes(current), field, every=every)


def flat(value, hypotheses=1):
    return torch.full((1, hypotheses, CAMERA.height // 4, CAMERA.width // 4), float(value))


@pytest.mark.parametrize("move", MOVES)
@pytest.mark.parametrize("level_0", [1, 4, 6])
def test_the_warp_is_that_of_the_plane_sweep(move, level_0):
    """OpenCV's affine warp of the same hypothesis, which interpolates in steps of 1/32 pixel."""
    previous, current = texture(1), texture(2)
    shift_px = LEVELS[0].shifts_px[level_0]
    swept = sweep(previous, current, move, CAMERA).swept[0][level_0].astype(np.float32)
    left, inside = difference(previous, current, move)(flat(shift_px))
    whole = (
        cv2.erode(
            np.kron(inside[0, 0].numpy(), np.ones((4, 4))),
            np.ones((9, 9)),
            borderType=cv2.BORDER_CONSTANT,
            borderValue=0,
        )
        > 0
    )
    ours = left[0, 0].numpy() + current[..., 0]
    assert whole.sum() > 3000
    assert np.abs(ours - swept)[whole].max() < 3.0  # the texture has slopes of 60 grey levels a pixel


def test_each_pixel_has_a_shift_of_its_own():
    previous, current = texture(1), texture(2)
    seen = difference(previous, current, MOVES[1])
    near, far = seen(flat(4.0))[0], seen(flat(1.0))[0]
    mixed = flat(1.0)
    mixed[..., 10:] = 4.0
    found = seen(mixed)[0]
    assert torch.allclose(found[..., :40], far[..., :40])
    assert torch.allclose(found[..., 40:], near[..., 40:])


@pytest.mark.parametrize("move", MOVES)
def test_every_second_pixel_has_the_same_difference(move):
    previous, current = texture(1), texture(2)
    shifts = flat(1.0, 3) * torch.tensor([0.5, 2.0, 9.0]).view(1, 3, 1, 1)
    left, inside = difference(previous, current, move)(shifts)
    sparse, same = difference(previous, current, move, every=2)(shifts)
    assert torch.allclose(sparse, left[..., ::2, ::2], atol=2e-2)  # grey levels
    assert torch.equal(same, inside)


def test_what_the_earlier_picture_does_not_hold_is_said():
    """Sideways by 40 px: what was seen 40 px to the right is gone in the last 10 columns of 4."""
    _, inside = difference(texture(), texture(), (0.3, 0.0, 0.0))(flat(40.0))
    assert inside[0, 0].sum(0).tolist() == [16.0] * 22 + [0.0] * 10


@pytest.mark.parametrize("off", [0.88, 1.12])
def test_untrained_it_corrects_by_parts_of_a_pixel(off):
    """A wall at 10 m, seen at shift 3.84 px; the guess is 12 % off."""
    torch.manual_seed(0)
    previous, move = texture(3), (0.3, 0.0, 0.0)
    matrix = warp_matrix(SHIFT_PX_M / 10, unit_direction(move), CAMERA)
    size = (CAMERA.width, CAMERA.height)
    current = cv2.warpAffine(previous, matrix, size, flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP)
    refine = Refinement(5, SHIFT_PX_M, 100.0).eval()
    field = torch.from_numpy(motion_field(unit_direction(move), CAMERA))[None]
    contrast = Difference(planes(previous) / 20, planes(current) / 20, field)
    with torch.no_grad():
        found, spread = refine(flat(10.0 * off)[:, 0], flat(1.0)[:, 0], flat(0.0, 5), contrast)
    inner = found[:, 2:-2, 4:-4]
    assert (inner - 10.0).abs().median() < 0.4 * abs(off - 1) * 10
    assert (spread > 0).all()


def thorough():
    torch.manual_seed(2)
    look = Refinement(5, SHIFT_PX_M, 100.0, thorough=True).eval()
    torch.nn.init.normal_(look.head.weight, 0, 0.1)
    return look


def clues_seen_by(look, previous, current):
    """What the first convolution takes, [k, h, w], of a wall at 10 m."""
    seen = []
    look.trunk[0].register_forward_pre_hook(lambda _, given: seen.append(given[0][0]))
    with torch.no_grad():
        look(flat(10.0)[:, 0], flat(1.0)[:, 0], flat(0.0, 5), difference(previous, current, MOVES[0]))
    return seen[0]


def test_a_thorough_look_sees_the_quarters_of_each_block():
    """Their mean is the block's; and what differs in one quarter only, is seen in that one."""
    plain = np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8)
    clues = clues_seen_by(thorough(), texture(1), texture(2))
    quarters = clues[-QUARTERS:].view(4, 5, *clues.shape[1:])
    assert torch.allclose(quarters.mean(0), clues[:5], rtol=1e-4, atol=1e-4)
    for quarter, (row, column) in enumerate([(0, 0), (0, 2), (2, 0), (2, 2)]):
        marked = plain.copy()
        marked[20 + row : 22 + row, 40 + column : 42 + column] = 80
        at_block = clues_seen_by(thorough(), plain, marked)[-QUARTERS:].view(4, 5, *clues.shape[1:])[
            :, :, 5, 10
        ]
        assert at_block[quarter].tolist() == [80.0] * 5
        assert at_block.sum() == 80 * 5


def test_a_thorough_look_sees_farther_around():
    def reach(look):
        with torch.no_grad():
            blank, marked = flat(0.0, 5), flat(0.0, 5)
            marked[..., 8, 16] = 5.0
            seen = difference(texture(1), texture(1), MOVES[0])
            depth, spread = flat(10.0)[:, 0], flat(1.0)[:, 0]
            changed = look(depth, spread, blank, seen)[0] != look(depth, spread, marked, seen)[0]
        columns = changed[0].any(0).nonzero().flatten()
        return int(columns.max() - columns.min()) // 2

    plain = Refinement(5, SHIFT_PX_M, 100.0).eval()
    torch.nn.init.normal_(plain.head.weight, 0, 0.1)
    keen = thorough()
    torch.nn.init.ones_(keen.around[1].weight)
    assert (reach(plain), reach(keen)) == (5, 9)


def test_nothing_is_learnt_through_the_warp():
    """Of the depth that comes in, no gradient: what is sampled where is a choice, not a function to descend."""
    depth = flat(10.0)[:, 0].requires_grad_()
    features = flat(0.1, 5).requires_grad_()
    seen = difference(texture(1), texture(2), MOVES[0])
    torch.manual_seed(0)
    refine = Refinement(5, SHIFT_PX_M, 100.0)
    torch.nn.init.normal_(refine.head.weight, 0, 0.1)
    refine(depth, flat(1.0)[:, 0], features, seen)[0].sum().backward()
    assert depth.grad is None
    assert features.grad is not None
    assert features.grad.abs().sum() > 0
