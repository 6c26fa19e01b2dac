import math

import numpy as np
import pytest

from flightdepth.flight import gimbal
from flightdepth.flight.gimbal import GimbalAttitude, camera_attitude, looking, with_fixed_camera
from flightdepth.flight.gimbal_heading import followed_offset_deg
from flightdepth.flight.records import BodyAttitudeSample, Telemetry, VelocitySample
from flightdepth.motion import (
    NED_FROM_CAMERA,
    quaternion_from_rotation,
    quaternion_products,
    rotation_from_euler,
    rotation_from_quaternion,
)

NORTH = 64
VEHICLE = 32


def axes(quaternion):
    return rotation_from_quaternion(quaternion)


def test_a_level_gimbal_that_looks_north():
    assert axes(camera_attitude(GimbalAttitude((1, 0, 0, 0), NORTH), None)) == pytest.approx(NED_FROM_CAMERA)


@pytest.mark.parametrize("yaw", [-3.0, -0.4, 1.2])
def test_yaw_from_the_vehicle_is_yaw_from_north_turned_by_the_heading(yaw):
    for roll, pitch in ((0, 0), (0.1, -0.7)):
        relative = quaternion_from_rotation(rotation_from_euler(roll, pitch, 0.3))
        absolute = quaternion_from_rotation(rotation_from_euler(roll, pitch, 0.3 + yaw))
        a = axes(camera_attitude(GimbalAttitude(relative, VEHICLE), yaw))
        b = axes(camera_attitude(GimbalAttitude(relative, VEHICLE, yaw), None))
        c = axes(camera_attitude(GimbalAttitude(absolute, NORTH), None))
        np.testing.assert_allclose(a, c, atol=1e-12)
        np.testing.assert_allclose(b, c, atol=1e-12)


def test_a_heading_of_exactly_0_was_not_told():
    """Who does not know the field leaves it so."""
    gimbal = GimbalAttitude((1, 0, 0, 0), VEHICLE, 0.0)
    assert camera_attitude(gimbal, None) is None
    np.testing.assert_array_equal(
        camera_attitude(gimbal, 1.2), camera_attitude(gimbal._replace(delta_yaw_rad=math.nan), 1.2)
    )


def test_a_neutral_gimbal_looks_ahead_of_the_vehicle_though_it_says_locked():
    """What PX4 1.13 and 1.14 write of gimbals that are servos: NEUTRAL and all locks, always."""
    px4, ahead = 2 | 4 | 8 | 16, (1, 0, 0, 0)
    np.testing.assert_array_equal(
        camera_attitude(GimbalAttitude(ahead, px4), 1.2), camera_attitude(GimbalAttitude(ahead, VEHICLE), 1.2)
    )
    assert camera_attitude(GimbalAttitude(ahead, px4), None) is None
    np.testing.assert_array_equal(
        camera_attitude(GimbalAttitude(ahead, px4 | NORTH), 1.2),
        camera_attitude(GimbalAttitude(ahead, NORTH), None),
    )


def test_no_heading_no_attitude():
    assert camera_attitude(GimbalAttitude((1, 0, 0, 0), VEHICLE), None) is None


TIMES_S = np.arange(600) / 10
NOSE_DEG = (7 * TIMES_S + 180) % 360 - 180  # more than once around


def offset_deg(off_deg):
    """What puts a gimbal right that looks `off_deg` to the left of the nose; None where it does not follow."""
    return followed_offset_deg(TIMES_S, (NOSE_DEG - off_deg + 180) % 360 - 180, NOSE_DEG)


@pytest.mark.parametrize("off_deg", [-59, -12, 0, 36, 59])
def test_a_gimbal_is_put_right_by_as_much_as_it_is_off(off_deg):
    np.testing.assert_allclose(offset_deg(off_deg), off_deg, atol=1e-9)


def test_a_gimbals_heading_that_drifts_is_followed():
    drifting = 20 + 0.3 * TIMES_S
    np.testing.assert_allclose(offset_deg(drifting)[100:-100], drifting[100:-100], atol=0.2)


