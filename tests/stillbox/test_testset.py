import numpy as np
import pytest

from flightdepth.renderers.raycast import render
from flightdepth.scenes import StillBoxConfig, Textures, draw_scene
from flightdepth.stillbox import PairRule, Picture, TestSet, testset

BLANK = Textures.from_images([])
SMALL = Picture(16, 16, 16)


def test_the_fixed_textures_are_procedural(monkeypatch):
    asked = []
    monkeypatch.setattr(Textures, "procedural", lambda count, seed: asked.append((count, seed)) or BLANK)
    testset.test_textures.cache_clear()
    assert testset.test_textures() is BLANK
    testset.test_textures.cache_clear()
    assert asked == [(96, 7)]


def test_there_are_300_scenes():
    assert len(TestSet(SMALL, PairRule())) == 300


@pytest.mark.parametrize("rule", [PairRule(), PairRule(5, 10, 60)])
def test_a_pair_is_the_nominal_shift_in_the_middle_of_its_scene(rule):
    tested = TestSet(SMALL, rule, textures=BLANK)
    pair, scene = tested.pair(11), draw_scene(StillBoxConfig(), 0, testset.SEED, 11)
    previous = (10 - rule.nominal_shift) // 2
    frames = (previous, previous + rule.nominal_shift)
    seen = render(scene, BLANK, SMALL.camera(90, 0, 0), frames=frames)
    np.testing.assert_array_equal(pair.previous, seen.images[0])
    np.testing.assert_array_equal(pair.current, seen.images[1])
    np.testing.assert_array_equal(pair.depth_m, seen.depth_m[1])
    moved = scene.camera_position[frames[1]] - scene.camera_position[frames[0]]
    np.testing.assert_array_equal(pair.displacement, moved)


def test_a_nominal_shift_longer_than_a_scene_has_a_longer_scene():
    pair = TestSet(SMALL, PairRule(12), textures=BLANK).pair(11)
    assert np.linalg.norm(pair.displacement) == pytest.approx(1.2)


def test_with_orientation_noise_the_displacement_is_in_the_current_orientation():
    config = StillBoxConfig(orientation_noise_rad=0.1)
    pair = TestSet(SMALL, PairRule(), textures=BLANK, config=config).pair(11)
    scene = draw_scene(config, 0, testset.SEED, 11)
    moved = scene.camera_position[6] - scene.camera_position[3]
    np.testing.assert_allclose(scene.world_from_camera[6] @ pair.displacement, moved)
    assert np.abs(pair.displacement - moved).max() > 0.003


def test_pairs_come_in_order():
    tested = TestSet(SMALL, PairRule(), scenes=4, textures=BLANK)
    for number, pair in enumerate(tested):
        np.testing.assert_array_equal(pair.depth_m, tested.pair(number).depth_m)
    assert number == 3


def test_a_crop_is_the_middle_of_the_picture():
    whole = TestSet(Picture(40, 40, 40), PairRule(), textures=BLANK).pair(2)
    crop = TestSet(Picture(20, 12, 40), PairRule(), textures=BLANK).pair(2)
    np.testing.assert_array_equal(crop.depth_m, whole.depth_m[14:26, 10:30])
    np.testing.assert_array_equal(crop.current, whole.current[14:26, 10:30])
    assert crop.focal_px == whole.focal_px == pytest.approx(20)
