from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightdepth.motion import quaternion_from_rotation, rotation_from_euler, unit_quaternion
from flightdepth.ranges.displacement import Trajectory
from flightdepth.ranges.pairs import MAX_FRAMES, Baselines, Frame, FrameBuffer, baselines, pick, seen_from

S = 1_000_000_000
STEP = S // 30
IMAGE = np.zeros((64, 64, 3), dtype=np.uint8)


def frames(count: int) -> list[Frame]:
    return [Frame(k, k * STEP, IMAGE) for k in range(count)]


def straight(speed: float, count: int) -> Trajectory:
    track = Trajectory()
    for k in range(count + 1):
        track.add_velocity(k * STEP, (speed, 0, 0), frame="world", sigma=None)
    return track


def picked(wanted: list[float], *, speed: float = 3.0, count: int = 60):
    lines = baselines(straight(speed, count), frames(count), count * STEP, 0.3)
    return pick(lines, np.array(wanted), np.array(wanted) * 48)


@given(st.floats(0.06, 6.2))
def test_the_closest_displacement_is_taken(wanted: float) -> None:
    (pair,) = picked([wanted])
    assert abs(pair.length_m - wanted) <= 0.05 + 1e-9 or pair.previous.index in (0, 59)
    np.testing.assert_allclose(pair.length_m, 0.1 * (60 - pair.previous.index), rtol=1e-6)


@given(st.lists(st.floats(0.06, 20), min_size=1, max_size=4))
def test_no_frame_is_taken_twice(wanted: list[float]) -> None:
    taken = [pair.previous.index for pair in picked(wanted)]
    assert taken == sorted(set(taken), reverse=True)


@given(st.permutations([0.3, 1.0, 3.0]))
def test_the_order_of_the_wishes_is_of_no_account(wanted: list[float]) -> None:
    assert [(p.length_m, p.depth_m) for p in picked(wanted)] == [
        (p.length_m, p.depth_m) for p in picked([0.3, 1, 3])
    ]


def test_a_length_is_as_sure_as_the_velocities_on_its_way() -> None:
    """Errors of one log go together for a while, so deviations add up: 0.1 m/s for a second, 0.3 for the next."""
    track = Trajectory()
    for k in range(61):
        track.add_velocity(k * STEP, (3.0, 0, 0), frame="world", sigma=0.1 if k < 30 else 0.3)
    lines = baselines(track, frames(60), 60 * STEP, 0.3)
    assert lines.length_sigma_m[[0, 30, 45]] == pytest.approx([0.4, 0.3, 0.15], abs=0.005)
    (pair,) = pick(lines, np.array([6.0]), np.array([48.0]))
    assert pair.length_sigma_m == lines.length_sigma_m[0]


def test_lengths_of_a_log_without_deviations_or_of_positions_have_none() -> None:
    track = Trajectory()
    for k in range(61):
        track.add_position(k * STEP, (0.1 * k, 0.0, 0.0))
    for told in (track, straight(3.0, 60)):
        assert not baselines(told, frames(60), 60 * STEP, 0.3).length_sigma_m.any()


@given(st.lists(st.sampled_from([0.1, 1.2]), min_size=61, max_size=61))
def test_each_velocity_speaks_of_its_own_time(sigmas: list[float]) -> None:
    """3 m/s stand out of 0.1 m/s, and not of 1.2: over a time of both it is their mean that counts."""
    track = Trajectory()
    for k, sigma in enumerate(sigmas):
        track.add_velocity(k * STEP, (3.0, 0, 0), frame="world", sigma=sigma)
    lines = baselines(track, frames(60), 60 * STEP, 0.3)
    means = [np.trapezoid(sigmas[k:]) / (60 - k) for k in range(60)]
    expected = [mean < 1 and 0.1 * (60 - k) >= 0.05 for k, mean in enumerate(means)]
    assert lines.usable.tolist() == expected


