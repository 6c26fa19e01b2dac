from collections import Counter

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightdepth.flight.autopilot import (
    HEADING_AGE_NS,
    BodyAttitude,
    Record,
    Velocity,
    autopilot_telemetry,
)
from flightdepth.flight.gimbal import GimbalAttitude, GimbalFlags
from flightdepth.flight.power_ups import REBOOT_GAP_NS, STEP_NS, boots, longest_boot, placed_boots
from flightdepth.flight.records import NS_PER_S
from flightdepth.motion import (
    is_rotation,
    quaternion_from_euler,
    rotation_from_euler,
    rotation_from_quaternion,
)

STAMPS = st.lists(st.integers(0, 100 * STEP_NS), max_size=60)


def split(*stamps):
    counts = Counter()
    return [boot.tolist() for boot in boots(np.array(stamps, dtype=np.int64), counts)], dict(counts)


def test_a_steady_log_is_one_power_up():
    assert split(*range(0, 10**9, 10**8)) == ([list(range(10))], {})


def test_a_pause_does_not_start_another():
    assert split(0, 1, 2, 10 * STEP_NS, 10 * STEP_NS + 1, 10 * STEP_NS + 2) == ([[0, 1, 2, 3, 4, 5]], {})


def test_a_time_that_starts_again_does():
    late = 50 * STEP_NS
    assert split(late, late + 1, late + 2, 0, 1, 2) == ([[0, 1, 2], [3, 4, 5]], {})


@pytest.mark.parametrize("damaged", [90 * STEP_NS, 0])
def test_a_lone_time_far_away_is_damage(damaged):
    at = 50 * STEP_NS
    expected = [[0, 1, 2, 4, 5, 6]], {"records with a damaged time": 1}
    assert split(at, at + 1, at + 2, damaged, at + 3, at + 4, at + 5) == expected


def test_few_records_are_not_damage_where_there_are_no_more():
    assert split(5) == ([[0]], {})
    assert split() == ([], {})


@given(STAMPS)
def test_every_record_is_in_one_power_up_or_counted(stamps):
    found, counts = split(*stamps)
    indices = [index for boot in found for index in boot]
    assert indices == sorted(set(indices))
    assert len(indices) + counts.get("records with a damaged time", 0) == len(stamps)


@given(STAMPS, st.lists(st.integers(0, 10**15), min_size=60, max_size=60))
def test_placed_power_ups_never_overlap(stamps, received):
    records = [Record(stamp, Velocity((0, 0, 0)), at) for stamp, at in zip(stamps, received, strict=False)]
    counts = Counter()
    placed = placed_boots(records, counts)
    groups = boots(np.array(stamps, dtype=np.int64), Counter(), np.array(received[: len(stamps)]))
    end = 0
    newest = None
    for group in groups:
        part = [record.stamp_ns for record in placed[end : end + len(group)]]
        assert newest is None or min(part) >= newest + REBOOT_GAP_NS
        newest, end = max(part), end + len(group)
    assert counts["reboots inside the log"] == max(len(groups) - 1, 0)


def test_the_longest_power_up_is_kept():
    late = 50 * STEP_NS
    records = [Record(stamp, Velocity((0, 0, 0))) for stamp in (late, late + 1, late + 2, 0, 1, 2, 3)]
    counts = Counter()
    assert longest_boot(records, counts) == records[3:]
    assert counts == {"records of other power-ups of the autopilot": 3}


def test_late_records_are_put_in_order_and_doubles_counted():
    records = [Record(stamp, Velocity((stamp, 0, 0))) for stamp in (10, 30, 20, 20, 40)]
    telemetry = autopilot_telemetry("log", records, counts := Counter(), told_by=[])
    assert [(s.stamp_ns, s.velocity[0]) for s in telemetry.samples] == [(0, 10), (10, 20), (20, 30), (30, 40)]
    assert +counts == {"velocities not later than the one before": 1}


def test_a_deviation_that_is_none_is_left_out():
    records = [Record(i, Velocity((0, 0, 0), sigma)) for i, sigma in enumerate((-1.0, float("nan"), 0.5))]
    assert [s.sigma for s in autopilot_telemetry("log", records, Counter(), told_by=[]).samples] == [
        None,
        None,
        0.5,
    ]


@pytest.mark.parametrize("bad", [(0, 0, 0, 0), (float("nan"), 0, 0, 0), (2, 0, 0, 0), (0, 1e30, 0, 1)])
def test_attitudes_that_are_no_rotation_are_counted(bad):
    assert not is_rotation(bad)
    records = [Record(0, Velocity((0, 0, 0))), Record(1, BodyAttitude(bad))]
    telemetry = autopilot_telemetry("log", records, Counter(), told_by=[])
    assert telemetry.body_attitudes == ()
    assert telemetry.counts == {"attitudes that are no rotation": 1}


ANGLE = st.floats(-2 * np.pi, 2 * np.pi)


@given(ANGLE, ANGLE, ANGLE)
def test_the_quaternion_of_angles_is_their_rotation(roll_rad, pitch_rad, yaw_rad):
    quaternion = quaternion_from_euler(roll_rad, pitch_rad, yaw_rad)
    assert quaternion[0] >= 0
    expected = rotation_from_euler(roll_rad, pitch_rad, yaw_rad)
    np.testing.assert_allclose(rotation_from_quaternion(quaternion), expected, atol=1e-12)
    about_x, about_y, about_z = (
        cv2.Rodrigues(axis * angle)[0]
        for axis, angle in zip(np.eye(3), (roll_rad, pitch_rad, yaw_rad), strict=True)
    )
    np.testing.assert_allclose(expected, about_z @ about_y @ about_x, atol=1e-12)


def heading(degrees):
    """Quaternion of a level body that heads there."""
    return np.cos(np.radians(degrees) / 2), 0.0, 0.0, np.sin(np.radians(degrees) / 2)


def seen_by_a_gimbal(at_s, turn_deg_s=40.0, start_deg=160.0):
    """Headings, degrees, of a camera that looks ahead of a body that turns, whose attitude comes at 4 Hz."""
    ahead = GimbalAttitude((1.0, 0.0, 0.0, 0.0), GimbalFlags.YAW_IN_VEHICLE_FRAME)
    records = [Record(0, Velocity((0, 0, 0)))]
    for k in range(9):
        records.append(Record(k * NS_PER_S // 4, BodyAttitude(heading(start_deg + turn_deg_s * k / 4))))
    records += [Record(round(at * NS_PER_S), ahead) for at in at_s]
    telemetry = autopilot_telemetry("log", records, counts := Counter(), told_by=[])
    looks = [rotation_from_quaternion(camera.world_from_camera)[:, 2] for camera in telemetry.attitudes]
    return [float(np.degrees(np.arctan2(east, north))) % 360 for north, east, _ in looks], counts


def test_a_gimbals_heading_is_that_of_its_own_time():
    """It was that of the last attitude before, here up to a quarter of a second and 10 degrees old."""
    at_s = np.arange(1, 40) * 0.05
    found, _ = seen_by_a_gimbal(at_s)
    np.testing.assert_allclose(found, 160 + 40 * at_s, atol=0.01)  # through 180, where yaw starts again


def test_past_the_last_attitude_its_heading_holds_for_a_while():
    found, counts = seen_by_a_gimbal([2.3, 2.0 + HEADING_AGE_NS / NS_PER_S + 0.1])
    assert found == pytest.approx([240.0])
    assert +counts == {"gimbal attitudes without a heading": 1}
