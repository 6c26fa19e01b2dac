"""What stands still in a live camera's pictures: told within some turns, and not once a mask hides it."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.flight.mask import PictureMask
from flightdepth.flight.still_parts import FEWEST
from flightdepth.live.still_watch import StillWatch
from flightdepth.motion import NED_FROM_CAMERA, quaternion_from_rotation
from flightdepth.ranges.seen_turns import SeenOrientation

CAMERA = Camera.from_fov(320, 180, 70)
GROUND = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 256, (400, 1000), np.uint8), (0, 0), 3)
GROUND = cv2.normalize(GROUND, None, 0, 255, cv2.NORM_MINMAX)
POST = np.ones((180, 320), bool)
POST[:, 40:60] = False


def result(index, *, attitude=True, seen=False, camera=CAMERA):
    """A picture three times a second, each turned by three degrees against the one before; told, or seen."""
    image = GROUND[:180, 12 * index : 12 * index + 320].copy()
    image[~POST] = 20
    image = cv2.resize(image, (camera.width, camera.height))
    turn = cv2.Rodrigues(np.radians([0.0, 0.0, 3.0 * index]))[0]
    quaternion = quaternion_from_rotation(turn @ NED_FROM_CAMERA)
    motion = SimpleNamespace(world_from_camera=quaternion if attitude else None)
    stamp_ns = index * 333_000_000
    orientation = SeenOrientation(NED_FROM_CAMERA.T @ turn @ NED_FROM_CAMERA, 0) if seen else None
    return SimpleNamespace(
        image=image[..., None].repeat(3, -1),
        camera=camera,
        stamp_ns=stamp_ns,
        motion=motion,
        depth=SimpleNamespace(orientation=orientation),
    )


@pytest.fixture
def watch():
    return StillWatch()


def test_a_post_that_stands_still_is_told(watch):
    for index in range(40):
        watch.take(result(index))
        assert watch.doubt is None or index >= FEWEST
    assert "stands still while the camera turns: " in watch.doubt and "--mask" in watch.doubt


def test_none_that_a_mask_hides(tmp_path):
    masked = cv2.erode(POST.astype(np.uint8), np.ones((21, 21)))
    watch = StillWatch(PictureMask(tmp_path / "mask.png", masked > 0))
    for index in range(40):
        watch.take(result(index))
    assert watch.doubt is None


@pytest.mark.parametrize("seen", [False, True])
def test_without_attitudes_the_turns_tell_that_pictures_show(watch, seen):
    for index in range(40):
        watch.take(result(index, attitude=False, seen=seen))
    assert (watch.doubt is not None) == seen


def test_a_stream_of_another_size_begins_anew(watch):
    for index in range(40):
        watch.take(result(index))
    assert watch.doubt is not None
    watch.take(result(40, camera=CAMERA.resized(640, 360)))
    assert watch.doubt is None
