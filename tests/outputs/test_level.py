import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightdepth.motion import NED_FROM_CAMERA, rotation_angle_rad, rotation_from_euler
from flightdepth.outputs.level import LevelCamera, pitch_that_lifts

S = 1_000_000_000


def attitude(yaw_rad, pitch_rad):
    return rotation_from_euler(0, pitch_rad, yaw_rad) @ NED_FROM_CAMERA


@given(
    st.floats(-3.1, 3.1), st.floats(-1.2, 0.3), st.floats(-0.6, 0.6), st.floats(-0.3, 0.3), st.floats(0.1, 20)
)
def test_one_motion_tells_yaw_and_pitch_of_a_level_camera(yaw, pitch, aside, climb, speed):
    """Flying ahead within 35 degrees: the other pitch that fits lies far away."""
    moved = speed * rotation_from_euler(0, 0, yaw + aside) @ np.array([1.0, 0.0, climb])
    level, true = LevelCamera(), attitude(yaw, pitch)
    for i in range(3):
        level.add(i * S, true.T @ moved, moved)
    body = NED_FROM_CAMERA @ true.T @ moved
    lifted = rotation_from_euler(0, pitch_that_lifts(body / speed, moved[2] / speed, near_rad=0), 0) @ body
    assert lifted[2] == pytest.approx(moved[2], abs=1e-6 * speed)
    assert rotation_angle_rad(level.at(2 * S).T @ true) < 1e-4 or _other_fits(body, moved, pitch)


def _other_fits(body, moved, pitch):
    """Whether a pitch nearer to level gives the same height: nobody can tell the two apart."""
    length = np.linalg.norm(moved)
    return abs(pitch_that_lifts(body / length, moved[2] / length, near_rad=0.0)) < abs(pitch) - 1e-6


def test_of_two_pitches_that_fit_the_one_is_taken_that_was_known():
    """A motion ahead and down, seen at a slant: looking down by 80 degrees or by 10, and 80 was told before."""
    true = rotation_from_euler(0, np.radians(-80), 0)
    level = LevelCamera()
    for i, body in enumerate(([1.0, 0, 0], [0.5**0.5, 0, 0.5**0.5])):
        level.add(i * S // 10, NED_FROM_CAMERA.T @ body, true @ body)
        assert rotation_angle_rad(level.at(i * S // 10).T @ true @ NED_FROM_CAMERA) < 1e-6


def test_flying_exactly_sideways_tells_no_pitch():
    level = LevelCamera()
    for i in range(30):
        level.add(i * S // 30, np.array([1.0, 0, 0]), np.array([0, 1.0, 0]))
    assert level.at(S) is None


def test_an_attitude_does_not_hold_for_long():
    level = LevelCamera()
    level.add(0, np.array([0, 0, 1.0]), np.array([1.0, 0, 0]))
    assert level.at(S // 4) is not None
    assert level.at(S // 2) is not None
    assert level.at(S // 2 + S // 100) is None
    assert level.at(2 * S) is None


def test_noise_averages_out():
    rng, true, moved = np.random.default_rng(0), attitude(0.7, -0.5), np.array([5.0, 4.0, 0.0])
    level = LevelCamera()
    off = []
    for i in range(90):
        seen = true.T @ moved + rng.normal(0, 0.3, 3)
        level.add(i * S // 30, seen, moved)
        off.append(rotation_angle_rad(level.at(i * S // 30).T @ true))
    assert np.mean(off[60:]) < np.mean(off[:1]) + 0.02
    assert np.mean(off[60:]) < 0.03


def test_standing_still_says_nothing():
    level = LevelCamera()
    level.add(0, np.zeros(3), np.zeros(3))
    assert level.at(0) is None


def told(level, at_ns):
    """Yaw and pitch, degrees, of the attitude at a time."""
    body = level.at(at_ns) @ NED_FROM_CAMERA.T
    return np.degrees(np.arctan2(body[1, 0], body[0, 0])), np.degrees(-np.arcsin(body[2, 0]))


def ahead(level, at_ns, yaw_deg=0.0, pitch_deg=0.0):
    """A motion along the camera's forward axis."""
    true = attitude(np.radians(yaw_deg), np.radians(pitch_deg))
    level.add(at_ns, np.array([0, 0, 1.0]), true @ np.array([0, 0, 1.0]))


def test_an_older_yaw_fades_within_half_a_second():
    """North, and half a second later east: arrows of 1/e north and 1 east."""
    level = LevelCamera()
    ahead(level, 0)
    ahead(level, S // 2, yaw_deg=90)
    assert told(level, S // 2)[0] == pytest.approx(np.degrees(np.arctan2(1, np.exp(-1))), abs=1e-6)


def test_an_older_pitch_fades_within_two_seconds():
    level = LevelCamera()
    ahead(level, 0)
    ahead(level, 2 * S, pitch_deg=-30)
    assert told(level, 2 * S)[1] == pytest.approx(-30 / (1 + np.exp(-1)), abs=1e-6)


@pytest.mark.parametrize(("off_deg", "known"), [(12.5, False), (13.5, True)])
def test_motion_nearly_along_the_right_axis_tells_no_pitch(off_deg, known):
    level, off = LevelCamera(), np.radians(off_deg)
    level.add(0, np.array([np.cos(off), 0, np.sin(off)]), np.array([np.sin(off), np.cos(off), 0]))
    assert (level.at(0) is not None) == known


def test_a_climb_tells_no_yaw():
    """Its arrow is as short as its way over ground: a motion ahead outweighs twenty climbs."""
    level = LevelCamera()
    for _ in range(20):
        level.add(0, np.array([0, -1.0, 0.01]), np.array([0, 0.01, -1.0]))
    ahead(level, 0)
    assert abs(told(level, 0)[0]) < 0.2


def test_no_gimbal_looks_farther_than_100_degrees_down_or_up():
    """Ahead and 30 degrees down in the world: by 30 degrees, or by 150, of which none is that near."""
    body = np.array([1.0, 0, 0])
    assert np.degrees(pitch_that_lifts(body, 0.5, near_rad=0.0)) == pytest.approx(-30)
    assert np.degrees(pitch_that_lifts(body, 0.5, near_rad=np.radians(-140))) == pytest.approx(-100)
    assert np.degrees(pitch_that_lifts(body, -0.5, near_rad=np.radians(140))) == pytest.approx(100)


def test_where_no_pitch_fits_it_is_the_one_that_comes_nearest():
    """Half of the motion is along the right axis, and the log says that it climbs nearly straight."""
    body = np.array([0.5**0.5, 0.5**0.5, 0])
    assert np.degrees(pitch_that_lifts(body, -0.9, near_rad=0.0)) == pytest.approx(90)
    assert pitch_that_lifts(np.array([0, 1.0, 0]), 0.3, near_rad=0.2) == 0.2


@pytest.mark.parametrize(("seen", "flown"), [((0, 0, 1.0), (0, 0, 0)), ((0, 0, 0), (1.0, 0, 0))])
def test_standing_still_by_either_leaves_what_was_known(seen, flown):
    level = LevelCamera()
    ahead(level, 0, yaw_deg=30)
    level.add(S // 10, np.array(seen, float), np.array(flown, float))
    assert told(level, S // 10) == pytest.approx((30, 0), abs=1e-6)
