"""A leg of the drone in every picture of the sample flight: what is told of it, and what an autopilot hears."""

import cv2
import numpy as np
import pytest

from flightdepth.commands.demo import CALIBRATION, LOG, VIDEO
from flightdepth.flight import AttitudeSample, Frame, VelocitySample, open_flight
from flightdepth.flight.camera_file import read_camera
from flightdepth.flight.mask import PictureMask
from flightdepth.live.depth_stage import DepthStage, Lens, NoCalibration
from flightdepth.live.motion_store import MotionStore
from flightdepth.live.obstacle_rays import rays_of, sectors_of
from flightdepth.live.obstacles import ObstacleSettings, Pose, Sight
from flightdepth.runtimes.network import load_network

CAMERA = read_camera(CALIBRATION)
RADIUS_PX = 45
BEHIND = 68  # a sector that the beam hides, 20 degrees to the left


def bar(camera):
    """A beam that reaches across the picture's height, as of a propeller guard; True where it is."""
    picture = np.zeros((camera.height, camera.width), np.uint8)
    cv2.line(picture, (150, camera.height), (150, 0), 255, 2 * RADIUS_PX)
    return picture > 0


LEG = bar(CAMERA)


def seen(network, *, leg, mask, folder):
    """The last result of four tenths of a second of the sample flight, and its sectors."""
    texture = np.random.default_rng(0).integers(0, 130, (45, 80, 3), np.uint8).repeat(8, 0).repeat(8, 1)
    given = None
    if mask:
        cv2.imwrite(str(folder / "mask.png"), ~LEG * np.uint8(255))
        given = PictureMask.read(folder / "mask.png")
    store = MotionStore(None)
    stage = DepthStage(network, Lens(CAMERA), store, ranges=2, fixed=False, mask=given)
    with open_flight(VIDEO, LOG, CALIBRATION, start_s=5.0, end_s=5.4) as flight:
        for event in flight:
            match event:
                case Frame():
                    image = np.where(LEG[..., None], texture, event.image) if leg else event.image
                    staged = stage.take(event.stamp_ns, np.ascontiguousarray(image))
                case VelocitySample():
                    store.add(event, event.stamp_ns)
                    velocity_ned = event.velocity
                case AttitudeSample():
                    store.add(event, event.stamp_ns)
                    attitude = event.world_from_camera
    sight = Sight.of(network.card, network.focal_px(CAMERA))
    pose = Pose.of(attitude, 0.0, velocity_ned)  # the camera looks north, and so does the nose
    settings = ObstacleSettings()
    return staged.depth, sectors_of(rays_of(staged.depth, CAMERA, pose, sight, settings), settings)


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("mask")
    ways = {"clean": (False, False), "bare": (True, False), "masked": (True, True)}
    network = load_network("motion-tiny", device="cpu", threads=1)
    return {name: seen(network, leg=leg, mask=mask, folder=folder) for name, (leg, mask) in ways.items()}


def test_a_leg_is_told_to_be_far_away_unless_it_is_masked(results):
    """Of the drone's own parts `farther than` was told: infinitely far, as what moves with the camera looks."""
    bare, masked = results["bare"][0], results["masked"][0]
    assert np.isfinite(bare.farther_than_m)[LEG].mean() > 0.5
    for told in (masked.depth_m, masked.farther_than_m, masked.nearer_than_m, masked.sigma_m):
        assert np.isnan(told[LEG]).all()
    assert not masked.confidence[LEG].any()


def test_the_rest_of_the_picture_is_as_without_the_leg(results):
    away = ~cv2.dilate(LEG.astype(np.uint8), np.ones((61, 61), np.uint8)).astype(np.bool_)
    clean, masked = (results[name][0].depth_m[away] for name in ("clean", "masked"))
    off = np.abs(np.log(masked / clean))
    assert np.isfinite(off).sum() > 0.9 * np.isfinite(clean).sum()
    assert np.nanmedian(off) < 0.02


def test_sectors_behind_a_masked_leg_are_unknown_never_free(results):
    """Something stands there 19 m away, and the leg hid it: free, said the leg."""
    clean, bare, masked = (results[name][1] for name in ("clean", "bare", "masked"))
    assert clean.obstacle_m[BEHIND] < 30
    assert bare.clear_m[BEHIND] > ObstacleSettings().max_m
    assert masked.clear_m[BEHIND] == 0
    assert np.isnan(masked.obstacle_m[BEHIND])
    beside = [0, 1, 2, 5, 6]
    np.testing.assert_allclose(masked.clear_m[beside], clean.clear_m[beside], rtol=0.1)


def test_pictures_of_another_shape_than_the_mask_are_refused(tmp_path, save_difference_network):
    cv2.imwrite(str(tmp_path / "mask.png"), ~LEG * np.uint8(255))
    network = load_network(save_difference_network(), device="cpu", threads=1)
    mask = PictureMask.read(tmp_path / "mask.png")
    stage = DepthStage(network, Lens(hfov_deg=75.0), MotionStore(None), ranges=1, fixed=False, mask=mask)
    stage.prepare(320, 180)
    with pytest.raises(NoCalibration, match=r"expected a picture of 640x480, or of its shape, got 640x360"):
        stage.prepare(640, 480)
