"""The same pixels however they are asked for."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.renderers.raycast import render
from flightdepth.scenes import StillBoxConfig, Textures, draw_scene

CAMERA = Camera.from_fov(48, 48, 90)


@pytest.fixture(scope="module")
def textures() -> Textures:
    return Textures.from_images(np.random.default_rng(0).integers(0, 256, (3, 64, 64, 3), dtype=np.uint8))


@pytest.fixture(scope="module")
def whole(textures):
    return render(draw_scene(StillBoxConfig(), 3, 8, 1), textures, CAMERA)


def same(a, b) -> bool:
    return a.images.tobytes() == b.images.tobytes() and a.depth_m.tobytes() == b.depth_m.tobytes()


def test_again(textures, whole):
    assert same(render(draw_scene(StillBoxConfig(), 3, 8, 1), textures, CAMERA), whole)


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_on_any_number_of_threads(textures, whole, threads):
    with ThreadPoolExecutor(threads) as executor:
        scene = draw_scene(StillBoxConfig(), 3, 8, 1)
        assert same(render(scene, textures, CAMERA, executor=executor), whole)


def test_any_frames_in_any_order(textures, whole):
    some = render(draw_scene(StillBoxConfig(), 3, 8, 1), textures, CAMERA, frames=[7, 0, 3])
    np.testing.assert_array_equal(some.images, whole.images[[7, 0, 3]])
    np.testing.assert_array_equal(some.depth_m, whole.depth_m[[7, 0, 3]])


@pytest.mark.parametrize("window", [(0, 0, 48, 48), (13, 5, 30, 20), (47, 47, 1, 1)])
def test_a_crop_is_the_slice(textures, whole, window):
    x, y, width, height = window
    scene = draw_scene(StillBoxConfig(), 3, 8, 1)
    crop = render(scene, textures, CAMERA.cropped(*window), frames=[4])
    part = slice(y, y + height), slice(x, x + width)
    np.testing.assert_array_equal(crop.images[0], whole.images[4][part])
    np.testing.assert_array_equal(crop.depth_m[0], whole.depth_m[4][part])


def test_crops_of_many_scenes_are_the_slices(textures):
    for number in range(12):
        scene = draw_scene(StillBoxConfig(), 3, 9, number)
        full = render(scene, textures, CAMERA, frames=[0])
        crop = render(scene, textures, CAMERA.cropped(9, 11, 21, 33), frames=[0])
        np.testing.assert_array_equal(crop.images, full.images[:, 11:44, 9:30])
