import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightdepth.motion import NED_FROM_CAMERA, rotation_angle_rad, rotation_from_euler
from flightdepth.outputs.level import LevelCamera, SeenMotion, pitch_that_lifts
from flightdepth.ranges.seen_turns import SeenOrientation

S = 1_000_000_000
RATE = 30  # frames a second
AHEAD = np.array([1.0, 0, 0])


def attitude(yaw_deg=0.0, pitch_deg=0.0, roll_deg=0.0):
    angles = np.radians([roll_deg, pitch_deg, yaw_deg])
    return rotation_from_euler(*angles) @ NED_FROM_CAMERA


class Flown:
    """A camera of known attitudes; `see` tells a LevelCamera of one motion after the other."""

    def __init__(self):
        self.level, self.first, self.now_ns = LevelCamera(), None, 0

    def see(self, true, moved_ned=AHEAD, *, seen=None, sigma_rad=0.0, missed=None, after_s=1 / RATE):
        """`seen`: the motion in the camera's axes where that errs; `missed`: the turn that pictures did not show."""
        self.first = true if self.first is None else self.first
        self.true, self.now_ns = true, self.now_ns + round(after_s * S)
        rotation = self.first.T @ true if missed is None else self.first.T @ true @ missed.T
        moved_ned = np.asarray(moved_ned, float)
        moved = true.T @ moved_ned if seen is None else seen
        orientation = SeenOrientation(rotation, self.begun_ns)
        self.level.add(SeenMotion(self.now_ns, orientation, moved, moved_ned, sigma_rad))
        return self.level.at(self.now_ns)

    begun_ns = 0

    def begin(self):
        """The next turn is not known."""
        self.first, self.begun_ns = None, self.now_ns + 1

    def off_deg(self):
        """Of the attitude that is told now."""
        return np.degrees(rotation_angle_rad(self.level.at(self.now_ns).T @ self.true))


@given(st.floats(-180, 180), st.floats(-70, 17), st.floats(-35, 35), st.floats(-0.3, 0.3), st.floats(0.1, 20))
def test_one_motion_tells_yaw_and_pitch_of_a_level_camera(yaw, pitch, aside, climb, speed):
    """Flying ahead within 35 degrees: the other pitch that fits lies far away."""
    moved = speed * rotation_from_euler(0, 0, np.radians(yaw + aside)) @ np.array([1.0, 0.0, climb])
    flown, true = Flown(), attitude(yaw, pitch)
    told = flown.see(true, moved)
    body = NED_FROM_CAMERA @ true.T @ moved
    assert (NED_FROM_CAMERA @ told.T @ moved)[2] == pytest.approx(body[2], abs=1e-6 * speed)
    assert flown.off_deg() < 0.01 or _other_fits(body, moved, np.radians(pitch))


def _other_fits(body, moved, pitch):
    """Whether a pitch nearer to level gives the same height: nobody can tell the two apart."""
    length = np.linalg.norm(moved)
    return abs(pitch_that_lifts(body / length, moved[2] / length, near_rad=0.0)) < abs(pitch) - 1e-6


@given(st.floats(-60, 60), st.floats(-20, 20))
def test_a_camera_that_turns_is_followed_without_lag(yaw_deg_s, pitch_deg_s):
    flown = Flown()
    for frame in range(45):
        flown.see(attitude(yaw_deg_s * frame / RATE, -20 + pitch_deg_s * frame / RATE))
        assert flown.off_deg() < 0.01


def test_of_two_pitches_that_fit_the_one_is_taken_that_was_known():
    """A motion ahead and down, seen at a slant: looking down by 80 degrees or by 10, and 80 was told before."""
    true, flown = attitude(pitch_deg=-80), Flown()
    for body in ([1.0, 0, 0], [0.5**0.5, 0, 0.5**0.5]):
        flown.see(true, true @ NED_FROM_CAMERA.T @ body)
    assert flown.off_deg() < 0.01


