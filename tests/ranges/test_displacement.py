import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from flightdepth.errors import BadInput
from flightdepth.flight.records import HOLD_S, MAX_GAP_S
from flightdepth.motion import quaternion_from_rotation, rotation_from_euler
from flightdepth.ranges.displacement import Trajectory, integrate, left_open
from flightdepth.ranges.timeline import MOST_ROWS

S = 1_000_000_000
EPOCH = 1_700_000_000 * S  # stamps of a real clock must lose no precision


def trajectory(*samples: tuple[float, tuple[float, float, float]], frame: str = "world") -> Trajectory:
    made = Trajectory()
    for seconds, velocity in samples:
        made.add_velocity(EPOCH + round(seconds * S), velocity, frame=frame, sigma=None)
    return made


def displacement(track: Trajectory, start_s: float, end_s: float) -> np.ndarray | None:
    """None where the two times are not connected."""
    states = track.at(np.array([EPOCH + round(start_s * S), EPOCH + round(end_s * S)]))
    if states.segment[0] != states.segment[1] or states.segment[0] < 0:
        return None
    return states.position_m[1] - states.position_m[0]


speeds = st.floats(-15, 15)


@given(st.tuples(speeds, speeds, speeds), st.floats(0, 3), st.floats(0, 0.9))
def test_constant_velocity_flies_speed_times_time(velocity, start, length) -> None:
    track = trajectory(*((0.25 * k, velocity) for k in range(20)))
    flown = displacement(track, start, start + length)
    np.testing.assert_allclose(np.linalg.norm(flown), np.linalg.norm(velocity) * length, atol=1e-7)


@given(st.lists(st.tuples(speeds, speeds, speeds), min_size=3, max_size=20), st.floats(0, 1), st.floats(0, 1))
def test_displacements_add_up(velocities, first, second) -> None:
    stamps = np.arange(len(velocities), dtype=np.int64) * S // 4
    middle, end = sorted(np.array([first, second]) * stamps[-1])
    at = np.array([0, round(middle), round(end), stamps[-1]], dtype=np.int64)
    position, _ = integrate(stamps, np.array(velocities), at)
    np.testing.assert_allclose(np.diff(position, axis=0).sum(axis=0), position[-1] - position[0], atol=1e-9)
    trapezoid = np.trapezoid(np.array(velocities), dx=0.25, axis=0)
    np.testing.assert_allclose(position[-1] - position[0], trapezoid, atol=1e-9)


def test_acceleration_is_exact_between_samples() -> None:
    # v = 2 t: the way from 0.1 s to 0.9 s is 0.81 - 0.01 m, though no sample lies near either end.
    track = trajectory(*((t, (2 * t, 0, 0)) for t in (0.0, 0.5, 1.0, 1.5)))
    np.testing.assert_allclose(displacement(track, 0.1, 0.9), [0.8, 0, 0], atol=1e-8)


def test_extra_samples_on_the_line_change_nothing() -> None:
    coarse = trajectory((0, (1, 0, 0)), (1, (3, 0, 0)))
    fine = trajectory((0, (1, 0, 0)), (0.3, (1.6, 0, 0)), (1, (3, 0, 0)))
    np.testing.assert_allclose(displacement(coarse, 0.2, 0.7), displacement(fine, 0.2, 0.7), atol=1e-8)


def test_the_last_velocity_holds_for_a_while() -> None:
    track = trajectory((0, (2, 0, 0)), (0.25, (2, 0, 0)))
    np.testing.assert_allclose(displacement(track, 0.25, 0.25 + HOLD_S), [2 * HOLD_S, 0, 0], atol=1e-8)


def test_after_that_nothing_is_known() -> None:
    track = trajectory((0, (2, 0, 0)), (0.25, (2, 0, 0)))
    assert displacement(track, 0.25, 0.25 + HOLD_S + 0.01) is None


def test_before_the_first_velocity_nothing_is_known() -> None:
    assert displacement(trajectory((1, (2, 0, 0)), (2, (2, 0, 0))), 0.9, 1.5) is None


