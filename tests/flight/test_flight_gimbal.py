import math

import numpy as np
import pytest

from flightdepth.flight.gimbal import GimbalAttitude, camera_attitude, looking, with_fixed_camera
from flightdepth.flight.records import BodyAttitudeSample, Telemetry, VelocitySample
from flightdepth.motion import (
    NED_FROM_CAMERA,
    quaternion_from_rotation,
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
