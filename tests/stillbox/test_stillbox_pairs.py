import itertools
import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.renderers.raycast import render
from flightdepth.scenes import StillBoxConfig, Textures, draw_scene
from flightdepth.stillbox import Batch, PairRule
from flightdepth.stillbox.pairs import Pair, make_pair, turned

EIGHT = list(itertools.product(range(4), (False, True)))
CAMERA = Camera.from_fov(64, 64, 90).cropped(6, -9, 64, 64)  # the principal point is not in the middle
RULE = PairRule()


@pytest.fixture(scope="module")
def flown():
    """A scene of coarse blots and what is seen of it."""
    blots = np.random.default_rng(0).integers(20, 236, (4, 12, 12, 3), dtype=np.uint8)
    textures = Textures.from_images(blots)
    scene = draw_scene(StillBoxConfig(texture_ratio=1.0, speed_m_s=1.0), 4, 12, 3)
    return scene, render(scene, textures, CAMERA), CAMERA


def warp_error(pair, displacement, shift, turn=None) -> float:
    """Median difference between `current` and `previous` looked up where target and displacement say.

    `turn`: previous_from_current, the rotation that orientation noise leaves between the two.
    """
    depth_m = pair.target_m * abs(shift) / RULE.nominal_shift
    camera = pair.camera
    points = camera.rays() * depth_m[..., None] + displacement
    points = points if turn is None else points @ turn.T
    column = (points[..., 0] / points[..., 2] * camera.fx + camera.cx).astype(np.float32)
    row = (points[..., 1] / points[..., 2] * camera.fy + camera.cy).astype(np.float32)
    inside = (column >= 0) & (column <= 63) & (row >= 0) & (row <= 63) & (pair.target_m < 100)
    there = cv2.remap(pair.previous.astype(np.float32), column, row, cv2.INTER_LINEAR)
    return float(np.median(np.abs(there - pair.current)[inside]))


@pytest.mark.parametrize(("quarter_turns", "mirror"), EIGHT)
@pytest.mark.parametrize(("previous", "current"), [(1, 7), (8, 2)])
def test_target_and_displacement_explain_the_pictures_however_they_are_turned(
    flown, quarter_turns, mirror, previous, current
):
    pair = turned(make_pair(*flown, RULE, (previous, current)), quarter_turns=quarter_turns, mirror=mirror)
    error = warp_error(pair, pair.displacement, current - previous)
    others = [turned(pair, quarter_turns=q, mirror=m).displacement for q, m in EIGHT[1:]]
    assert error < 0.6 * min(warp_error(pair, other, current - previous) for other in others)


@pytest.fixture(scope="module")
def shaken():
    """The same scene with more orientation noise than any gimbal has."""
    blots = np.random.default_rng(0).integers(20, 236, (4, 12, 12, 3), dtype=np.uint8)
    scene = draw_scene(StillBoxConfig(texture_ratio=1.0, orientation_noise_rad=0.1), 4, 12, 3)
    return scene, render(scene, Textures.from_images(blots), CAMERA), CAMERA


@pytest.mark.parametrize(("quarter_turns", "mirror"), EIGHT)
@pytest.mark.parametrize(("previous", "current"), [(1, 7), (8, 2)])
def test_noise_stays_in_the_pictures_and_the_displacement_is_in_the_current_orientation(
    shaken, quarter_turns, mirror, previous, current
):
    """X_previous = R_previous^T R_current (X_current + displacement), mirrored and turned with the pictures."""
    scene, *_ = shaken
    plain = make_pair(*shaken, RULE, (previous, current))
    pair = turned(plain, quarter_turns=quarter_turns, mirror=mirror)
    axes = [
        turned(replace(plain, displacement=axis), quarter_turns=quarter_turns, mirror=mirror).displacement
        for axis in np.eye(3)
    ]
    seen_from_plain = np.column_stack(axes)
    turn = scene.world_from_camera[previous].T @ scene.world_from_camera[current]
    turn = seen_from_plain @ turn @ seen_from_plain.T
    shift = current - previous
    error = warp_error(pair, pair.displacement, shift, turn)
    assert error < 0.6 * warp_error(pair, pair.displacement, shift)  # not derotated
    assert error < 0.6 * warp_error(pair, pair.displacement, shift, turn.T)


