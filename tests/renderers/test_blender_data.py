"""What Blender is told: its camera projects as ours, and its texture look-up is ours."""

import dataclasses

import numpy as np
import pytest
from built_scenes import SHAPES, built, pose, turned_by

from flightdepth.camera import Camera
from flightdepth.renderers.blender_data import (
    MIDDLE_PX,
    SENSOR_MM,
    TURNS,
    camera_pose,
    lens,
    mesh_names,
    scene_arrays,
    texture_atlas,
)
from flightdepth.renderers.surfaces import texture_colour
from flightdepth.scenes.scene import Materials, Shape
from flightdepth.scenes.textures import EDGE, Textures

CAMERAS = [
    Camera.from_fov(64, 64, 90),
    Camera(48, 40, 25.0, 31.0, 20.3, 22.1),
    Camera(40, 90, 80.0, 55.0, 3.0, 50.0),
]


def blender_pixel(camera, x, y, z) -> np.ndarray:
    """Where Blender draws a point of its camera's space (-z forward, y up), by its manual: lens and sensor give
    the width of the view at distance 1, shifts move the window in widths, pixels have an aspect.
    """
    said = lens(camera)
    width = SENSOR_MM / said["lens_mm"]  # of the window at distance 1
    height = width * camera.height / camera.width * said["aspect_y"] / said["aspect_x"]
    across = (x / -z) / width - said["shift_x"] + 0.5
    up = ((y / -z) - said["shift_y"] * width) / height + 0.5
    return np.array([across * camera.width - 0.5, (1 - up) * camera.height - 0.5])


@pytest.mark.parametrize("camera", CAMERAS)
def test_blender_s_lens_projects_as_our_camera(camera):
    x, y, z = 0.7, -0.4, 3.0
    ours = np.array([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy])
    np.testing.assert_allclose(blender_pixel(camera, x, -y, -z), ours + MIDDLE_PX, atol=1e-9)


def test_pixels_are_never_less_than_1_wide_or_high():
    for camera in CAMERAS:
        assert min(lens(camera)["aspect_x"], lens(camera)["aspect_y"]) == 1.0


def test_a_turned_camera_looks_along_its_own_z():
    scene = dataclasses.replace(built(), world_from_camera=turned_by(3)[None])
    there = camera_pose(scene, 0, np.zeros(3))
    np.testing.assert_allclose(there[:, :3] @ [0, 0, -1], turned_by(3)[:, 2])  # forward
    np.testing.assert_allclose(there[:, :3] @ [0, 1, 0], -turned_by(3)[:, 1])  # up
    assert np.linalg.det(there[:, :3]) == pytest.approx(1)


def test_the_first_camera_stands_at_the_origin_and_the_rest_moves_with_it():
    place = pose([1, 2, 3], [0.5, 0.5, 9.0], turned_by(1))
    scene = built([(Shape.CUBE, place, 0.0)], path=[[100.0, 2, 3], [101.0, 2, 3]], lamps=((4.0, 4.0, 4.0),))
    arrays = scene_arrays(scene, [0, 1], texture_atlas(scene.materials, Textures.from_images([])))
    np.testing.assert_array_equal(arrays["camera"][:, :, 3], [[0, 0, 0], [1, 0, 0]])
    np.testing.assert_array_equal(arrays["pose"][0], place - np.column_stack([np.zeros((3, 3)), [100, 2, 3]]))
    np.testing.assert_array_equal(arrays["lamp_position"], [[-96, 2, 1]])
    assert len(arrays["pose"]) == len(arrays["tint"]) == 7  # and six walls
    assert not any(array.dtype.hasobject for array in arrays.values())  # nothing that needs a pickle


def test_equal_shapes_share_a_mesh_and_tori_of_other_radii_do_not():
    place = pose([1, 1, 1], [0, 0, 9])
    tori = [(Shape.TORUS, place, 0.2), (Shape.TORUS, place, 0.25), (Shape.TORUS, place, 0.2)]
    names = mesh_names(built([*tori, *((shape, place, 0.0) for shape in (Shape.CUBE, Shape.CUBE))]))
    assert names[0] == names[2] != names[1]
    assert names[3] == names[4] == "cube"


@pytest.mark.parametrize("turn", range(4))
def test_a_texture_looks_the_same_in_the_atlas(turn):
    """The script's node tree in numpy against the ray caster's finest look-up."""
    rng = np.random.default_rng(turn)
    textures = Textures.from_images(rng.integers(0, 256, (3, EDGE, EDGE, 3), dtype=np.uint8))
    materials = Materials(
        texture=np.array([2, -1, 0]),
        colour=np.ones((3, 3)),
        specular=np.zeros(3),
        repeats=np.array([3.0, 1.0, 1.0]),
        turn=np.array([turn, 0, 0]),
    )
    atlas = texture_atlas(materials, textures)
    for u, v in rng.uniform(0, 1, (20, 2)):
        place = np.modf(TURNS[turn] * 3.0 @ [u, v, 1] + 5.0)[0] * EDGE + atlas.corners[0]
        x, y = v if turn % 2 else u, 1 - u if turn % 2 else v  # as `shading` turns it
        x, y = (1 - x, 1 - y) if turn >= 2 else (x, y)
        expected = texture_colour(textures.texels, 2, 3 * x, 3 * y, 0.0)
        np.testing.assert_allclose(looked_up(atlas.texels, *place), expected, atol=1e-5)
    assert (looked_up(atlas.texels, *(atlas.corners[1] + 0.3 * EDGE)) == 1).all()  # plain: white


def looked_up(texels, x, y) -> np.ndarray:
    """Bilinear; texel i covers i to i + 1."""
    j, i = int(np.floor(x - 0.5)), int(np.floor(y - 0.5))
    a, b = x - 0.5 - j, y - 0.5 - i
    above, below = ((1 - a) * texels[i + k, j] + a * texels[i + k, j + 1] for k in (0, 1))
    return (1 - b) * above + b * below


def test_every_shape_has_a_name():
    place = pose([1, 1, 1], [0, 0, 9])
    names = mesh_names(built([(shape, place, radius) for shape, radius in SHAPES.items()]))
    assert len(set(names)) == 4
