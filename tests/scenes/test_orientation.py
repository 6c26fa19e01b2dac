"""Turns, orientation noise and quaternions against references that were written by others."""

import itertools

import cv2
import numpy as np
import pytest

from flightdepth.motion import (
    quaternion_from_rotation,
    rotation_angle_rad,
    rotation_from_euler,
    rotation_from_quaternion,
)
from flightdepth.scenes import StillBoxConfig, chance, draw_scene
from flightdepth.scenes.orientation import composed, euler, noisy_orientations
from flightdepth.scenes.outdoor import draw_outdoor
from flightdepth.scenes.outdoor_config import OutdoorConfig

N0 = 0.001  # the paper's
ANGLES = list(itertools.product((-2.5, -0.3, 0.0, 0.001, 1.2), repeat=3))
AXES = np.eye(3)
FLOAT32 = 2e-7


# Euler angles


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("angle", [-3.0, -0.001, 0.7])
def test_one_angle_is_a_turn_about_its_axis(axis, angle):
    reference, _ = cv2.Rodrigues(angle * AXES[axis])
    np.testing.assert_allclose(euler(angle * AXES[axis]), reference, atol=FLOAT32 * abs(angle) * 10)


@pytest.mark.parametrize("angles", ANGLES)
def test_x_is_turned_about_first_and_z_last(angles):
    about_x, about_y, about_z = (cv2.Rodrigues(angle * AXES[k])[0] for k, angle in enumerate(angles))
    np.testing.assert_allclose(euler(np.array(angles)), about_z @ about_y @ about_x, atol=5e-6)
    np.testing.assert_allclose(euler(np.array(angles)), rotation_from_euler(*angles), atol=5e-6)


@pytest.mark.parametrize("angles", ANGLES)
def test_a_turn_is_a_rotation_to_the_last_bits(angles):
    turn = euler(np.array(angles))
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(turn) == pytest.approx(1, abs=1e-15)


def test_no_angle_is_no_turn():
    np.testing.assert_array_equal(euler(np.zeros(3)), np.eye(3))


def test_the_bits_of_a_turn():
    row = [float(value).hex() for value in euler(np.array([0.001, -0.002, 0.5]))[0]]
    assert row == ["0x1.c152459f78ee7p-1", "-0x1.eaeeec88453f2p-2", "-0x1.4e6d4c4f75ccap-10"]


def test_composition_is_the_matrix_product():
    first, second = chance.rotation(chance.stream(1)), chance.rotation(chance.stream(2))
    np.testing.assert_allclose(composed(first, second), first @ second, atol=1e-15)


# Orientation noise


@pytest.fixture(scope="module")
def steady():
    return chance.rotation(chance.stream(3))


@pytest.fixture(scope="module")
def noise(steady):
    """World-fixed R0 against R(t): R0^T R(t) for 4000 frames."""
    return steady.T @ noisy_orientations(chance.stream(9), steady, 4000, N0)


def test_each_frame_is_turned_by_the_noise_s_angle(noise):
    # Euler angles of length N0 are a turn of N0 (1 + O(N0)).
    angles = np.array([rotation_angle_rad(turn) for turn in noise])
    np.testing.assert_allclose(angles, N0, rtol=N0)


def test_the_noise_has_mean_zero_and_no_preferred_axis(noise):
    axes = np.array([cv2.Rodrigues(turn)[0][:, 0] for turn in noise]) / N0
    # Deviations of the means over n = 4000: sqrt(1/3 / n) for x, sqrt(4/45 / n) for x^2.
    assert np.abs(axes.mean(axis=0)).max() < 4.5 * np.sqrt(1 / 3 / 4000)
    assert np.abs((axes**2).mean(axis=0) - 1 / 3).max() < 4.5 * np.sqrt(4 / 45 / 4000)


def test_frames_next_to_each_other_have_nothing_in_common(noise):
    axes = np.array([cv2.Rodrigues(turn)[0][:, 0] for turn in noise]) / N0
    together = (axes[1:] * axes[:-1]).sum(axis=1)
    # Products of independent unit vectors: mean 0, variance 1/3.
    assert abs(together.mean()) < 4.5 * np.sqrt(1 / 3 / 3999)
    assert together.max() < 1 - 1e-5


def test_no_noise_is_the_steady_orientation(steady):
    np.testing.assert_array_equal(noisy_orientations(chance.stream(9), steady, 3, 0.0), [steady] * 3)


def test_noise_changes_nothing_but_the_orientation():
    quiet, noisy = (draw_scene(StillBoxConfig(orientation_noise_rad=n), 8, 3, 5) for n in (0.0, N0))
    np.testing.assert_array_equal(noisy.world_from_object, quiet.world_from_object)
    np.testing.assert_array_equal(noisy.camera_position, quiet.camera_position)
    np.testing.assert_array_equal(noisy.lamp_power, quiet.lamp_power)
    angles = [rotation_angle_rad(turn) for turn in noisy.world_from_camera]
    np.testing.assert_allclose(angles, N0, rtol=N0)


def test_noise_is_its_seed_s_and_number_s():
    config = StillBoxConfig(orientation_noise_rad=N0)
    first, again, seed, number = (
        draw_scene(config, 8, *key).world_from_camera for key in ((3, 5), (3, 5), (4, 5), (3, 6))
    )
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, seed)
    assert not np.array_equal(first, number)


def test_a_longer_scene_begins_as_the_shorter_one():
    short, long = (
        draw_scene(StillBoxConfig(orientation_noise_rad=N0, frames=frames), 8, 3, 5) for frames in (4, 9)
    )
    np.testing.assert_array_equal(long.world_from_camera[:4], short.world_from_camera)


def test_outdoors_the_noise_comes_on_top_of_the_camera_s_slope():
    quiet, noisy = (
        draw_outdoor(OutdoorConfig(frames=5, orientation_noise_rad=n), 3).world_from_camera
        for n in (0.0, 0.01)
    )
    angles = [rotation_angle_rad(one.T @ other) for one, other in zip(quiet, noisy, strict=True)]
    np.testing.assert_allclose(angles, 0.01, rtol=0.01)


# Quaternions


def rotations(count):
    return np.array([chance.rotation(chance.stream(5, n)) for n in range(count)])


def test_quaternions_and_back():
    turns = rotations(50)
    found = np.array([quaternion_from_rotation(turn) for turn in turns])
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1)
    assert (found[:, 0] >= 0).all()
    np.testing.assert_allclose([rotation_from_quaternion(q) for q in found], turns, atol=1e-12)


@pytest.mark.parametrize("vector", [(0.3, 0, 0), (0, -0.3, 0), (0, 0, 1.2), (0.4, -1.1, 0.9)])
def test_a_quaternion_is_cosine_and_sine_of_half_the_angle(vector):
    angle = np.linalg.norm(vector)
    turn, _ = cv2.Rodrigues(np.array(vector, dtype=np.float64))
    expected = [np.cos(angle / 2), *(np.sin(angle / 2) * np.array(vector) / angle)]
    np.testing.assert_allclose(quaternion_from_rotation(turn), expected, atol=1e-12)


def test_a_product_of_rotations_is_the_product_of_quaternions():
    first, second = rotations(2)
    (a, u), (b, v) = ((q[0], q[1:]) for q in map(quaternion_from_rotation, (first, second)))
    product = np.array([a * b - u @ v, *(a * v + b * u + np.cross(u, v))])
    found = quaternion_from_rotation(first @ second)
    np.testing.assert_allclose(found, product * np.sign(product[0]), atol=1e-12)
