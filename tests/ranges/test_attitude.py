from collections.abc import Iterable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightdepth.flight.records import HOLD_S, MAX_GAP_S
from flightdepth.motion import (
    mixed_quaternions,
    quaternion_from_rotation,
    quaternion_products,
    rotation_angle_rad,
    rotation_from_euler,
    rotation_from_quaternion,
    rotations_from_quaternions,
    unit_quaternion,
)
from flightdepth.ranges.attitude import orientations

S = 1_000_000_000


def slerp(start, end, fraction):
    """Quaternion on the shorter great arc from `start` (0) to `end` (1)."""
    a, b = unit_quaternion(start), unit_quaternion(end)
    cosine = float(a @ b)
    if cosine < 0:
        b, cosine = -b, -cosine
    if cosine > 0.9995:
        return unit_quaternion(a + fraction * (b - a))
    angle = np.arccos(cosine)
    mixed = np.sin((1 - fraction) * angle) * a + np.sin(fraction * angle) * b
    return mixed / np.sin(angle)


def test_products_of_quaternions_are_those_of_their_rotations() -> None:
    first, *second = np.random.default_rng(0).normal(size=(6, 4))
    first, second = first / np.linalg.norm(first), second / np.linalg.norm(second, axis=1, keepdims=True)
    expected = rotation_from_quaternion(first) @ rotations_from_quaternions(second)
    found = rotations_from_quaternions(quaternion_products(first, second))
    np.testing.assert_allclose(found, expected, atol=1e-12)


@given(st.floats(0, 1), st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.sampled_from([1, -1]))
def test_between_samples_it_is_close_to_slerp(share, pitch, yaw, sign) -> None:
    ends = [quaternion_from_rotation(rotation_from_euler(0, k * pitch, k * yaw)) for k in (0, 1)]
    found, known = orientations(
        np.array([0, S]), np.array([ends[0], sign * ends[1]]), np.array([round(share * S)])
    )
    truth = rotation_from_quaternion(slerp(*ends, share))
    assert known[0]
    assert rotation_angle_rad(found[0].T @ truth) < 1e-4


@given(st.floats(-3, 3), st.sampled_from([1, -1]))
def test_halfway_is_half_of_the_turn_however_far_it_is(yaw, sign) -> None:
    start, end, half = (quaternion_from_rotation(rotation_from_euler(0, 0.2, k * yaw)) for k in (0, 1, 0.5))
    np.testing.assert_allclose(mixed_quaternions(start, sign * end, 0.5), half, atol=1e-9)


def test_without_samples_nothing_is_known() -> None:
    found, known = orientations(np.empty(0, dtype=np.int64), np.empty((0, 4)), np.array([0, 1]))
    assert not known.any()
    np.testing.assert_array_equal(found, [np.eye(3)] * 2)


def test_past_the_last_sample_it_turns_on_for_a_while() -> None:
    def heading(rad_s: float, stamps_s: Iterable[float], at_s: float) -> float:
        """Radians at a time, of a camera that turned right at an even rate and was told to at these times."""
        turned = [quaternion_from_rotation(rotation_from_euler(0, 0.3, rad_s * each)) for each in stamps_s]
        stamps_ns = np.array([round(each * S) for each in stamps_s])
        found, known = orientations(stamps_ns, np.array(turned), np.array([round(at_s * S)]))
        assert known[0]
        level = rotation_from_euler(0, 0.3, 0.0)
        turn = found[0] @ level.T
        return float(np.arctan2(turn[1, 0], turn[0, 0]))

    told_s = np.arange(21) / 20
    times_s = {1.0: 0.9, 1.05: 0.945, 1.14: 1.026, 1.15: 1.035, 1.3: 1.035, 0.77: 0.693}
    assert {at_s: heading(0.9, told_s, at_s) for at_s in times_s} == pytest.approx(times_s, abs=1e-6)
    assert heading(0.9, [0.0, 0.5, 1.0], 1.1) == pytest.approx(0.9)  # too seldom to tell
    assert heading(0.9, [0.98, 1.0], 1.1) == pytest.approx(0.9)  # over too short a time
    assert heading(0.07, told_s, 1.1) == pytest.approx(0.07)  # noise
    assert heading(5.0, told_s[:4], 0.2) == pytest.approx(0.75)  # a jump


def test_known_times_are_those_near_samples() -> None:
    stamps = np.array([0, S, round(S * (1 + MAX_GAP_S + 1))])
    at = np.array([-1, S // 2, S + round(HOLD_S * S), S + round(HOLD_S * S) + 1000, stamps[-1]])
    known = orientations(stamps, np.tile([1.0, 0, 0, 0], (3, 1)), at)[1]
    np.testing.assert_array_equal(known, [False, True, True, False, True])