def test_the_displacement_is_in_the_current_orientation_by_hand(shaken):
    scene, *_ = shaken
    pair = make_pair(*shaken, RULE, (2, 6))
    moved = scene.camera_position[6] - scene.camera_position[2]
    np.testing.assert_allclose(scene.world_from_camera[6] @ pair.displacement, moved)
    assert np.abs(pair.displacement - moved).max() > 0.01  # the world's axes are others


@pytest.mark.parametrize(("quarter_turns", "mirror"), EIGHT)
def test_turning_keeps_length_and_forward_part(flown, quarter_turns, mirror):
    pair = make_pair(*flown, RULE, (0, 3))
    seen = turned(pair, quarter_turns=quarter_turns, mirror=mirror).displacement
    assert np.linalg.norm(seen) == pytest.approx(0.3)
    assert seen[2] == pair.displacement[2]


def test_four_quarter_turns_are_none(flown):
    pair = make_pair(*flown, RULE, (0, 3))
    again = pair
    for _ in range(4):
        again = turned(again, quarter_turns=1, mirror=False)
    np.testing.assert_array_equal(again.current, pair.current)
    np.testing.assert_array_equal(again.displacement, pair.displacement)


def test_two_mirrors_are_none(flown):
    pair = make_pair(*flown, RULE, (0, 3))
    twice = turned(turned(pair, quarter_turns=0, mirror=True), quarter_turns=0, mirror=True)
    np.testing.assert_array_equal(twice.previous, pair.previous)
    np.testing.assert_array_equal(twice.displacement, pair.displacement)


def test_a_point_moves_by_the_displacement(flown):
    scene, *_ = flown
    pair = make_pair(*flown, RULE, (2, 6))
    point = np.array([1.0, 2.0, 9.0])
    in_previous, in_current = point - scene.camera_position[2], point - scene.camera_position[6]
    np.testing.assert_allclose(in_previous, in_current + pair.displacement)


def test_swapped_frames_negate_the_displacement(flown):
    there, back = make_pair(*flown, RULE, (2, 6)), make_pair(*flown, RULE, (6, 2))
    np.testing.assert_array_equal(there.displacement, -back.displacement)
    np.testing.assert_array_equal(there.previous, back.current)


@pytest.mark.parametrize(("shift", "factor"), [(3, 1), (-3, 1), (1, 3), (6, 0.5), (-2, 1.5)])
def test_the_target_is_the_depth_at_the_nominal_shift(shift, factor):
    depth_m = np.array([[0.5, 8, 21]], np.float32)
    np.testing.assert_allclose(RULE.target_m(depth_m, shift, 32.0), depth_m * factor)


@pytest.mark.parametrize("given", [(0,), (-3,), (3, 100), (3, 60, 10), (3, -1), (3, math.nan)])
def test_a_rule_that_gives_no_target_is_refused(given):
    """`PairRule(3, 100)` made every target 100 m, and the training learnt that."""
    with pytest.raises(BadInput, match=r"nominal shift|range of the target"):
        PairRule(*given)


def test_the_target_is_clipped():
    depth_m = np.array([[5.0, 40.0, 300.0, np.inf]], np.float32)
    rule = PairRule(nominal_shift=5, depth_min_m=10, depth_max_m=60)
    np.testing.assert_array_equal(rule.target_m(depth_m, 5, 32.0), [[10, 40, 60, 60]])


@pytest.mark.parametrize(("rule", "farthest"), [(PairRule(), 100), (PairRule(5, 10, 60), 60)])
def test_without_a_shift_all_is_farthest(rule, farthest):
    assert (rule.target_m(np.ones((2, 3), np.float32), 0, 32.0) == farthest).all()


