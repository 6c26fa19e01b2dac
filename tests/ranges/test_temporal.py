"""Depth averaged over frames: it holds still, follows the motion, and does not smear what disagrees."""

import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.motion import NED_FROM_CAMERA, quaternion_from_rotation, rotation_from_euler
from flightdepth.ranges.displacement import Trajectory
from flightdepth.ranges.fusion import Fused
from flightdepth.ranges.reprojection import Reprojection, Step, step_between
from flightdepth.ranges.temporal import AGREE_WITHIN, GAIN, TemporalAverage

CAMERA = Camera.from_fov(128, 128, 90)
SHAPE = (32, 32)
STILL = np.zeros(3)


def fused(depth_m, sigma_m=None) -> Fused:
    depth_m = np.broadcast_to(np.asarray(depth_m, dtype=np.float32), SHAPE)
    nothing = np.full(SHAPE, np.nan, dtype=np.float32)
    confidence = np.where(np.isfinite(depth_m), np.float32(0.5), np.float32(0))
    sigma = None if sigma_m is None else np.broadcast_to(np.asarray(sigma_m, dtype=np.float32), SHAPE)
    return Fused(depth_m, confidence, nothing, nothing, sigma)


def step(displacement_m=STILL, turn=None) -> Step:
    return Step(np.asarray(displacement_m, dtype=np.float64), np.eye(3) if turn is None else turn)


def averaged(*maps, by=STILL) -> Fused:
    average = TemporalAverage(Reprojection(CAMERA, SHAPE))
    for each in maps[:-1]:
        average.add(each, step(by))
    return average.add(maps[-1], step(by))


def test_the_first_frame_and_one_without_known_motion_stay_as_they_are():
    average = TemporalAverage(Reprojection(CAMERA, SHAPE))
    for depth_m in (10.0, 11.0):
        np.testing.assert_array_equal(average.add(fused(depth_m), None).depth_m, np.float32(depth_m))


def test_the_average_by_hand():
    found = averaged(fused(10.0, 1.0), fused(11.0, 2.0))
    np.testing.assert_allclose(found.depth_m, GAIN * 11 + (1 - GAIN) * 10, rtol=1e-6)
    np.testing.assert_allclose(found.sigma_m, GAIN * 2 + (1 - GAIN) * 1, rtol=1e-6)


def test_noise_of_independent_frames_falls_as_an_exponential_average_says():
    """Variance times GAIN / (2 - GAIN) once settled."""
    noise = np.random.default_rng(0).normal(0, 0.3, (40, *SHAPE))
    found = averaged(*(fused(30 + each) for each in noise))
    assert found.depth_m.std() == pytest.approx(0.3 * np.sqrt(GAIN / (2 - GAIN)), rel=0.1)
    assert found.depth_m.mean() == pytest.approx(30, abs=0.05)


def test_a_wall_that_comes_nearer_is_followed_exactly():
    walls = [fused(20.0 - 0.5 * frame) for frame in range(10)]
    np.testing.assert_allclose(averaged(*walls, by=[0, 0, 0.5]).depth_m, 15.5, rtol=1e-5)


def test_an_edge_moves_with_the_camera_and_is_not_smeared():
    """A step of one column of the map to the right moves the near half one column to the left."""
    near_m, far_m = 8.0, 40.0
    column_m = near_m / CAMERA.resized(*SHAPE[::-1]).fx
    columns = np.arange(SHAPE[1])
    frames = [fused(np.where(columns < 20 - frame, near_m, far_m)) for frame in range(6)]
    found = averaged(*frames, by=[column_m, 0, 0])
    np.testing.assert_allclose(found.depth_m, frames[-1].depth_m, rtol=1e-5)


def test_a_thing_that_crosses_leaves_no_trail():
    columns = np.arange(SHAPE[1])
    frames = [fused(np.where(abs(columns - 4 * frame) < 3, 5.0, 30.0)) for frame in range(6)]
    np.testing.assert_allclose(averaged(*frames).depth_m, frames[-1].depth_m, rtol=1e-6)


def test_what_disagrees_starts_anew():
    for ratio in (1.01 * AGREE_WITHIN, 1 / (1.01 * AGREE_WITHIN)):
        np.testing.assert_array_equal(
            averaged(fused(20.0), fused(20 * ratio)).depth_m, np.float32(20 * ratio)
        )


def test_unknown_stays_unknown_and_what_was_unknown_starts_anew():
    unknown = fused(np.where(np.arange(SHAPE[1]) < 16, np.nan, 10.0), 1.0)
    found = averaged(fused(11.0, 1.0), unknown)
    np.testing.assert_array_equal(np.isnan(found.depth_m), np.isnan(unknown.depth_m))
    assert (found.confidence[:, :16] == 0).all()
    np.testing.assert_array_equal(averaged(unknown, fused(11.0, 2.0)).depth_m[:, :16], np.float32(11))


