import dataclasses

import numpy as np
import pytest
from built_scenes import GREY, NO_TEXTURES, SHAPES, built, pose, turned_by
from bundled import Seen

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.renderers.raycast import render
from flightdepth.renderers.tracing import PARTS
from flightdepth.scenes import Textures
from flightdepth.scenes.scene import Shape

CAMERA = Camera.from_fov(33, 33, 90)
MIDDLE = 16


def picture(scene, textures=NO_TEXTURES, camera=CAMERA) -> np.ndarray:
    return render(scene, textures, camera).images[0]


def encoded(linear: float) -> int:
    return round(255 * linear ** (1 / 2.2))


def test_a_wall_in_ambient_light_alone():
    assert abs(int(picture(built(lamps=(), ambient=0.4))[5, 5, 0]) - encoded(0.4 * GREY)) <= 1


def test_a_wall_under_a_lamp_by_hand():
    # The lamp at the camera, the wall 20 m ahead: cosine 1, power / 400.
    seen = picture(built(lamps=((0, 0, 0),), power=300.0, ambient=0.0))[MIDDLE, MIDDLE, 0]
    assert abs(int(seen) - encoded(GREY * 300 / 400)) <= 1


def test_light_falls_with_cosine_and_square_of_the_distance():
    seen = picture(built(lamps=((0, 0, 0),), power=300.0, ambient=0.0))
    for column in (0, 4, 9):
        x = (column - MIDDLE) / CAMERA.fx
        square = 400 * (1 + x * x)
        assert abs(int(seen[MIDDLE, column, 0]) - encoded(GREY * 300 / square / np.sqrt(1 + x * x))) <= 1


@pytest.mark.parametrize("shape", list(Shape))
def test_a_blocked_lamp_leaves_ambient_light_only(shape):
    # Lamp ahead and above, the blocker (of a torus the tube) half-way to the wall, above the line of sight.
    lamp = (0.0, -16.0, 4.0)
    flat = pose([1.6, 1.6, 1.6], [1.6 if shape is Shape.TORUS else 0.0, -8.0, 12.0])
    lit = picture(built(lamps=(lamp,), power=400.0))
    shaded = picture(built([(shape, flat, SHAPES[shape])], lamps=(lamp,), power=400.0))
    assert abs(int(shaded[MIDDLE, MIDDLE, 0]) - encoded(0.1 * GREY)) <= 1
    assert lit[MIDDLE, MIDDLE, 0] > shaded[MIDDLE, MIDDLE, 0] + 20
    assert shaded[MIDDLE + 12, MIDDLE, 0] == lit[MIDDLE + 12, MIDDLE, 0]


def test_a_torus_shades_itself():
    ring = pose([4.0, 4.0, 4.0], [0.0, 0.0, 9.0])
    across = ((0.0, -15.0, 9.0),)  # in the ring's plane: its near side hides the far one
    one = picture(built([(Shape.TORUS, ring, 0.3)], lamps=across, power=300.0, ambient=0.1))
    row = MIDDLE + round(CAMERA.fy * 3.2 / 9)  # the inner side of the far part, facing the lamp
    assert abs(int(one[row, MIDDLE, 0]) - encoded(0.1 * GREY)) <= 1


def test_open_sky_has_its_colours():
    seen = picture(built(room=None, lamps=()))
    np.testing.assert_array_equal(seen[-1, MIDDLE], [encoded(0.8)] * 3)
    assert seen[0, MIDDLE, 2] > seen[0, MIDDLE, 0]


def test_an_edge_is_mixed_by_the_share_of_its_four_rays():
    # A bright cube before a dark wall whose left border runs through a pixel's quarter.
    left = (10 - MIDDLE + 0.1) / CAMERA.fx * 8  # right of the centre of column 10: two of four rays meet it
    cube = pose([10.0, 10.0, 1.0], [left + 10, 0.0, 9.0])
    scene = built([(Shape.CUBE, cube, 0.0)], lamps=((0, 0, 0),), power=30.0, ambient=0.0)
    seen = picture(scene)[MIDDLE].astype(float)[:, 0] / 255
    wall, face, mixed = (seen[c] ** 2.2 for c in (9, 11, 10))
    assert mixed == pytest.approx((wall + face) / 2, rel=0.03)