def test_a_pitch_that_was_told_stays_told_while_flying_sideways():
    """Turns tell how it goes on; without them sideways motions say nothing."""
    flown = Flown()
    for _ in range(20):
        assert flown.see(attitude(pitch_deg=-30), [0, 1.0, 0]) is None
    for _ in range(5):
        flown.see(attitude(pitch_deg=-30), AHEAD)
    for frame in range(60):
        assert flown.see(attitude(pitch_deg=-30 - frame / 4), [0, 1.0, 0]) is not None
        assert flown.off_deg() < 0.05


@pytest.mark.parametrize(("off_deg", "known"), [(19.5, False), (21.5, True)])
def test_motion_nearly_along_the_right_axis_tells_no_pitch(off_deg, known):
    off = np.radians(off_deg)
    told = Flown().see(attitude(), np.array([np.sin(off), np.cos(off), 0]))
    assert (told is not None) == known


def test_an_unsure_direction_tells_nothing_by_itself():
    assert Flown().see(attitude(), sigma_rad=np.radians(1.8)) is not None
    assert Flown().see(attitude(), sigma_rad=np.radians(2.1)) is None


def test_directions_count_as_they_are_sure():
    """One of 30 degrees aside with 5 degrees of deviation, and one with the least: 101 to 1."""
    flown = Flown()
    aside = np.array([np.sin(np.radians(30)), 0, np.cos(np.radians(30))])
    flown.see(attitude())
    flown.see(attitude(), seen=aside, sigma_rad=np.radians(5))
    assert flown.off_deg() == pytest.approx(np.degrees(np.arctan2(0.5, 101 + 0.75**0.5)), rel=0.1)


def test_noise_averages_out():
    rng, true, moved = np.random.default_rng(0), attitude(40, -28), np.array([5.0, 4.0, 0.0])

    def off_deg(motions):
        flown = Flown()
        for _ in range(motions):
            flown.see(true, moved, seen=true.T @ moved + rng.normal(0, 0.3, 3))
        return flown.off_deg()

    assert np.mean([off_deg(90) for _ in range(10)]) < np.mean([off_deg(1) for _ in range(90)]) / 6


def test_a_turn_that_pictures_missed_is_forgotten():
    """By 20 degrees: after ten seconds those before weigh less than a third, after a minute nothing."""
    flown, turn = Flown(), attitude().T @ attitude(20)
    for _ in range(30):
        flown.see(attitude())
    for second in range(60):
        flown.see(attitude(20), missed=turn, after_s=1.0)
        if second == 9:
            assert 1 < flown.off_deg() < 20
    assert flown.off_deg() < 0.3


def test_where_turns_begin_anew_nothing_of_before_counts():
    """But the pitch, which leads to the nearer of two that fit."""
    flown = Flown()
    for _ in range(10):
        flown.see(attitude(0, -60))
    flown.begin()
    flown.see(attitude(100, -60), [-0.2, 0.6, 0.6])
    assert flown.off_deg() < 0.01


def test_an_attitude_does_not_hold_for_long():
    flown = Flown()
    flown.see(attitude())
    assert flown.level.at(flown.now_ns + S // 10) is not None
    assert flown.level.at(flown.now_ns + S // 5) is not None
    assert flown.level.at(flown.now_ns + S // 5 + S // 100) is None


def test_a_climb_tells_no_yaw():
    """Straight up, as seen and as told, whichever way it looks; a motion ahead tells it then."""
    flown = Flown()
    for _ in range(20):
        assert flown.see(attitude(90), [0, 0, -1.0]) is None
    flown.see(attitude(90), [0, 1.0, 0])
    assert flown.off_deg() < 0.01


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


@pytest.mark.parametrize(("seen", "flown_ned"), [((0, 0, 1.0), (0, 0, 0)), ((0, 0, 0), (1.0, 0, 0))])
def test_standing_still_by_either_leaves_what_was_known(seen, flown_ned):
    flown = Flown()
    assert flown.see(attitude(30), flown_ned, seen=np.array(seen)) is None
    flown.see(attitude(30))
    flown.see(attitude(30), flown_ned, seen=np.array(seen))
    assert flown.off_deg() < 0.01
