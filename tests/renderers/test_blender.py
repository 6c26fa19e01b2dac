"""The ray caster against Blender itself, where one is installed."""

import dataclasses

import numpy as np
import pytest
from built_scenes import NO_TEXTURES, SHAPES, built, pose, turned_by

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.renderers import raycast
from flightdepth.renderers.blender import Blender, render
from flightdepth.renderers.blender_process import find_blender
from flightdepth.scenes import StillBoxConfig, Textures, draw_scene
from flightdepth.scenes.scene import Shape

pytestmark = pytest.mark.skipif(
    find_blender() is None, reason="Blender is not installed: `make blender-env`, or `blender` on the PATH"
)
CAMERA = Camera(48, 40, 25.0, 31.0, 20.3, 22.1)  # no two alike


@pytest.fixture(scope="module")
def blender():
    with Blender(samples=16, segments=256, threads=1) as started:
        yield started


def differences(blender, scene, camera=CAMERA) -> tuple[np.ndarray, np.ndarray]:
    """Relative, of depth; and of colour in bytes."""
    ours, theirs = raycast.render(scene, NO_TEXTURES, camera), blender.render(scene, NO_TEXTURES, camera)
    np.testing.assert_array_equal(np.isinf(ours.depth_m), np.isinf(theirs.depth_m))
    seen = np.isfinite(ours.depth_m)
    relative = np.abs(theirs.depth_m[seen] / ours.depth_m[seen] - 1)
    return relative, np.abs(ours.images.astype(int) - theirs.images)


def test_a_room_s_walls_seen_by_a_turned_camera_with_an_odd_lens(blender):
    scene = built(room=(7.0, 5.5, 11.0), path=[[0.2, 0.1, 0.3], [0.3, 0.1, 0.3]])
    scene = dataclasses.replace(scene, world_from_camera=np.stack([np.eye(3), turned_by(4)]))
    relative, colour = differences(blender, scene)
    assert np.median(relative) < 2e-7
    assert np.quantile(relative, 0.99) < 2e-6
    assert colour.mean() < 1


@pytest.mark.parametrize("shape", list(Shape))
def test_an_object_under_the_sky(blender, shape):
    place = pose([3.0, 2.0, 1.5], [0.5, -1.0, 8.0], turned_by(1))
    relative, colour = differences(blender, built([(shape, place, SHAPES[shape])], room=None))
    assert np.median(relative) < 5e-5  # chords of 256 segments
    assert colour.mean() < 2


def test_a_lamp_twice_as_strong_is_twice_as_bright(blender):
    """Irradiance = power / distance^2: 12 / 4^2 on the wall ahead, albedo 0.5."""
    scene = built(room=(9.0, 9.0, 5.0), lamps=((0.0, 0.0, 1.0),), power=12.0, ambient=0.0)
    image = blender.render(scene, NO_TEXTURES, Camera.from_fov(33, 33, 40)).images[0]
    assert image[16, 16, 0] == pytest.approx(255 * (0.5 * 12 / 16) ** (1 / 2.2), abs=1)


def test_textures_of_scenes_one_after_the_other_do_not_mix(blender):
    """Cycles once took the second scene's textures for the first's."""
    colours = np.random.default_rng(1).integers(0, 256, (6, 1, 1, 3), dtype=np.uint8)
    textures = Textures.from_images([np.broadcast_to(colour, (8, 8, 3)) for colour in colours])
    camera = Camera.from_fov(32, 32, 90)
    for number in range(3):
        scene = draw_scene(StillBoxConfig(texture_ratio=1.0, meshes=(3, 3)), 6, 5, number)
        ours = raycast.render(scene, textures, camera, frames=[0]).images.astype(int)
        theirs = blender.render(scene, textures, camera, frames=[0]).images
        assert np.abs(ours - theirs).mean() < 2


def test_too_few_textures_are_an_error_before_blender_is_asked(blender):
    with pytest.raises(BadInput, match="textures of the scene"):
        blender.render(built(texture=3), NO_TEXTURES, CAMERA)


def test_a_sheared_object_stays_sheared(blender):
    """Roofs of houses are cubes sheared to a rhomb; Blender takes poses apart into turn and scale."""
    place = pose([3.0, 2.0, 1.5], [0.5, -1.0, 8.0], turned_by(1) @ [[1, 0.8, 0], [0, 1, 0], [0, 0, 1]])
    relative, _ = differences(blender, built([(Shape.CUBE, place, 0.0)]))
    assert (relative > 1e-5).mean() < 0.01


def test_more_samples_are_less_noise():
    """Where several lamps reach a surface each sample takes one of them."""
    scene = draw_scene(StillBoxConfig(frames=2), 1, 5, 0)
    camera, plain = Camera.from_fov(48, 48, 90), Textures.procedural(1, 1)
    few, more, most = (
        render(scene, plain, camera, frames=[0], samples=samples).images[0].astype(float)
        for samples in (1, 16, 256)
    )
    assert np.abs(more - most).mean() < 0.5 * np.abs(few - most).mean()
