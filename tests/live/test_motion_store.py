"""What a store of motion tells of one time: by laws, and by numbers that a constant speed or turn makes."""

import math

import numpy as np
import pytest

from flightdepth.flight.records import AttitudeSample, BodyAttitudeSample, PositionSample, VelocitySample
from flightdepth.live.motion_store import HEIGHT_AGE_NS, KEPT_NS, MotionStore
from flightdepth.motion import NED_FROM_CAMERA, quaternion_from_rotation, rotation_from_quaternion

MS, S = 10**6, 10**9


def yawed(angle_rad):
    return np.array([math.cos(angle_rad / 2), 0, 0, math.sin(angle_rad / 2)])


def turning(store, *, rate_rad_s=0.4, sample=AttitudeSample):
    for k in range(11):
        store.add(sample(S + k * 100 * MS, yawed(rate_rad_s * k / 10)), 0)


def test_between_two_velocities_a_share_of_both_is_true():
    store = MotionStore()
    store.add(VelocitySample(S, [1.0, 0, 4]), 0)
    store.add(VelocitySample(2 * S, [3.0, 0, 0]), 0)
    found = store.at(1_250_000_000)
    assert found.velocity_ned.tolist() == [1.5, 0, 3]
    assert found.velocity_told_ns == S
    assert store.at(S - 1).velocity_ned is None


def test_a_velocity_in_the_cameras_axes_goes_to_the_estimator_alone():
    store, sample = MotionStore(), VelocitySample(S, [1.0, 0, 4], "camera")
    store.add(sample, 7 * S)
    assert store.at(S).velocity_ned is None
    assert store.take_new() == [sample]
    assert store.take_new() == []
    assert store.age_ms(7 * S + 250 * MS) == 250


def test_before_the_first_velocity_there_is_no_age():
    store = MotionStore()
    turning(store)
    store.take_new()
    position = PositionSample(S, np.zeros(3))
    store.add(position, S)
    assert store.take_new() == [position]
    assert store.age_ms(S) is None
    assert store.rate_hz(S) == 0


def test_a_camera_that_turns_evenly_turned_by_rate_times_time():
    store = MotionStore()
    assert store.turn_rad(2 * S, 100 * MS) is None
    turning(store)
    assert store.turn_rad(2 * S, 300 * MS) == pytest.approx(0.12)
    assert store.turn_rad(1_750_000_000, 100 * MS) == pytest.approx(0.04)
    assert store.turn_rad(S + 50 * MS, 100 * MS) is None  # a part of it nobody knows
    np.testing.assert_allclose(store.at(1_750_000_000).world_from_camera, yawed(0.3), atol=1e-9)


def test_attitudes_after_a_time_are_later_than_it():
    store = MotionStore()
    assert len(store.cameras_after(0)[0]) == 0
    turning(store)
    for after_ns, count in ((0, 11), (S, 10), (1_850_000_000, 2), (2 * S, 0), (3 * S, 0)):
        stamps, rows = store.cameras_after(after_ns)
        assert stamps.tolist() == [2 * S - k * 100 * MS for k in reversed(range(count))]
        np.testing.assert_allclose(rows, [yawed(0.4 * (each - S) / S) for each in stamps.tolist()] or rows)


def test_of_a_screwed_camera_the_body_tells_the_attitude_once_it_is_heard():
    store, gimbal = MotionStore(NED_FROM_CAMERA), quaternion_from_rotation(NED_FROM_CAMERA)
    store.add(AttitudeSample(S, gimbal), 0)
    store.add(BodyAttitudeSample(S + 10 * MS, yawed(math.pi / 2)), 0)
    store.add(AttitudeSample(S + 20 * MS, gimbal), 0)
    assert [sample.stamp_ns for sample in store.take_new()] == [S, S + 10 * MS]
    found = store.at(S + 10 * MS)
    np.testing.assert_allclose(rotation_from_quaternion(found.world_from_camera)[:, 2], [0, 1, 0], atol=1e-9)
    np.testing.assert_allclose(found.world_from_body, yawed(math.pi / 2), atol=1e-9)


def test_a_body_tells_nothing_of_a_camera_that_is_not_screwed_to_it():
    store = MotionStore()
    turning(store, sample=BodyAttitudeSample)
    assert store.take_new() == []
    assert store.at(2 * S).world_from_camera is None
    turning(store)
    assert len(store.take_new()) == 11


@pytest.mark.parametrize("early", [-1, 1])
def test_a_height_is_true_for_a_second(early):
    store = MotionStore()
    assert store.at(S).height_above_ground_m is None
    store.add_height(5 * S, 12.5)
    assert store.at(5 * S + early * HEIGHT_AGE_NS).height_above_ground_m == 12.5
    assert store.at(5 * S + early * (HEIGHT_AGE_NS + 1)).height_above_ground_m is None


def test_what_is_older_than_four_seconds_is_forgotten():
    store = MotionStore()
    for k in range(100):
        store.add(VelocitySample(k * 100 * MS, [k, 0, 0]), 0)
    newest_ns = 9_900 * MS
    assert store.at(newest_ns - KEPT_NS + 150 * MS).velocity_ned[0] == pytest.approx(60.5)
    assert store.at(newest_ns - KEPT_NS - 150 * MS).velocity_ned is None


@pytest.mark.parametrize("sample", [VelocitySample, AttitudeSample, BodyAttitudeSample])
def test_four_seconds_are_kept_of_each_and_no_more(sample):
    """Hours of flight would fill the memory."""
    store = MotionStore()
    for k in range(100):
        store.add(sample(k * 100 * MS, [1.0, 0, 0, 0][: 3 if sample is VelocitySample else 4]), 0)
    kept = {
        VelocitySample: store._velocities,
        AttitudeSample: store._cameras,
        BodyAttitudeSample: store._bodies,
    }
    assert 40 <= len(kept[sample]) <= 42


def test_a_height_of_a_second_ago_is_true_and_an_older_one_is_not():
    store = MotionStore()
    store.add_height(5 * S, 12.5)
    assert store.at(5 * S + 1000 * MS).height_above_ground_m == 12.5
    assert store.at(5 * S + 1001 * MS).height_above_ground_m is None


def test_rates_and_ages_are_those_of_reception():
    """A log's stamps may lie anywhere."""
    store = MotionStore()
    for k in range(21):
        store.add(VelocitySample(S + k * MS, [1.0, 0, 0]), 50 * S + k * 50 * MS)
    assert store.rate_hz(51 * S) == pytest.approx(20)
    assert store.age_ms(51 * S + 70 * MS) == 70


def test_between_two_attitudes_of_a_body_a_share_of_both_is_true():
    store = MotionStore()
    turning(store, sample=BodyAttitudeSample)
    np.testing.assert_allclose(store.at(1_750_000_000).world_from_body, yawed(0.3), atol=1e-9)