def test_a_turn_is_followed():
    """Left half at 9 m, right half at 11 m; then the camera turns right by two columns and sees 10 m."""
    angle = np.arctan(2 / CAMERA.resized(*SHAPE[::-1]).fx)
    turn = rotation_from_euler(0, -angle, 0)  # what was ahead is to the left now
    assert (turn @ [0, 0, 1.0])[0] < 0
    average = TemporalAverage(Reprojection(CAMERA, SHAPE))
    average.add(fused(np.where(np.arange(SHAPE[1]) < 16, 9.0, 11.0)), None)
    row = average.add(fused(10.0), step(turn=turn)).depth_m[16]
    assert (row[12:14] < 10).all()
    assert (row[14:18] > 10).all()


def test_steps_come_from_the_log_and_directions_from_the_pictures():
    trajectory = Trajectory()
    for stamp in (0, 1_000_000_000):
        trajectory.add_velocity(stamp, [3.0, 0.0, 4.0], frame="world", sigma=None)
    times = (0, 200_000_000)
    assert step_between(trajectory, times, None) is None
    seen = step_between(trajectory, times, np.array([0.0, 1.0, 0.0]))
    assert seen is not None
    np.testing.assert_allclose(seen.displacement_m, [0, 1.0, 0])
    for stamp in (0, 1_000_000_000):
        trajectory.add_attitude(stamp, [1.0, 0.0, 0.0, 0.0])
    told = step_between(trajectory, times, None)
    assert told is not None
    np.testing.assert_allclose(told.displacement_m, [0.6, 0, 0.8])
    assert step_between(trajectory, (0, 9_000_000_000), None) is None


def test_a_step_is_told_in_the_axes_of_the_camera_that_turned_meanwhile():
    """3 m/s east for a second, level; the camera looked east, and then north."""
    trajectory, second = Trajectory(), 1_000_000_000
    for k in range(2):
        attitude = rotation_from_euler(0, 0, (1 - k) * np.pi / 2) @ NED_FROM_CAMERA
        trajectory.add_attitude(k * second, quaternion_from_rotation(attitude))
        trajectory.add_velocity(k * second, [0.0, 3.0, 0.0], frame="world", sigma=None)
    for seen, moved_m in ((None, [3, 0, 0]), ([0.6, 0.0, 0.8], [1.8, 0, 2.4])):
        told = step_between(trajectory, (0, second), None if seen is None else np.array(seen))
        np.testing.assert_allclose(told.displacement_m, moved_m, atol=1e-9)
        np.testing.assert_allclose(told.current_from_previous @ [0, 0, 1.0], [1, 0, 0], atol=1e-9)


def test_no_step_is_known_where_the_log_has_a_gap():
    """Whatever direction the pictures show: how far it was they do not."""
    trajectory, second, unit = Trajectory(), 1_000_000_000, np.array([1.0, 0.0, 0.0])
    for stamp in (0, second, 20 * second):
        trajectory.add_velocity(stamp, [3.0, 0.0, 4.0], frame="world", sigma=None)
    for times in ((0, 9 * second), (8 * second, 9 * second), (0, 20 * second)):
        assert step_between(trajectory, times, unit) is None
    assert step_between(trajectory, (0, second), unit) is not None


def test_a_camera_that_is_taken_not_to_turn_needs_no_attitude():
    trajectory = Trajectory()
    for stamp in (0, 1_000_000_000):
        trajectory.add_velocity(stamp, [3.0, 0.0, 4.0], frame="camera", sigma=None)
    np.testing.assert_allclose(step_between(trajectory, (0, 200_000_000), None).displacement_m, [0.6, 0, 0.8])


def test_points_are_found_again_by_a_camera_that_moved_and_turned():
    """A wall 20 m ahead, then seen from elsewhere by a network that errs by 5 %, of which 2 % are left."""
    turn, moved_m = rotation_from_euler(0, 0.2, 0), np.array([2.0, 0.0, 3.0])
    rays = CAMERA.resized(*SHAPE[::-1]).rays()
    # X_previous = R^T (X_current + displacement) lies on the wall.
    depth_m = (20 - (turn.T @ moved_m)[2]) / (rays @ turn)[..., 2]
    average = TemporalAverage(Reprojection(CAMERA, SHAPE))
    average.add(fused(20.0), None)
    found = average.add(fused(1.05 * depth_m), step(moved_m, turn)).depth_m
    middle = np.s_[8:24, 8:24]
    np.testing.assert_allclose(found[middle] / depth_m[middle], 1 + GAIN * 0.05, atol=0.004)
