"""What the noise does to a pair: angles, sizes, and that a turn is the turn of a camera."""

from dataclasses import replace

import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.stillbox import motion_noise
from flightdepth.stillbox.motion_noise import MotionNoise, rotated, tilted
from flightdepth.stillbox.pairs import Pair

CAMERA = Camera.from_fov(96, 64, 70).cropped(4, -3, 96, 64)


def waves(camera: Camera, turn: np.ndarray) -> np.ndarray:
    """A pattern infinitely far away, seen by a camera with the orientation `turn`."""
    rays = camera.rays() @ turn.T
    x, y = rays[..., 0] / rays[..., 2], rays[..., 1] / rays[..., 2]
    grey = np.rint(128 + 60 * np.sin(12 * x) + 50 * np.cos(14 * y)).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)


def pair() -> Pair:
    picture = waves(CAMERA, np.eye(3))
    return Pair(picture, picture, np.ones((64, 96), np.float32), np.array([0.1, 0.2, 0.2]), CAMERA)


@pytest.mark.parametrize("angle_deg", [0.0, 1.0, 5.0, 90.0])
def test_a_vector_is_tilted_by_the_angle_and_keeps_its_length(angle_deg):
    vector = np.array([0.3, -0.2, 0.1])
    found = tilted(vector, np.array([0.5, 0.5, -0.7]), angle_deg)
    cosine = found @ vector / (vector @ vector)
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))) == pytest.approx(angle_deg, abs=1e-5)
    assert np.linalg.norm(found) == pytest.approx(np.linalg.norm(vector))


def test_nothing_is_tilted_towards_itself():
    vector = np.array([0.0, 0.0, 2.0])
    assert np.array_equal(tilted(vector, np.array([0.0, 0.0, 1.0]), 5.0), vector)


@pytest.mark.parametrize("axis", np.eye(3))
def test_a_rotated_picture_is_what_the_turned_camera_sees(axis):
    import cv2

    vector = axis * np.radians(2)
    expected = waves(CAMERA, cv2.Rodrigues(vector)[0]).astype(float)
    found = rotated(waves(CAMERA, np.eye(3)), CAMERA, vector)
    inner = np.abs(found - expected)[6:-6, 6:-6]
    assert inner.mean() < 1.0
    assert np.abs(expected - waves(CAMERA, np.eye(3)))[6:-6, 6:-6].mean() > 3.0


def test_only_the_motion_and_the_earlier_picture_change():
    before, rng = pair(), np.random.default_rng(0)
    after = MotionNoise(5, 0.5)(rng, before)
    assert np.array_equal(after.current, before.current)
    assert np.array_equal(after.target_m, before.target_m)
    assert not np.array_equal(after.displacement, before.displacement)


def test_angles_stay_below_the_largest_and_most_are_small():
    before, rng = pair(), np.random.default_rng(0)
    moved = [MotionNoise(5, 0)(rng, before).displacement for _ in range(300)]
    cosines = np.array([m @ before.displacement for m in moved]) / (before.displacement @ before.displacement)
    angles = np.degrees(np.arccos(np.clip(cosines, -1, 1)))
    assert angles.max() < 5
    assert np.median(angles) == pytest.approx(5 / 8, rel=0.25)


def test_no_noise_changes_nothing():
    before = pair()
    after = MotionNoise(0, 0)(np.random.default_rng(0), before)
    assert np.array_equal(after.previous, before.previous)
    assert after.displacement == pytest.approx(before.displacement)


def test_a_turn_repeats_the_border():
    """Black corners would tell a network how far a picture was turned."""
    plain = np.full((64, 96, 3), 90, np.uint8)
    assert (rotated(plain, CAMERA, np.array([0.05, 0.05, 0.1])) == 90).all()


def test_the_earlier_picture_is_the_one_that_is_turned():
    plain = np.full((64, 96, 3), 90, np.uint8)
    after = MotionNoise(5, 0.5)(np.random.default_rng(0), replace(pair(), previous=plain))
    assert np.array_equal(after.previous, plain)


def test_rotations_stay_below_the_largest_and_do_not_hang_on_the_direction_s_errors(monkeypatch):
    """In degrees; most are small."""
    turns, before, rng = [], pair(), np.random.default_rng(0)
    monkeypatch.setattr(motion_noise, "rotated", lambda image, _, vector: (turns.append(vector), image)[1])
    for _ in range(300):
        MotionNoise(40, 0.5)(rng, before)
    angles = np.degrees(np.linalg.norm(turns, axis=1))
    assert 0.3 < angles.max() < 0.5
    assert np.median(angles) == pytest.approx(0.5 / 8, rel=0.25)


def test_the_axis_of_a_rotation_has_nothing_to_do_with_the_direction_s_error(monkeypatch):
    turns, before, rng = [], pair(), np.random.default_rng(0)
    monkeypatch.setattr(motion_noise, "rotated", lambda image, _, vector: (turns.append(vector), image)[1])
    errors = [MotionNoise(5, 0.5)(rng, before).displacement - before.displacement for _ in range(300)]
    axes, ways = (
        each / np.linalg.norm(each, axis=1, keepdims=True) for each in (np.array(turns), np.array(errors))
    )
    assert abs((axes * ways).sum(axis=1).mean()) < 0.1  # of independent ones its deviation is 0.03