def test_more_than_there_is_gives_the_longest() -> None:
    assert picked([1e9])[0].previous.index == 0


def test_equal_frames_keep_the_first_depth() -> None:
    (pair,) = picked([0.31, 0.29])
    assert pair.previous.index == 57
    np.testing.assert_allclose(pair.depth_m, 0.31 * 48)


def test_of_two_equally_close_the_younger_is_taken() -> None:
    # Out and back: at the turning point's mirror frames the displacement is the same.
    track = Trajectory()
    for k in range(61):
        track.add_velocity(k * STEP, (3.0 if k < 30 else -3.0, 0, 0), frame="world", sigma=None)
    lines = baselines(track, frames(60), 60 * STEP, 0.3)
    (pair,) = pick(lines, np.array([1.0]), np.array([48.0]))
    assert pair.previous.index > 30


def test_a_slow_flight_is_one_where_positions_tell_it() -> None:
    """Summed velocities may err by 0.1 m/s."""
    by_positions, by_velocities = Trajectory(), straight(0.05, 60)
    for k in range(61):
        by_positions.add_position(k * STEP, (0.05 * k * STEP / S, 0, 0))
    usable = baselines(by_positions, frames(60), 60 * STEP, 0.3).usable
    assert usable.tolist() == [0.05 * (60 - k) * STEP / S >= 0.05 for k in range(60)]
    assert not baselines(by_velocities, frames(60), 60 * STEP, 0.3).usable.any()


def test_the_displacement_points_from_previous_to_current() -> None:
    (pair,) = picked([0.3])
    np.testing.assert_allclose(pair.displacement_m, [0.3, 0, 0], atol=1e-8)


def test_the_buffer_drops_what_is_old() -> None:
    buffer = FrameBuffer(1.0)
    for frame in frames(90):
        buffer.expire(frame.stamp_ns - S)
        buffer.add(frame)
    assert buffer.frames[0].stamp_ns >= 88 * STEP - S
    assert buffer.frames[-1].index == 89