def test_no_displacement_crosses_a_gap() -> None:
    later = 1 + MAX_GAP_S + 0.01
    track = trajectory((0, (2, 0, 0)), (1, (2, 0, 0)), (later, (2, 0, 0)), (later + 1, (2, 0, 0)))
    assert displacement(track, 0.5, later + 0.5) is None


def test_the_longest_allowed_gap_is_crossed() -> None:
    later = 1 + MAX_GAP_S
    track = trajectory((0, (2, 0, 0)), (1, (2, 0, 0)), (later, (2, 0, 0)))
    np.testing.assert_allclose(displacement(track, 0.5, later), [2 * (later - 0.5), 0, 0], atol=1e-8)


def test_both_sides_of_a_gap_are_known_within_themselves() -> None:
    track = trajectory((0, (2, 0, 0)), (1, (2, 0, 0)), (9, (2, 0, 0)), (10, (2, 0, 0)))
    np.testing.assert_allclose(displacement(track, 9.0, 9.5), [1, 0, 0], atol=1e-8)


def test_camera_velocities_turn_with_the_attitude() -> None:
    track = Trajectory()
    for k in range(5):
        yaw = quaternion_from_rotation(rotation_from_euler(0, 0, np.pi / 2))
        track.add_attitude(EPOCH + k * S // 4, yaw)
        track.add_velocity(EPOCH + k * S // 4, (2, 0, 0), frame="camera", sigma=None)
    np.testing.assert_allclose(displacement(track, 0, 1), [0, 2, 0], atol=1e-8)
    assert not track.non_rotating


def test_velocities_seldomer_than_attitudes_are_turned_by_those_of_their_own_time() -> None:
    """A velocity at 5 Hz, attitudes at 50 Hz, frames in between: nothing that was forgotten is missed."""
    made = Trajectory()
    for k in range(500):
        stamp_ns, yaw = EPOCH + k * S // 50, k / 250
        made.add_attitude(stamp_ns, quaternion_from_rotation(rotation_from_euler(0, 0, yaw)))
        if k % 10 == 0:
            velocity = rotation_from_euler(0, 0, yaw).T @ (5.0, 0, 0)
            made.add_velocity(stamp_ns, velocity, frame="camera", sigma=None)
    for start_s in np.arange(0.05, 8.5, 0.33):
        made.forget(EPOCH + round(start_s * S))
        np.testing.assert_allclose(displacement(made, start_s, start_s + 1), [5, 0, 0], atol=1e-6)


def test_camera_velocities_without_attitude_are_taken_as_non_rotating() -> None:
    track = trajectory((0, (2, 0, 0)), (1, (2, 0, 0)), frame="camera")
    np.testing.assert_allclose(displacement(track, 0, 1), [2, 0, 0], atol=1e-8)
    assert track.non_rotating


def test_camera_velocities_of_a_full_turn_come_back() -> None:
    # A circle flown at constant camera-frame velocity, sampled at 100 Hz: the way closes.
    track = Trajectory()
    for k in range(101):
        turn = rotation_from_euler(0, 0, 2 * np.pi * k / 100)
        track.add_attitude(EPOCH + k * S // 100, quaternion_from_rotation(turn))
        track.add_velocity(EPOCH + k * S // 100, (2, 0, 0), frame="camera", sigma=None)
    np.testing.assert_allclose(displacement(track, 0, 1), [0, 0, 0], atol=1e-8)


def test_poses_are_interpolated() -> None:
    track = Trajectory()
    for k in range(3):
        pose = np.eye(4)
        pose[0, 3] = 3.0 * k
        track.add_pose(EPOCH + k * S, pose)
    np.testing.assert_allclose(displacement(track, 0.5, 1.5), [3, 0, 0], atol=1e-8)


def test_poses_tell_attitudes_too_in_whatever_precision() -> None:
    turns, track = [rotation_from_euler(0.1 * k, -0.2 * k, 0.3 * k) for k in range(4)], Trajectory()
    for k, turn in enumerate(turns):
        pose = np.eye(4, dtype=np.float32)
        pose[:3, :3], pose[0, 3] = turn, k
        track.add_pose(EPOCH + k * S, pose)
    states = track.at(EPOCH + np.arange(4) * S)
    assert track.knows_attitude and states.oriented.all()
    np.testing.assert_allclose(states.world_from_camera, turns, atol=1e-6)


def test_positions_replace_velocities_and_leave_attitudes_to_themselves() -> None:
    track = trajectory((0, (9, 9, 9)), (1, (9, 9, 9)))
    turn = quaternion_from_rotation(rotation_from_euler(0, 0, 0.5))
    for k in range(4):
        track.add_position(EPOCH + k * S, (0, 3.0 * k, 0))
        track.add_velocity(EPOCH + (k + 2) * S, (9, 9, 9), frame="world", sigma=None)
        assert not track.knows_attitude
    np.testing.assert_allclose(displacement(track, 0.5, 1.5), [0, 3, 0], atol=1e-8)
    assert not track.at(np.array([EPOCH])).oriented[0]
    for k in range(3):
        track.add_attitude(EPOCH + k * S, turn)
    states = track.at(np.array([EPOCH + S]))
    assert track.knows_attitude and states.oriented[0]
    np.testing.assert_allclose(states.world_from_camera[0], rotation_from_euler(0, 0, 0.5), atol=1e-9)
    assert not track.dropped


@pytest.mark.parametrize("position", [[1, 2], [1, 2, np.inf]])
def test_a_position_that_is_none_is_refused(position) -> None:
    with pytest.raises(BadInput, match="three finite numbers in metres"):
        Trajectory().add_position(0, position)


def posed(*seconds: float) -> Trajectory:
    """Flown north with 5 m/s, poses at these times."""
    made = Trajectory()
    for t in seconds:
        pose = np.eye(4)
        pose[0, 3] = 5 * t
        made.add_pose(EPOCH + round(t * S), pose)
    return made


@pytest.mark.parametrize("seconds", [(0, 0.5, 1, 4), (0, 0.5, 1), (1, 4), (0, 1, 4, 7)])
def test_after_the_last_pose_before_a_gap_the_speed_holds(seconds) -> None:
    track = posed(*seconds)
    track.forget(EPOCH + S)
    np.testing.assert_allclose(displacement(track, 1.0, 1.4), [2.0, 0, 0], atol=1e-6)


def test_after_the_last_pose_before_a_gap_it_is_not_the_mean_speed_over_the_gap() -> None:
    """5 m/s, and after three seconds of silence it stands where it was last seen."""
    made = placed((0, 0), (0.5, 2.5), (1, 5), (4, 5), (4.5, 5))
    np.testing.assert_allclose(displacement(made, 0.6, 1.4), [4.0, 0, 0], atol=1e-6)
    assert not made.dropped


def posed_at(*places_m: ArrayLike, every_s: float = 0.1) -> Trajectory:
    """Poses at these places: metres north, or north, east, down."""
    made = Trajectory()
    for k, place in enumerate(places_m):
        pose = np.eye(4)
        pose[:3, 3] = place if np.ndim(place) else (place, 0, 0)
        made.add_pose(EPOCH + round(k * every_s * S), pose)
    return made


def test_nothing_is_flown_over_a_jump_of_poses() -> None:
    """Found in review: a loop closure of 3 m counted as flown, for want of what velocities have."""
    track = posed_at(0.0, 0.2, 0.4, 0.6, 3.8, 4.0, 4.2, 4.4)
    np.testing.assert_allclose(displacement(track, 0.0, 0.3), [0.6, 0, 0], atol=1e-8)
    np.testing.assert_allclose(displacement(track, 0.4, 0.7), [0.6, 0, 0], atol=1e-8)
    segments = track.at(EPOCH + np.array([0.0, 0.3, 0.35, 0.4, 0.7]) * S).segment
    assert segments.tolist() == [0, 0, -1, 1, 1]
    assert track.dropped == {"way between two poses: a jump": 1}


def test_a_lone_pose_that_jumps_is_dropped() -> None:
    track = posed_at(0.0, 0.2, 0.4, 3.6, 0.8, 1.0)
    np.testing.assert_allclose(displacement(track, 0.0, 0.5), [1.0, 0, 0], atol=1e-8)
    assert track.dropped == {"pose glitch": 1}


def test_poses_that_jump_each_elsewhere_are_dropped() -> None:
    track = posed_at(0.0, 0.2, 0.4, 300.0, -300.0, 1.0, 1.2)
    np.testing.assert_allclose(displacement(track, 0.0, 0.6), [1.2, 0, 0], atol=1e-8)
    assert track.dropped == {"pose glitch": 2}


def placed(*samples: tuple[float, float]) -> Trajectory:
    """Positions: seconds, metres north."""
    made = Trajectory()
    for seconds, north_m in samples:
        made.add_position(EPOCH + round(seconds * S), (north_m, 0, 0))
    return made


def test_full_throttle_at_changing_rates_is_no_jump() -> None:
    """20 m/s^2 from rest: the speed over a step is that of its middle, so a long step tells little of a short one."""
    assert placed(*((t, 10 * t * t) for t in (0, 1, 1.1, 2.1, 2.2, 2.3, 3.3))).dropped == {}


def test_a_pose_that_jumped_waits_no_longer_than_a_gap() -> None:
    """Two seconds later nothing is known of the way from there either."""
    track = placed((0, 0), (0.1, 0.2), (0.2, 0.4), (0.3, 200.6), (2.3, 205), (2.4, 205.2))
    assert track.dropped == {"pose glitch": 1, "way between two poses: a jump": 1}
    np.testing.assert_allclose(displacement(track, 2.3, 2.4), [0.2, 0, 0], atol=1e-8)


@pytest.mark.parametrize("waiting", [[], [(0.3, 60.0)]])
def test_a_pose_that_does_not_advance_is_dropped(waiting) -> None:
    """Also one that is not after one that jumped and waits."""
    before = [(0, 0), (0.1, 0.2), (0.2, 0.4), *waiting]
    late = [(before[-1][0], 0.4), (before[-1][0] - 0.05, 0.4)]
    track = placed(*before, *late, (0.5, 1.0))
    np.testing.assert_allclose(displacement(track, 0.0, 0.5), [1.0, 0, 0], atol=1e-8)
    expected = {"pose not after the one before": 2} | ({"pose glitch": 1} if waiting else {})
    assert track.dropped == expected


def test_a_jump_after_the_first_pose_costs_no_more_than_that_pose() -> None:
    track = posed_at(0.0, 9.2, 9.4, 9.6, 9.8, 10.0)
    np.testing.assert_allclose(displacement(track, 0.2, 0.5), [0.6, 0, 0], atol=1e-8)


def test_no_flight_of_a_drone_is_taken_for_a_jump() -> None:
    """Full throttle, full brake, both at 20 m/s^2, with noise in each axis, at every rate of poses."""
    rng = np.random.default_rng(0)
    for rate_hz, noise_m in ((1, 0.04), (5, 0.04), (10, 0.04), (30, 0.04), (60, 0.04), (200, 0.04)):
        t = np.arange(0, 8, 1 / rate_hz)
        speed = np.cumsum(np.where(t % 4 < 2, 20.0, -20.0)) / rate_hz
        places = np.outer(np.cumsum(speed) / rate_hz, (0.6, 0.8, 0)) + rng.normal(0, noise_m, (len(t), 3))
        assert posed_at(*places, every_s=1 / rate_hz).dropped == {}, rate_hz


def test_a_lone_glitch_is_dropped() -> None:
    track = trajectory(
        (0, (2, 0, 0)), (0.1, (2, 0, 0)), (0.2, (90, 0, 0)), (0.3, (2, 0, 0)), (0.4, (2, 0, 0))
    )
    np.testing.assert_allclose(displacement(track, 0, 0.4), [0.8, 0, 0], atol=1e-8)
    assert track.dropped == {"velocity glitch": 1}


def test_a_step_that_stays_is_believed() -> None:
    track = trajectory((0, (0, 0, 0)), (0.1, (0, 0, 0)), (0.2, (9, 0, 0)), (0.3, (9, 0, 0)))
    np.testing.assert_allclose(displacement(track, 0, 0.3), [1.35, 0, 0], atol=1e-8)
    assert track.dropped == {}


@pytest.mark.parametrize("seconds", [0.5, 1.0])
def test_a_velocity_that_does_not_advance_is_dropped(seconds: float) -> None:
    track = trajectory((0, (2, 0, 0)), (1, (2, 0, 0)))
    track.add_velocity(EPOCH + round(seconds * S), (2.5, 0, 0), frame="world", sigma=None)
    np.testing.assert_allclose(displacement(track, 0, 1), [2, 0, 0], atol=1e-8)
    assert track.dropped == {"velocity not after the one before": 1}


def test_a_velocity_not_after_one_that_waits_is_dropped() -> None:
    track = trajectory(
        (0, (2, 0, 0)),
        (0.1, (2, 0, 0)),
        (0.2, (90, 0, 0)),
        (0.15, (2, 0, 0)),
        (0.2, (2, 0, 0)),
        (0.3, (2, 0, 0)),
    )
    np.testing.assert_allclose(displacement(track, 0, 0.3), [0.6, 0, 0], atol=1e-8)
    assert track.dropped == {"velocity glitch": 1, "velocity not after the one before": 2}


def test_a_deviation_that_jumps_is_no_glitch() -> None:
    """A fix that is lost for a moment tells 20 m/s where it told 0.1, of the same velocity."""
    track = Trajectory()
    for k, sigma in enumerate((0.1, 0.1, 20.0, 0.1)):
        track.add_velocity(EPOCH + k * S // 10, (2, 0, 0), frame="world", sigma=sigma)
    assert track.dropped == {}
    assert track.at(EPOCH + np.array([0.1, 0.2]) * S).sigma_m[1] > 1


@pytest.mark.parametrize("sigma", [-0.1, float("nan"), float("inf")])
def test_a_deviation_that_is_none_is_refused(sigma: float) -> None:
    with pytest.raises(BadInput, match="velocity sigma: expected 0 or more m/s, got"):
        Trajectory().add_velocity(0, (1, 0, 0), frame="world", sigma=sigma)


@pytest.mark.parametrize("velocity", [(1, 2), (1, 2, float("nan")), (1, 2, float("inf"))])
def test_a_velocity_that_is_none_is_refused(velocity) -> None:
    with pytest.raises(BadInput, match="velocity: expected three finite numbers in m/s, got"):
        Trajectory().add_velocity(0, velocity, frame="world", sigma=None)


@pytest.mark.parametrize("speed_m_s", [3, 300])
@pytest.mark.parametrize("posed", [False, True])
def test_a_velocity_s_time_is_looked_at_whether_it_counts_or_not(speed_m_s, posed) -> None:
    track = Trajectory()
    if posed:
        track.add_pose(0, np.eye(4))
    with pytest.raises(BadInput, match="whole nanoseconds"):
        track.add_velocity(1.5, (speed_m_s, 0, 0), frame="world", sigma=None)


@pytest.mark.parametrize("frame", ["body", "NED"])
def test_an_unknown_frame_is_refused(frame: str) -> None:
    with pytest.raises(BadInput, match="velocity frame: expected world or camera"):
        Trajectory().add_velocity(0, (1, 0, 0), frame=frame, sigma=None)


def test_frames_are_not_mixed() -> None:
    track = trajectory((0, (2, 0, 0)))
    with pytest.raises(BadInput, match="expected world, as before, got camera"):
        track.add_velocity(EPOCH + S, (2, 0, 0), frame="camera", sigma=None)


@pytest.mark.parametrize(
    "pose",
    [
        *(np.eye(3), 2 * np.eye(4), np.diag([1.0, 1, -1, 1]), np.full((4, 4), np.nan)),
        np.vstack([np.eye(4)[:3], [1, 2, 3, 1]]),  # as who multiplies rows writes it
    ],
)
def test_a_pose_that_is_not_rigid_is_refused(pose) -> None:
    with pytest.raises(BadInput, match="pose: expected a rigid 4x4 matrix"):
        Trajectory().add_pose(0, pose)


def test_poses_and_positions_are_not_mixed() -> None:
    """A position tells no attitude: it was taken for one, of NaN, and every frame turned away from all others."""
    for first, second in (
        (Trajectory.add_pose, Trajectory.add_position),
        (Trajectory.add_position, Trajectory.add_pose),
    ):
        track, given = Trajectory(), {Trajectory.add_pose: np.eye(4), Trajectory.add_position: np.zeros(3)}
        for k in range(3):
            first(track, k * S, given[first])
        with pytest.raises(BadInput, match="poses throughout, or positions throughout"):
            second(track, 3 * S, given[second])


def test_samples_beyond_what_is_kept_are_counted() -> None:
    track = Trajectory()
    for k in range(MOST_ROWS + 5):
        track.add_attitude(k * 1000, [1.0, 0.0, 0.0, 0.0])
    assert track.dropped == {"attitude followed by more than are kept": 5}


def test_velocities_that_come_seldom_leave_their_change_open():
    """By hand: from 1 to 4 m/s a tenth of 3 m/s; a sample has the larger of what lies before and behind it."""
    stamps_ns = np.array([0, 1, 2, 3, 3.1], dtype=float) * 1e9
    velocity = np.array([[1.0, 0, 0], [4.0, 0, 0], [4.0, 0, 1.0], [4.0, 0, 1.0], [9.0, 0, 1.0]])
    found = left_open(stamps_ns.astype(np.int64), velocity)
    assert found == pytest.approx([0.3, 0.3, 0.1, 0.0, 0.0])  # the last two are a tenth of a second apart


@pytest.mark.parametrize(("rate_hz", "opens"), [(1, True), (5, False)])
def test_a_position_is_as_sure_as_its_seldom_velocities(rate_hz, opens):
    track = Trajectory()
    for k in range(4 * rate_hz + 1):
        track.add_velocity(k * 10**9 // rate_hz, (k / rate_hz, 0.0, 0.0), frame="world", sigma=None)
    for _ in range(2):  # asking changes nothing
        sigma_m = track.at(np.array([10**9, 3 * 10**9])).sigma_m
        assert np.diff(sigma_m) == pytest.approx([0.2 if opens else 0.0])


def test_one_velocity_leaves_nothing_open():
    assert left_open(np.zeros(1, np.int64), np.ones((1, 3))).tolist() == [0.0]


@pytest.mark.parametrize("told_by", ["attitudes", "poses"])
def test_how_a_camera_turns_on_past_the_last_sample_does_not_hang_on_how_far_back_is_asked(told_by) -> None:
    """At 50 degrees/s, told 50 times a second: live, the newest picture is later than the newest sample."""
    track = Trajectory()
    for stamp_ns in range(0, 2 * S + 1, S // 50):
        turn = rotation_from_euler(0, 0, np.radians(50) * stamp_ns / S)
        if told_by == "poses":
            track.add_pose(EPOCH + stamp_ns, np.block([[turn, np.zeros((3, 1))], [np.zeros((1, 3)), 1]]))
        else:
            track.add_attitude(EPOCH + stamp_ns, quaternion_from_rotation(turn))
    now = EPOCH + 2 * S + 30_000_000
    near, far = (track.at(np.array([now - back, now])).world_from_camera[1] for back in (33_000_000, S))
    np.testing.assert_allclose(near, far, atol=1e-9)
    np.testing.assert_allclose(near, rotation_from_euler(0, 0, np.radians(50) * 2.03), atol=1e-6)
