"""Turns that pictures show, put together: numbers by hand, and a flight that turns while no log tells it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightdepth.camera import Camera
from flightdepth.flight.steadiness import MAX_DEROTATED_RAD, MAX_REPORTED_RAD, MAX_TURN_RAD
from flightdepth.motion import (
    NED_FROM_CAMERA,
    quaternion_from_rotation,
    rotation_angle_rad,
    rotation_from_euler,
)
from flightdepth.ranges import MultiRangeEstimator
from flightdepth.ranges.displacement import Trajectory
from flightdepth.ranges.pairs import TURNED_AWAY, Frame, Pair, baselines
from flightdepth.ranges.seen_turns import LEAST_TURN_RAD, SeenOrientation, SeenTurns
from flightdepth.renderers.raycast import render
from flightdepth.runtimes.network import Network
from flightdepth.scenes import StillBoxConfig, draw_scene
from flightdepth.stillbox.testset import test_textures as textures_of
from tests_networks import BestHypothesis, swept_card

RATE = 30
NOTHING = np.zeros((1, 1, 3), np.uint8)


def ns(frame):
    return round(frame * 1e9 / RATE)


def yawed(degrees):
    return rotation_from_euler(0, np.radians(degrees), 0)  # about the camera's downward axis


def pair(now, before, attitudes, **how):
    """Of two frames whose attitudes are known."""
    turn = attitudes[now].T @ attitudes[before]
    told = {"directed": False, "seen": True, "covariance": np.eye(6)} | how
    length = np.array([1.0, 0, 0])
    return Pair(Frame(before, ns(before), NOTHING), length, 1.0, 10.0, turn, rotation_angle_rad(turn), **told)


def followed(attitudes, shifts=(1, 3), turns=None):
    """What is known after the last frame, each paired with those so many before."""
    turns, orientation = turns or SeenTurns(), None
    for now in range(1, len(attitudes)):
        pairs = [pair(now, now - shift, attitudes) for shift in shifts if now >= shift]
        orientation = turns.add(ns(now), pairs)
    return turns, orientation


@given(st.lists(st.floats(-4, 4), min_size=4, max_size=20))
def test_turns_add_up(steps_deg):
    """Whichever pairs tell them: the axes are those of the frame after the first."""
    attitudes = [yawed(degrees) for degrees in np.cumsum(steps_deg)]
    for shifts in ((1,), (1, 3), (2, 1)):
        turns, orientation = followed(attitudes, sorted(shifts))
        assert orientation is not None
        off = attitudes[sorted(shifts)[0]].T @ attitudes[-1] @ orientation.rotation.T
        assert rotation_angle_rad(off) < 1e-6 or len(shifts) > 1
        since, known = turns.since(np.array([ns(1), ns(2)]), ns(len(attitudes) - 1))
        assert known.all()
        for k in (0, 1):
            assert rotation_angle_rad(since[k].T @ attitudes[-1].T @ attitudes[k + 1]) < 1e-6


def test_a_camera_turns_on_as_it_did():
    """At 36 degrees a second: the next frame's pairs turned by 1.2 degrees more; half a second later nobody knows."""
    attitudes = [yawed(1.2 * frame) for frame in range(20)]
    turns, _ = followed(attitudes[:-1])
    since, known = turns.since(np.array([ns(10), ns(18)]), ns(19))
    assert known.all()
    assert np.degrees([rotation_angle_rad(each) for each in since]) == pytest.approx([10.8, 1.2], abs=1e-4)
    assert turns.goes_on(ns(19)) and turns.goes_on(ns(22)) and not turns.goes_on(ns(23))


def test_where_no_earlier_frame_is_known_all_begins_anew():
    attitudes = [yawed(frame) for frame in range(200)]
    turns, before = followed(attitudes[:10])
    after = turns.add(ns(150), [pair(150, 149, attitudes), pair(150, 145, attitudes)])
    assert after.begun_ns == ns(150) != before.begun_ns
    assert np.array_equal(after.rotation, np.eye(3))
    since, known = turns.since(np.array([ns(5), ns(145), ns(149)]), ns(150))
    assert known.tolist() == [False, True, True]
    assert np.degrees([rotation_angle_rad(each) for each in since]) == pytest.approx([0, 5, 1], abs=1e-4)


def test_orientations_of_a_moment_have_the_same_axes():
    orientation = SeenOrientation(np.eye(3), 7)
    assert (
        orientation.axes(4_000_000_000) == orientation.axes(5_900_000_000) != orientation.axes(6_000_000_000)
    )
    assert SeenOrientation(np.eye(3), 8).axes(4_000_000_000) != orientation.axes(4_000_000_000)


def test_pairs_that_tell_no_direction_tell_no_turn():
    """A fallback's: nobody took out how they turned."""
    attitudes = [yawed(frame) for frame in range(5)]
    turns = SeenTurns()
    assert turns.add(ns(1), [pair(1, 0, attitudes, seen=False)]) is None
    assert turns.add(ns(1), [pair(1, 0, attitudes, covariance=None)]) is None  # of a moment ago
    assert not turns.goes_on(ns(1))
    told = turns.add(ns(2), [pair(2, 1, attitudes, seen=False), pair(2, 0, attitudes)])
    assert told.begun_ns == ns(2)
    assert turns.since(np.array([ns(0)]), ns(2))[1].all()