def test_the_buffer_of_a_fast_camera_still_spans_its_time() -> None:
    buffer = FrameBuffer(4.0)
    for k in range(4000):
        buffer.expire(k * S // 500 - 4 * S)
        buffer.add(Frame(k, k * S // 500, IMAGE))
    assert len(buffer.frames) <= MAX_FRAMES
    assert buffer.frames[-1].stamp_ns - buffer.frames[0].stamp_ns > 3.9 * S


def test_the_buffer_packs_pictures_that_are_not_bytes() -> None:
    image = np.full((64, 64, 3), 100.25, np.float32)
    buffer = FrameBuffer(1.0)
    buffer.add(Frame(0, 0, image))
    (kept,) = buffer.frames
    assert kept.packed.nbytes == image.nbytes // 2
    np.testing.assert_allclose(kept.image, image, atol=1 / 500)


def lines_of(displacements):
    moved = np.array(displacements, dtype=float)
    count = len(moved)
    return Baselines(
        frames=frames(count),
        displacement_m=moved,
        length_m=np.linalg.norm(moved, axis=1),
        length_sigma_m=np.zeros(count),
        current_from_previous=np.repeat(np.eye(3)[None], count, axis=0),
        turn_rad=np.zeros(count),
        directed=np.zeros(count, dtype=bool),
        usable=np.ones(count, dtype=bool),
        reason=None,
    )


def test_a_direction_is_looked_for_over_a_longer_baseline() -> None:
    """Straight flight, 0.1 m a frame: pairs of 0.2 and 0.4 m are served by the frame 0.6 m away, or by 0.4 m."""
    lines = lines_of([[0.1 * (20 - index), 0, 0] for index in range(20)])
    pairs = pick(lines, np.array([0.2, 0.4]), np.array([1.0, 2.0]))
    ((looked_at, served),) = seen_from(lines, pairs)
    assert [20 - pair.previous.index for pair in looked_at] == [6, 4]
    assert [20 - pair.previous.index for pair in served] == [2, 4]


def test_frames_from_before_a_bend_tell_no_direction() -> None:
    """Ten frames to the east, then five to the north: the pair of 0.2 m looks back no farther than the bend."""
    path = [[0.1 * k, 0, 0] for k in range(10)] + [[0.9, 0.1 * k, 0] for k in range(1, 6)]
    here = np.array([0.9, 0.6, 0])
    lines = lines_of([here - np.array(place) for place in path])
    pairs = pick(lines, np.array([0.2, 1.0]), np.array([1.0, 2.0]))
    groups = seen_from(lines, pairs)
    assert len(groups) == 2
    for looked_at, served in groups:
        after_the_bend = max(pair.length_m for pair in served) < 0.3
        assert all((pair.previous.index >= 9) == after_the_bend for pair in looked_at)


def test_a_camera_that_keeps_its_attitude_does_not_turn_by_rounding() -> None:
    """The trace of R^T R is a little more than 3 for half of all R, and has no angle then."""
    for quaternion in np.random.default_rng(0).normal(size=(20, 4)):
        track = straight(3.0, 3)
        for k in range(4):
            track.add_attitude(k * STEP, unit_quaternion(quaternion))
        lines = baselines(track, frames(3), 3 * STEP, 0.3)
        np.testing.assert_allclose(lines.turn_rad, 0, atol=1e-7)
        assert lines.usable.all() and lines.directed.all()


def test_a_displacement_is_told_in_the_axes_of_the_current_camera() -> None:
    """3 m/s north; the camera turns by 0.02 rad a frame, about two axes."""
    track, attitudes = straight(3.0, 3), [rotation_from_euler(0, 0.01 * k, 0.02 * k) for k in range(4)]
    for k, attitude in enumerate(attitudes):
        track.add_attitude(k * STEP, quaternion_from_rotation(attitude))
    lines = baselines(track, frames(3), 3 * STEP, 0.3)
    for k in range(3):
        np.testing.assert_allclose(lines.displacement_m[k], attitudes[3].T @ [0.1 * (3 - k), 0, 0], atol=1e-6)
        np.testing.assert_allclose(lines.current_from_previous[k], attitudes[3].T @ attitudes[k], atol=1e-9)


def test_an_attitude_that_is_known_at_one_end_alone_tells_no_turn() -> None:
    track = straight(3.0, 3)
    for k in (2, 3):  # before the first one none is known
        track.add_attitude(k * STEP, quaternion_from_rotation(rotation_from_euler(0, 0, 0.2)))
    lines = baselines(track, frames(3), 3 * STEP, 0.3)
    assert lines.directed.tolist() == [False, False, True]
    np.testing.assert_allclose(lines.turn_rad, 0, atol=1e-7)
    np.testing.assert_allclose(lines.displacement_m[0], [0.3, 0, 0], atol=1e-6)


def test_a_direction_is_looked_for_where_the_flight_was_straight_and_a_depth_may_come_from() -> None:
    """0.3 m are wanted for a pair of 0.1 m; the frame as far away lies round a bend, or is not usable."""
    bent = lines_of([[0.3, 0, 0], [0, 0.2, 0], [0, 0.1, 0]])
    straight_on = replace(
        lines_of([[0, 0.3, 0], [0, 0.2, 0], [0, 0.1, 0]]), usable=np.array([False, True, True])
    )
    for lines in (bent, straight_on):
        ((looked_at, _),) = seen_from(lines, pick(lines, np.array([0.1]), np.array([1.0])))
        assert looked_at[0].previous.index == 1


def test_a_few_centimetres_are_no_baseline_however_fast() -> None:
    """1.2 m/s, 4 cm a frame: one frame is less than a stabiliser leaves."""
    assert baselines(straight(1.2, 3), frames(3), 3 * STEP, 0.3).usable.tolist() == [True, True, False]