@pytest.mark.parametrize("shape", list(Shape))
def test_a_texture_of_one_colour_gives_one_colour(shape):
    plain = Textures.from_images([np.full((64, 64, 3), (200, 100, 50), np.uint8)])
    place = pose([3.0, 2.0, 2.0], [0.0, 0.0, 8.0], turned_by(1))
    scene = built([(shape, place, SHAPES[shape])], lamps=(), ambient=1.0, texture=0)
    seen = picture(scene, plain).astype(int)
    expected = [encoded(GREY * (value / 255) ** 2.2) for value in (200, 100, 50)]
    assert np.abs(seen - expected).max() <= 1


@pytest.mark.parametrize("shape", list(Shape))
def test_normals_are_those_of_the_surface_by_finite_differences(shape):
    place = pose([3.0, 2.0, 1.5], [0.5, -0.5, 8.0], turned_by(5))
    scene = built([(shape, place, SHAPES[shape])])
    seen, step, checked = Seen(scene, CAMERA), 1e-5, 0
    for x, y in np.random.default_rng(0).uniform(-0.35, 0.35, (300, 2)):
        depth, label = seen.trace([x, x + step], [y, y + step])
        t, labels = depth[[0, 0, 1], [0, 1, 0]], label[[0, 0, 1], [0, 1, 0]]
        if labels[0] >= PARTS or len(set(labels)) > 1 or np.ptp(t) > 1e-3:
            continue
        points = np.array([[x, y, 1], [x + step, y, 1], [x, y + step, 1]]) * t[:, None]
        plain = np.cross(points[1] - points[0], points[2] - points[0])
        plain /= -np.sign(plain @ points[0]) * np.linalg.norm(plain)
        point, normal = seen.place(labels[0], [x], [y], t[:1])
        np.testing.assert_allclose(point[0], points[0], atol=1e-9)
        np.testing.assert_allclose(normal[0], plain, atol=2e-3)
        checked += 1
    assert checked > 50


def test_more_lamps_than_there_are_bits_are_refused():
    with pytest.raises(BadInput, match="expected at most 31, got 32"):
        picture(built(lamps=((0.0, 0.0, 0.0),) * 32))


def test_more_objects_than_shadows_can_name_are_refused():
    """The last ones cast none."""
    with pytest.raises(BadInput, match="objects of the scene: expected at most 32767, got 32768"):
        picture(built([(Shape.SPHERE, pose([0.01] * 3, [0.0, 0.0, -15.0]), 0.0)] * 32768))


def test_the_last_of_the_most_lamps_casts_its_shadow():
    lamp, blocker = (0.0, -16.0, 4.0), pose([1.6, 1.6, 1.6], [0.0, -8.0, 12.0])
    dim = ((0.0, -19.0, -19.0),) * 30
    scene = built([(Shape.CUBE, blocker, 0.0)], lamps=(*dim, lamp), power=400.0)
    powers = np.full((31, 3), 1e-9)
    powers[-1] = 400.0
    seen = picture(dataclasses.replace(scene, lamp_power=powers))
    assert abs(int(seen[MIDDLE, MIDDLE, 0]) - encoded(0.1 * GREY)) <= 1


def test_a_scene_with_more_textures_than_there_are_is_refused():
    with pytest.raises(BadInput, match="expected at least 1, got 0"):
        picture(built(texture=0))


def test_a_sky_brighter_than_white_is_white():
    scene = dataclasses.replace(built(room=None), sky_colour=np.full((2, 3), 7.0))
    assert (picture(scene) == 255).all()


def test_a_lamp_on_the_very_wall_leaves_no_hole():
    middle = (0.0, 0.0, 20.0)
    seen = picture(built(lamps=(middle,), ambient=0.3))
    assert seen.shape == (33, 33, 3)
    assert seen[2, 2, 0] == encoded(0.3 * GREY)