def lines_of(frames, now):
    """Baselines of an even flight whose log tells no attitude."""
    trajectory = Trajectory()
    for second in range(10):
        trajectory.add_velocity(second * 10**9, [3.0, 0, 0], frame="world", sigma=None)
    return baselines(trajectory, [Frame(k, ns(k), NOTHING) for k in frames], ns(now), np.radians(20))


def test_pairs_are_expected_to_have_turned_and_those_beyond_the_view_are_left_out():
    attitudes = [yawed(1.5 * frame) for frame in range(21)]
    turns, _ = followed(attitudes[:-1])
    lines = turns.expected(lines_of((2, 8, 15, 19), 20), ns(20), np.radians(20))
    assert np.degrees(lines.turn_rad) == pytest.approx([27, 18, 7.5, 1.5], abs=1e-4)
    assert lines.usable.tolist() == [False, True, True, True]
    assert lines.reason is None
    for k, before in enumerate((2, 8, 15, 19)):
        turned = attitudes[20].T @ attitudes[before]
        np.testing.assert_allclose(lines.current_from_previous[k], turned, atol=1e-6)
    away = turns.expected(lines_of((2, 4), 20), ns(20), np.radians(20))
    assert away.reason == TURNED_AWAY


def test_small_turns_are_left_to_each_pair():
    attitudes = [yawed(0.2 * frame) for frame in range(21)]
    turns, _ = followed(attitudes[:-1])
    lines = turns.expected(lines_of((10, 18), 20), ns(20), np.radians(20))
    assert lines.turn_rad[0] == pytest.approx(np.radians(2), abs=1e-6) and lines.turn_rad[1] == 0
    assert np.array_equal(lines.current_from_previous[1], np.eye(3))
    assert np.degrees(LEAST_TURN_RAD) > 0.4


def test_nothing_is_expected_of_a_camera_that_was_lost_a_while_ago():
    turns, _ = followed([yawed(2 * frame) for frame in range(10)])
    lines = lines_of((5, 9), 20)
    assert turns.expected(lines, ns(20), np.radians(20)) is lines


CAMERA = Camera.from_fov(128, 128, 90)
FRAMES = 30


@pytest.fixture(scope="module")
def turning():
    """A room seen by a camera that begins to pan and reaches 50 degrees a second: what is seen, attitudes, velocity."""
    textures = textures_of(5)
    scene = draw_scene(StillBoxConfig(frames=FRAMES), len(textures), 5, 3)
    degrees = 25 * (np.arange(FRAMES) / RATE) ** 2
    attitudes = np.stack([scene.world_from_camera[0] @ yawed(each) for each in degrees])
    seen = render(replace(scene, world_from_camera=attitudes), textures, CAMERA)
    velocity = np.diff(scene.camera_position, axis=0)[0] * RATE
    return seen, NED_FROM_CAMERA @ attitudes, NED_FROM_CAMERA @ velocity


def flown(turning, *, told):
    seen, attitudes, velocity = turning
    estimator = MultiRangeEstimator(Network(swept_card(), BestHypothesis()), CAMERA, ranges=1)
    results, limits = [], []
    for frame in range(FRAMES):
        estimator.add_velocity(ns(frame), velocity, frame="world")
        if told:
            estimator.add_attitude(ns(frame), quaternion_from_rotation(attitudes[frame]))
    for frame, picture in enumerate(seen.images):
        limits.append(estimator.max_turn_rad(ns(frame)))
        results.append(estimator.add_frame(ns(frame), picture))
    return results, limits


def test_a_camera_that_turns_fast_has_the_depth_that_an_attitude_in_the_log_would_give(turning):
    (told, _), (seen, limits) = flown(turning, told=True), flown(turning, told=False)
    first = next(k for k, result in enumerate(seen) if result.reason is None)
    assert all(result.reason is None for result in seen[first:])
    assert limits[: first + 1] == [MAX_DEROTATED_RAD] * (first + 1)
    assert limits[first + 1 :] == [MAX_REPORTED_RAD] * (FRAMES - first - 1)
    truth_m = turning[0].depth_m[FRAMES - 8 :]

    def off_and_known(results):
        depth_m = np.stack([result.depth_m for result in results[FRAMES - 8 :]])
        return np.nanmedian(np.abs(np.log(depth_m / truth_m))), np.isfinite(depth_m).mean()

    (told_off, told_known), (seen_off, seen_known) = off_and_known(told), off_and_known(seen)
    assert seen_off < told_off + 0.02
    assert seen_known > told_known - 0.05


def test_the_orientation_that_is_seen_follows_the_camera(turning):
    _, attitudes, _ = turning
    results, _ = flown(turning, told=False)
    begun = round(results[-1].orientation.begun_ns * RATE / 1e9)
    assert begun < 6
    for k in range(begun, FRAMES):
        orientation = results[k].orientation
        assert orientation.begun_ns == ns(begun)
        off = attitudes[begun].T @ attitudes[k] @ orientation.rotation.T
        assert np.degrees(rotation_angle_rad(off)) < 0.5


def test_a_log_that_tells_the_attitude_is_not_asked_for_another(turning):
    results, limits = flown(turning, told=True)
    assert all(result.orientation is None for result in results)
    assert limits == [MAX_REPORTED_RAD] * FRAMES
    assert MAX_TURN_RAD < MAX_DEROTATED_RAD
