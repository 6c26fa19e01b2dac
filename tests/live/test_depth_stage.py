"""The stage between pictures and the estimator, with a hand-made network."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from live_peers import sample_pictures

from flightdepth.camera import Camera
from flightdepth.flight.records import BodyAttitudeSample, PositionSample, VelocitySample
from flightdepth.live.depth_stage import DepthStage, Lens
from flightdepth.live.motion_store import MotionStore
from flightdepth.motion import NED_FROM_CAMERA
from flightdepth.ranges.repeats import FROZEN
from flightdepth.runtimes.network import load_network

CAMERA = Camera.from_fov(320, 180, 75)
FRAME_NS = 33_333_333
TURN_RAD = 0.06  # a frame: 103 degrees a second


def matrix(focal_px, width, height):
    return np.array([[focal_px, 0, width / 2], [0, focal_px, height / 2], [0, 0, 1.0]])


@pytest.fixture(scope="module")
def wide():
    """A view of 116 degrees, of which the camera sees a part."""
    return cv2.resize(sample_pictures((640, 360), 1)[0], (1600, 900), interpolation=cv2.INTER_CUBIC)


def seen(wide, yaw_rad):
    turn = cv2.Rodrigues(np.array([0.0, yaw_rad, 0.0]))[0]
    onto = matrix(CAMERA.fx, 320, 180) @ turn @ np.linalg.inv(matrix(500.0, 1600, 900))
    return cv2.warpPerspective(wide, onto, (320, 180))


@pytest.mark.parametrize(("told", "witness"), [(False, "says the picture"), (True, "says the autopilot")])
def test_a_fixed_camera_that_turns_is_noticed_though_nobody_tells_the_drones_attitude(
    wide, save_difference_network, told, witness
):
    """It went on with depths of turned pictures, without a word."""
    store = MotionStore(NED_FROM_CAMERA)
    network = load_network(save_difference_network(), device="cpu", threads=1)
    stage = DepthStage(network, Lens(CAMERA), store, ranges=1, fixed=True)
    for i in range(6):
        stamp_ns = 10**9 + i * FRAME_NS
        store.add(VelocitySample(stamp_ns, np.array([3.0, 0, 0])), stamp_ns)
        if told:
            half = i * TURN_RAD / 2
            store.add(BodyAttitudeSample(stamp_ns, np.array([np.cos(half), 0, 0, np.sin(half)])), stamp_ns)
        staged = stage.take(stamp_ns, seen(wide, i * TURN_RAD - 0.1))
    assert witness in staged.depth.reason


def test_a_folder_of_a_lens_s_name_hides_it_not(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("dji-mini-2").mkdir()
    assert Lens.given(Path("dji-mini-2"), None).source.startswith("dji-mini-2 in the table of lenses")


def test_a_frozen_picture_has_one_name(wide, save_difference_network):
    """A dark scene, new to one look and the same to the other, flipped between two names."""
    network = load_network(save_difference_network(), device="cpu", threads=1)
    store = MotionStore(NED_FROM_CAMERA)
    stage = DepthStage(network, Lens(CAMERA), store, ranges=1, fixed=False)
    image, reasons = np.zeros((180, 320, 3), np.uint8), []
    for i in range(30):
        stamp_ns = 10**9 + i * FRAME_NS
        store.add(VelocitySample(stamp_ns, np.array([3.0, 0, 0])), stamp_ns)
        image[::4, ::4] = i % 2 if i > 15 else 0  # all that the stage looks at
        staged = stage.take(stamp_ns, image)
        reasons += [staged.depth.reason] if staged is not None else []
    assert {reason.split(":")[0] for reason in reasons[1:]} == {FROZEN}
    assert {reason.endswith(" in flight") for reason in reasons[1:]} == {True, False}  # both looks saw it


def test_one_picture_from_the_future_does_not_blind_the_estimator_until_then(wide, save_difference_network):
    """Each picture was left out as not later, for as long as the first was ahead."""
    store = MotionStore(NED_FROM_CAMERA)
    network = load_network(save_difference_network(), device="cpu", threads=1)
    stage = DepthStage(network, Lens(CAMERA), store, ranges=1, fixed=True)
    for i in range(6):
        stamp_ns = 10**9 + i * FRAME_NS + (30 * 10**9 if i == 2 else 0)
        store.add(VelocitySample(10**9 + i * FRAME_NS, np.array([3.0, 0, 0])), 10**9 + i * FRAME_NS)
        staged = stage.take(stamp_ns, seen(wide, i * 0.002))
        assert staged is not None
    assert stage.counts == {"steps back of the pictures' times": 1}
    assert staged.depth.reason is None


def test_positions_of_a_played_log_reach_the_estimator(wide, save_difference_network):
    """They were dropped without a word; all that was left of them were velocities too rough for a slow drone."""
    store = MotionStore(NED_FROM_CAMERA)
    network = load_network(save_difference_network(), device="cpu", threads=1)
    stage = DepthStage(network, Lens(CAMERA), store, ranges=1, fixed=False)
    for i in range(6):
        stamp_ns = 10**9 + i * FRAME_NS
        store.add(PositionSample(stamp_ns, np.array([0.0, 0.1 * i, 0.0])), stamp_ns)
        staged = stage.take(stamp_ns, seen(wide, i * 0.002))
    assert staged.depth.reason is None
    np.testing.assert_allclose(staged.depth.displacements_m, [0.1 * shift for shift in staged.depth.shifts])


def test_what_the_estimators_leave_out_is_told(wide, save_difference_network):
    """Glitches and late samples were counted by nobody, and those of an estimator that is gone went with it."""
    store = MotionStore(NED_FROM_CAMERA)
    network = load_network(save_difference_network(), device="cpu", threads=1)
    stage = DepthStage(network, Lens(CAMERA), store, ranges=1, fixed=False)
    assert not stage.telemetry_dropped
    for i in range(12):
        stamp_ns = 10**9 + i * FRAME_NS
        north_m_s = 300.0 if i == 4 else 3.0
        store.add(VelocitySample(stamp_ns, np.array([north_m_s, 0, 0])), stamp_ns)
        stage.take(stamp_ns, seen(wide, i * 0.002))
    told = stage.telemetry_dropped
    assert told.total() == 1
    stage.prepare(160, 90)
    assert stage.telemetry_dropped == told


def test_a_turn_is_judged_through_the_lens_as_it_zooms(wide, save_difference_network):
    """It was judged through the lens that the user told: twice as wide, twice the turn."""
    network = load_network(save_difference_network(), device="cpu", threads=1)
    store, told = MotionStore(NED_FROM_CAMERA), CAMERA.zoomed(0.5)
    stage = DepthStage(network, Lens(told), store, ranges=1, fixed=False, zoom=lambda _: CAMERA)
    for i in range(4):
        staged = stage.take(10**9 + i * FRAME_NS, seen(wide, i * TURN_RAD - 0.1))
    turned_deg = float(staged.depth.reason.split()[1])
    assert turned_deg == pytest.approx(np.degrees(3 * TURN_RAD), rel=0.05)