def test_shifts_follow_the_paper_s_law():
    rng = np.random.default_rng(0)
    frames = np.array([RULE.draw_frames(rng, 10) for _ in range(12000)])
    shift = frames[:, 1] - frames[:, 0]
    assert frames.min() == 0
    assert frames.max() == 9
    # round(6 u): 1/12 each for 0 and 6, 1/6 each between; either order half the time.
    shares = np.bincount(np.abs(shift), minlength=7) / 12000
    np.testing.assert_allclose(shares, [1 / 12, *[1 / 6] * 5, 1 / 12], atol=0.015)
    assert (shift > 0).sum() / (shift != 0).sum() == pytest.approx(0.5, abs=0.02)


def test_shifts_stay_within_a_short_scene():
    rng = np.random.default_rng(0)
    frames = np.array([PairRule(5).draw_frames(rng, 4) for _ in range(300)])
    assert np.abs(frames[:, 1] - frames[:, 0]).max() == 3


def test_wide_pairs_are_nominal_or_more_frames_apart():
    """A share w of them: then 1/7 of w for each of 3 to 9 frames, and 1 - w as ever."""
    rule, rng = PairRule(wide_share=0.5), np.random.default_rng(0)
    frames = np.array([rule.draw_frames(rng, 10) for _ in range(12000)])
    shift = frames[:, 1] - frames[:, 0]
    usual = np.array([1 / 12, *[1 / 6] * 5, 1 / 12, 0, 0, 0])
    shares = np.bincount(np.abs(shift), minlength=10) / 12000
    np.testing.assert_allclose(shares, usual / 2 + np.array([0] * 3 + [1 / 14] * 7), atol=0.015)
    assert (shift > 0).sum() / (shift != 0).sum() == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("frames", [1, 2, 4])
def test_wide_pairs_stay_within_a_short_scene(frames):
    rule, rng = PairRule(wide_share=1.0), np.random.default_rng(0)
    drawn = np.array([rule.draw_frames(rng, frames) for _ in range(50)])
    assert set(np.abs(drawn[:, 1] - drawn[:, 0])) == {frames - 1}


def test_a_rule_without_still_pairs_draws_none():
    """Their share is that of one frame: 1/4 of the pairs are that far apart, not 1/6."""
    rule, rng = PairRule(still=False), np.random.default_rng(0)
    frames = np.array([rule.draw_frames(rng, 10) for _ in range(4000)])
    shares = np.bincount(np.abs(frames[:, 1] - frames[:, 0]), minlength=7) / 4000
    np.testing.assert_allclose(shares, [0, 1 / 4, *[1 / 6] * 4, 1 / 12], atol=0.025)


def test_a_rule_without_backward_pairs_draws_none():
    rule, rng = PairRule(backward=False), np.random.default_rng(0)
    frames = np.array([rule.draw_frames(rng, 10) for _ in range(400)])
    assert (frames[:, 1] >= frames[:, 0]).all()


def test_a_mirrored_camera_s_principal_point_is_as_far_from_the_other_edge():
    blank = np.zeros((64, 64, 3), np.uint8)
    pair = Pair(blank, blank, np.ones((64, 64), np.float32), np.ones(3), CAMERA)
    seen = turned(pair, quarter_turns=0, mirror=True).camera
    assert (seen.cx, seen.cy) == (63 - CAMERA.cx, CAMERA.cy)


def test_a_batch_joins_the_two_images(flown):
    pairs = [make_pair(*flown, RULE, (0, 3)), make_pair(*flown, RULE, (5, 4))]
    batch = Batch(tuple(pairs))
    assert batch.pairs.shape == (2, 64, 64, 6)
    np.testing.assert_array_equal(batch.pairs[1, ..., :3], pairs[1].previous)
    np.testing.assert_array_equal(batch.pairs[1, ..., 3:], pairs[1].current)
    np.testing.assert_array_equal(batch.target_m[0], pairs[0].target_m)


def test_a_reference_focal_length_makes_lenses_comparable():
    """What moves by as many pixels has the same target: 5 m through 64 px of focal length, 10 m through 128 px."""
    rule = PairRule(reference_focal_px=32.0)
    near, far = (np.full((2, 2), depth, np.float32) for depth in (5.0, 10.0))
    assert np.array_equal(rule.target_m(near, 3, 64.0), rule.target_m(far, 3, 128.0))
    assert rule.target_m(near, 3, 32.0) == pytest.approx(5.0)