@pytest.mark.parametrize("moments", [slice(4, None, 10), slice(300, 310)], ids=["each second", "one second"])
@pytest.mark.parametrize("more_deg", [15, -15])
def test_what_differs_for_moments_is_not_the_gimbals_error(moments, more_deg):
    off = np.full(600, 36.0)
    off[moments] += more_deg
    np.testing.assert_allclose(offset_deg(off), 36, atol=1e-9)


@pytest.mark.parametrize("aside_deg", [-45, 45])
@pytest.mark.parametrize(("seldom", "follows"), [(slice(0, 600, 4), False), (slice(0, 600, 6), True)])
def test_a_gimbal_follows_that_seldom_looks_aside(aside_deg, seldom, follows):
    off = np.full(600, 5.0)
    off[seldom] += aside_deg
    assert (offset_deg(off) is not None) == follows


@pytest.mark.parametrize("off_deg", [61, -61, 180, np.nan])
def test_a_gimbal_that_was_turned_aside_or_tells_nothing_stays(off_deg):
    assert offset_deg(off_deg) is None


def flight(*bodies):
    velocities = tuple(VelocitySample(i * 10, [1, 2, 3]) for i in range(len(bodies)))
    return Telemetry(
        "t", velocities, body_attitudes=tuple(BodyAttitudeSample(i * 10 + 3, q) for i, q in enumerate(bodies))
    )


def test_a_camera_on_the_body_looks_where_the_body_flies():
    body = quaternion_from_rotation(rotation_from_euler(0.2, -0.3, 2.0))
    (camera,) = with_fixed_camera(flight(body), looking(0.0)).attitudes
    assert camera.stamp_ns == 3
    # z forward is the body's x, x right its y, y down its z.
    assert axes(camera.world_from_camera) == pytest.approx(axes(body)[:, [1, 2, 0]])


def test_every_camera_on_a_body_is_turned_as_one_is():
    rng = np.random.default_rng(0)
    turns, mounts = rng.normal(size=(40, 4)), [looking(pitch_deg) for pitch_deg in (-90, -30, 0, 75)]
    for mount in mounts:
        cameras = with_fixed_camera(flight(*turns), mount).attitudes
        expected = [axes(turn) @ mount for turn in turns]
        np.testing.assert_allclose([axes(each.world_from_camera) for each in cameras], expected, atol=1e-12)
        assert [each.stamp_ns for each in cameras] == [i * 10 + 3 for i in range(40)]


def test_a_long_log_s_cameras_are_turned_at_once(monkeypatch):
    """One by one it took 27 s for 100,000 attitudes."""
    sizes = []

    def products(first, second):
        sizes.append(first.shape)
        return quaternion_products(first, second)

    monkeypatch.setattr(gimbal, "quaternion_products", products)
    with_fixed_camera(flight(*[(1, 0, 0, 0)] * 50), looking(0.0))
    assert sizes == [(50, 4)]


def test_a_body_that_tells_no_attitude_turns_no_camera():
    assert with_fixed_camera(Telemetry("t", (VelocitySample(0, [1, 2, 3]),)), looking(0.0)).attitudes == []


def test_a_camera_that_looks_down():
    # Forward of the camera is down of the body, up in the picture is ahead.
    body_from_camera = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    half = math.sqrt(0.5)
    (camera,) = with_fixed_camera(flight((half, 0, 0, half)), body_from_camera).attitudes
    np.testing.assert_allclose(
        axes(camera.world_from_camera) @ [[0, 0], [-1, 0], [0, 1]], [[0, 0], [1, 0], [0, 1]], atol=1e-12
    )


def test_what_was_known_of_the_camera_is_replaced():
    telemetry = with_fixed_camera(
        with_fixed_camera(flight((1, 0, 0, 0), (0, 0, 0, 1)), looking(0.0)), looking(0.0)
    )
    assert [sample.stamp_ns for sample in telemetry.samples] == [0, 3, 10, 13]
