import math

import numpy as np
import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import common as mavlink

from flightdepth.errors import BadInput
from flightdepth.flight.telemetry import read_telemetry
from flightdepth.motion import rotation_from_quaternion
from tests_logs import (
    AUTOPILOT,
    GROUND,
    RECEIVED_US,
    heartbeat,
    ned_message,
    quaternion,
    quaternion_message,
    tlog_flight,
    tlog_part,
    velocity,
    written,
)

NAN_21 = [math.nan] * 21
HOUR_US = 3600 * 10**6


def read(tmp_path, *parts):
    return read_telemetry(written(tmp_path / "flight.log", b"".join(parts)))


def velocities(telemetry):
    return [tuple(sample.velocity) for sample in telemetry.velocities]


def forward(sample):
    return rotation_from_quaternion(sample.world_from_camera)[:, 2]


def test_what_was_written_is_read(tmp_path):
    telemetry = read(tmp_path, tlog_flight(30))
    assert velocities(telemetry) == [velocity(i) for i in range(30)]
    assert [s.stamp_ns for s in telemetry.samples] == [i * 100_000_000 for i in range(30)]
    for i, body in enumerate(telemetry.body_attitudes):
        np.testing.assert_allclose(body.world_from_body, quaternion(i), atol=1e-7)
    assert len(telemetry.body_attitudes) == 30
    assert telemetry.counts == {}
    assert "LOCAL_POSITION_NED of vehicle 1" in telemetry.name


def test_pymavlink_reads_the_same(tmp_path):
    path = written(tmp_path / "flight.tlog", tlog_flight(30))
    log, theirs = mavutil.mavlink_connection(str(path)), []
    while (message := log.recv_match(type="LOCAL_POSITION_NED")) is not None:
        theirs.append((message.vx, message.vy, message.vz))
    log.close()
    assert velocities(read_telemetry(path)) == theirs


def test_mavlink_1_is_read_too(tmp_path):
    parts = [tlog_part(RECEIVED_US + i, ned_message(i, velocity(i)), mavlink_1=bool(i % 2)) for i in range(8)]
    assert velocities(read(tmp_path, *parts)) == [velocity(i) for i in range(8)]


def test_signed_messages_are_read(tmp_path):
    writer = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    writer.signing.secret_key, writer.signing.sign_outgoing = b"k" * 32, True
    parts = []
    for i in range(5):
        packed = ned_message(i, velocity(i)).pack(writer)
        parts.append((RECEIVED_US + i).to_bytes(8, "big") + packed)
    assert parts[0][8 + 2] == 1  # signed
    assert velocities(read(tmp_path, *parts)) == [velocity(i) for i in range(5)]


def test_times_are_the_autopilots_however_late_messages_come(tmp_path):
    late = [0, 40, 10, 300, 20, 0, 90, 0]
    parts = [
        tlog_part(RECEIVED_US + (i * 100 + late[i]) * 1000, ned_message(5000 + i * 100, velocity(i)))
        for i in range(8)
    ]
    stamps = [s.stamp_ns for s in read(tmp_path, *parts).samples]
    assert np.diff(stamps).tolist() == [100_000_000] * 7


def test_a_wall_clock_that_steps_by_an_hour_changes_nothing(tmp_path):
    steady = [s.stamp_ns for s in read(tmp_path, tlog_flight(80)).samples]
    parts = [
        tlog_part(
            RECEIVED_US + i * 100_000 - (HOUR_US if i > 60 else 0), ned_message(7000 + i * 100, velocity(i))
        )
        for i in range(80)
    ]
    telemetry = read(tmp_path, *parts)
    assert [s.stamp_ns for s in telemetry.samples] == steady
    assert telemetry.counts == {}


@pytest.mark.parametrize("pause_us", [8_000_000, 0, -HOUR_US])
def test_a_reboot_leaves_a_gap_that_nobody_bridges(tmp_path, pause_us):
    first = tlog_flight(30, boot_ms=600_000)
    second = tlog_flight(20, boot_ms=3000, received_us=RECEIVED_US + 3_000_000 + pause_us)
    telemetry = read(tmp_path, first, second)
    assert velocities(telemetry) == [velocity(i) for i in [*range(30), *range(20)]]
    gap_ns = telemetry.samples[30].stamp_ns - telemetry.samples[29].stamp_ns
    assert gap_ns == 8_100_000_000 if pause_us > 0 else gap_ns >= 2_000_000_000 - 20_000_000
    assert telemetry.counts == {"reboots inside the log": 1}


@pytest.mark.parametrize("boot_ms", [8400, 9100, 12_000, 30_000])
def test_a_reboot_whose_times_begin_near_the_end_of_the_one_before_is_found(tmp_path, boot_ms):
    """The second part was put into the first one's time, here up to 40 s too early, and nothing was said."""
    first = tlog_flight(30, boot_ms=7000)  # up to 9.9 s
    second = tlog_flight(80, boot_ms=boot_ms, received_us=RECEIVED_US + 43_000_000)
    telemetry = read(tmp_path, first, second)
    assert velocities(telemetry) == [velocity(i) for i in [*range(30), *range(80)]]
    assert telemetry.samples[30].stamp_ns == pytest.approx(43e9, abs=0.1e9)
    assert telemetry.counts == {"reboots inside the log": 1}


def test_a_ground_station_that_hangs_is_no_reboot(tmp_path):
    """What it then reads at once came in its order but for some milliseconds."""
    first = tlog_flight(30, boot_ms=7000)
    second = tlog_flight(20, boot_ms=9895, received_us=RECEIVED_US + 6_000_000)
    telemetry = read(tmp_path, first, second)
    assert telemetry.samples[-1].stamp_ns == pytest.approx(4.8e9, abs=0.1e9)
    assert telemetry.counts == {}


def test_a_radio_that_was_out_of_reach_is_no_reboot(tmp_path):
    first = tlog_flight(30, boot_ms=7000)
    second = tlog_flight(20, boot_ms=7000 + 43_000, received_us=RECEIVED_US + 43_800_000)
    telemetry = read(tmp_path, first, second)
    assert telemetry.samples[30].stamp_ns == pytest.approx(43e9, abs=0.1e9)
    assert telemetry.counts == {}


@pytest.mark.parametrize("late_ms", [0, 40, 350, 3000, 9000])
def test_a_second_link_that_brings_everything_again_is_no_reboot(tmp_path, late_ms):
    """Each of its records, slower by seconds, was taken for the first one of another power-up."""
    parts = [
        (RECEIVED_US + i * 100_000 + link * late_ms * 1000, message)
        for i in range(200)
        for link in (0, 1)
        for message in (
            ned_message(7000 + i * 100, velocity(i)),
            quaternion_message(7000 + i * 100, quaternion(i)),
        )
    ]
    parts.sort(key=lambda part: part[0])
    telemetry = read(tmp_path, *(tlog_part(*part) for part in parts))
    assert velocities(telemetry) == [velocity(i) for i in range(200)]
    assert [s.stamp_ns for s in telemetry.velocities] == [i * 100_000_000 for i in range(200)]
    assert telemetry.counts == {"records that came twice": 400}


def test_what_a_second_link_repeats_of_a_gimbal_whose_heading_is_not_known_is_no_reboot(tmp_path):
    """It tells NaN, which equals nothing."""
    parts = []
    for i in range(100):
        for link in (0, 1):
            now = RECEIVED_US + i * 100_000 + link * 3_000_000
            message = gimbal_message(7000 + i * 100, (1, 0, 0, 0), math.nan)
            parts += [(now, ned_message(7000 + i * 100, velocity(i)), AUTOPILOT), (now, message, (1, 154))]
    parts.sort(key=lambda part: part[0])
    telemetry = read(tmp_path, *(tlog_part(*part) for part in parts))
    assert [c.stamp_ns for c in telemetry.attitudes] == [i * 100_000_000 for i in range(100)]
    assert telemetry.counts == {"records that came twice": 200}


@pytest.mark.parametrize("late_ms", [500, 3000, 8000])
@pytest.mark.parametrize("lost", [0.05, 0.3])
def test_what_one_link_lost_and_a_slower_one_brought_is_of_its_time(tmp_path, late_ms, lost):
    """Each of these was taken for a damaged time, several in a row for a reboot, and moved all that came after it."""
    arrives = np.random.default_rng(1).random((600, 2)) >= lost
    arrives[:50] = arrives[-1] = True
    parts = [
        (RECEIVED_US + i * 100_000 + link * late_ms * 1000, ned_message(7000 + i * 100, velocity(i)))
        for i in range(600)
        for link in (0, 1)
        if arrives[i, link]
    ]
    parts.sort(key=lambda part: part[0])
    telemetry = read(tmp_path, *(tlog_part(*part) for part in parts))
    there = np.flatnonzero(arrives.any(axis=1)).tolist()
    assert [s.stamp_ns for s in telemetry.velocities] == [i * 100_000_000 for i in there]
    assert velocities(telemetry) == [velocity(i) for i in there]
    assert telemetry.counts == {"records that came twice": int(arrives.all(axis=1).sum())}


def test_a_reboot_after_some_seconds_is_one_on_two_links_too(tmp_path):
    parts = []
    for boot, (boot_ms, begins_us) in enumerate([(3000, 0), (3000, 12_000_000)]):
        for i in range(60):
            for link in (0, 1):
                now = RECEIVED_US + begins_us + i * 100_000 + link * 3_000_000
                parts.append((now, ned_message(boot_ms + i * 100, velocity(100 * boot + i))))
    parts.sort(key=lambda part: part[0])
    telemetry = read(tmp_path, *(tlog_part(*part) for part in parts))
    assert velocities(telemetry) == [velocity(100 * boot + i) for boot in (0, 1) for i in range(60)]
    assert telemetry.velocities[60].stamp_ns == pytest.approx(12e9, abs=1e6)
    assert telemetry.counts == {"records that came twice": 120, "reboots inside the log": 1}


def test_what_a_sensor_that_is_stuck_says_again_is_kept(tmp_path):
    """The same velocity, each time at another time."""
    parts = [tlog_part(RECEIVED_US + i * 100_000, ned_message(7000 + i * 100, (1, 2, 3))) for i in range(15)]
    telemetry = read(tmp_path, *parts)
    assert len(telemetry.velocities) == 15 and telemetry.counts == {}


def test_the_vehicle_is_believed_not_other_senders(tmp_path):
    parts = [tlog_part(RECEIVED_US, heartbeat())]
    parts += [tlog_part(RECEIVED_US, heartbeat(mavlink.MAV_AUTOPILOT_INVALID), GROUND)]
    for i in range(10):
        now = RECEIVED_US + i * 1000
        parts += [tlog_part(now, ned_message(i, (-9, i, 0)), GROUND)] * 2
        parts += [tlog_part(now, ned_message(i, velocity(i)), AUTOPILOT)]
    telemetry = read(tmp_path, *parts)
    assert velocities(telemetry) == [velocity(i) for i in range(10)]
    assert telemetry.counts == {"velocities of other senders": 20}


def test_an_antenna_tracker_is_no_vehicle(tmp_path):
    """It has an autopilot too, and tells more often that it stands still: the drone's velocities were left out."""
    tracker = mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_ANTENNA_TRACKER, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 0, 0, 0, 3
    )
    parts = [tlog_part(RECEIVED_US, heartbeat(), AUTOPILOT), tlog_part(RECEIVED_US, tracker, (2, 1))]
    for i in range(10):
        now = RECEIVED_US + i * 1000
        parts += [tlog_part(now, ned_message(i, velocity(i)), AUTOPILOT)] if i else []
        parts += [tlog_part(now, ned_message(i, (0, 0, 0)), (2, 1))]
    telemetry = read(tmp_path, *parts)
    assert velocities(telemetry) == [velocity(i) for i in range(1, 10)]
    assert telemetry.counts == {"velocities of other senders": 10}


def global_message(i):
    """GLOBAL_POSITION_INT of `ned_message(i, velocity(i))`: 1e-7 degrees, mm, cm/s."""
    ned_cm_s = [round(100 * part) for part in velocity(i)]
    return mavlink.MAVLink_global_position_int_message(i, 480_000_000 + i, 110_000_000, 0, 0, *ned_cm_s, 0)


def told_twice(now, i):
    """What a second vehicle tells of its velocity."""
    return [tlog_part(now, message, (2, 1)) for message in (global_message(i), ned_message(i, (7, i, 0)))]


def test_what_another_vehicle_tells_twice_is_counted_once(tmp_path):
    """Its velocities in LOCAL_POSITION_NED and those in GLOBAL_POSITION_INT were added up."""
    parts = []
    for i in range(10):
        now = RECEIVED_US + i * 1000
        parts += [
            tlog_part(now, message, AUTOPILOT) for message in (ned_message(i, velocity(i)), heartbeat())
        ]
        if i < 8:
            parts += told_twice(now, i)
    telemetry = read(tmp_path, *parts)
    assert velocities(telemetry) == [velocity(i) for i in range(10)]
    assert telemetry.counts == {"velocities of other senders": 8}


def test_who_tells_the_same_velocity_twice_is_not_the_most_talkative(tmp_path):
    """Of two vehicles the one that sent both kinds of message was followed, though it told half as much."""
    parts = []
    for i in range(10):
        now = RECEIVED_US + i * 1000
        parts.append(tlog_part(now, ned_message(i, velocity(i)), AUTOPILOT))
        if i < 8:
            parts += told_twice(now, i)
    telemetry = read(tmp_path, *parts)
    assert velocities(telemetry) == [velocity(i) for i in range(10)]
    assert telemetry.counts == {"velocities of other senders": 8}


def test_a_better_message_that_comes_once_does_not_cost_all_others(tmp_path):
    """One that was asked for in flight: all of the lesser kind was dropped, and a velocity was left."""
    parts = [tlog_part(RECEIVED_US + i * 1000, global_message(i), AUTOPILOT) for i in range(40)]
    late = RECEIVED_US + 40_000
    parts += [tlog_part(late, message, AUTOPILOT) for message in (ned_message(40, velocity(40)), heartbeat())]
    telemetry = read(tmp_path, *parts)
    np.testing.assert_allclose(velocities(telemetry), [velocity(i) for i in range(40)], atol=0.006)
    assert "GLOBAL_POSITION_INT of vehicle 1" in telemetry.name


@pytest.mark.parametrize(("better", "told"), [(19, "GLOBAL_POSITION_INT"), (20, "LOCAL_POSITION_NED")])
def test_a_better_message_is_taken_that_comes_half_as_often(tmp_path, better, told):
    parts = []
    for i in range(40):
        now = RECEIVED_US + i * 1000
        parts.append(tlog_part(now, global_message(i), AUTOPILOT))
        parts += [tlog_part(now, ned_message(i, velocity(i)), AUTOPILOT)] if i < better else []
    telemetry = read(tmp_path, *parts)
    assert f"{told} of vehicle 1" in telemetry.name
    assert len(telemetry.velocities) == (better if told.startswith("LOCAL") else 40)


def odometry(i, *, frame=mavlink.MAV_FRAME_LOCAL_NED, child=mavlink.MAV_FRAME_BODY_FRD, usec=None):
    # The drone heads east; its velocity is forward, right, down.
    half = math.pi / 4
    q = (math.cos(half), 0, 0, math.sin(half))
    covariance = [math.nan] * 21
    covariance[0], covariance[6], covariance[11] = 0.01, 0.04, 0.07
    stamp = i * 100_000 if usec is None else usec
    return mavlink.MAVLink_odometry_message(
        stamp, frame, child, 0, 0, 0, q, 4 + i, 2, 1, 0, 0, 0, NAN_21, covariance
    )


def test_odometry_turns_the_velocity_of_the_body_into_the_world(tmp_path):
    telemetry = read(tmp_path, *[tlog_part(RECEIVED_US + i, odometry(i)) for i in range(5)])
    np.testing.assert_allclose(velocities(telemetry), [(-2, 4 + i, 1) for i in range(5)], atol=1e-6)
    assert telemetry.samples[0].sigma == pytest.approx(0.2)
    assert len(telemetry.body_attitudes) == 5


def test_odometry_in_the_world_stays(tmp_path):
    local = mavlink.MAV_FRAME_LOCAL_NED
    telemetry = read(tmp_path, *[tlog_part(RECEIVED_US + i, odometry(i, child=local)) for i in range(5)])
    assert velocities(telemetry) == [(4 + i, 2, 1) for i in range(5)]


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"frame": mavlink.MAV_FRAME_LOCAL_FRD}, "frames other than local NED"),
        ({"child": mavlink.MAV_FRAME_LOCAL_FLU}, "frames other than local NED"),
        ({"usec": RECEIVED_US}, "clock of its own"),
    ],
)
def test_odometry_that_cannot_be_placed_is_counted(tmp_path, changes, reason):
    parts = [tlog_part(RECEIVED_US + i, ned_message(i, velocity(i))) for i in range(5)]
    parts.append(tlog_part(RECEIVED_US + 5, odometry(1, **changes)))
    telemetry = read(tmp_path, *parts)
    ((counted, number),) = telemetry.counts.items()
    assert reason in counted and number == 1


@pytest.mark.parametrize("changes", [{"vy": math.nan}, {"q": (0, 0, 0, 0)}, {"q": (math.nan, 0, 0, 1)}])
def test_odometry_that_is_not_numbers_is_counted(tmp_path, changes):
    damaged = odometry(1)
    for name, value in changes.items():
        setattr(damaged, name, value)
    messages = [odometry(0), damaged, odometry(2)]
    telemetry = read(tmp_path, *[tlog_part(RECEIVED_US + i, each) for i, each in enumerate(messages)])
    assert len(telemetry.velocities) == len(telemetry.body_attitudes) == 2
    assert telemetry.counts == {"odometry that is not numbers": 1}


def test_an_attitude_in_angles_is_that_of_the_quaternion(tmp_path):
    """ATTITUDE is what most autopilots send unasked."""
    parts = []
    for i in range(5):
        yaw = math.nan if i == 3 else 1.2
        now = RECEIVED_US + i * 100_000
        parts += [
            tlog_part(now, ned_message(5000 + i * 100, velocity(i))),
            tlog_part(now, mavlink.MAVLink_attitude_message(5000 + i * 100, 0.1, -0.3, yaw, 0, 0, 0)),
        ]
    telemetry = read(tmp_path, *parts)
    assert [body.stamp_ns for body in telemetry.body_attitudes] == [0, 10**8, 2 * 10**8, 4 * 10**8]
    axes = rotation_from_quaternion(telemetry.body_attitudes[0].world_from_body)
    # Forward: by the yaw from north to east, then up by a pitch that is negative, so down. Down leans with the roll.
    np.testing.assert_allclose(
        axes[:, 0], [math.cos(0.3) * math.cos(1.2), math.cos(0.3) * math.sin(1.2), math.sin(0.3)], atol=1e-6
    )
    assert axes[2, 1:] == pytest.approx(
        [math.sin(0.1) * math.cos(0.3), math.cos(0.1) * math.cos(0.3)], abs=1e-6
    )
    assert telemetry.counts == {"attitudes that are no rotation": 1}


HALF_TURN_EAST = (math.cos(math.pi / 4), 0, 0, math.sin(math.pi / 4))


@pytest.mark.parametrize(
    ("flags", "delta_yaw", "looks"),
    [
        (0, math.nan, (0, 1, 0)),  # from the vehicle, which heads east
        (0, math.pi, (0, 1, 0)),  # an old gimbal's delta_yaw is void
        (16, math.nan, (1, 0, 0)),  # yaw lock: from north
        (32, math.nan, (0, 1, 0)),
        (32, 0.0, (0, 1, 0)),  # not told: PX4 leaves it so
        (32, math.pi, (-1, 0, 0)),  # the gimbal knows the heading better
        (32 | 16, -math.pi / 2, (0, -1, 0)),  # the frame's flag stands above the lock
        (64, math.pi, (1, 0, 0)),
    ],
)
def test_what_a_gimbals_yaw_counts_from(tmp_path, flags, delta_yaw, looks):
    parts = []
    for i in range(5):
        now = RECEIVED_US + i * 100_000
        message = mavlink.MAVLink_gimbal_device_attitude_status_message(
            0, 0, 90_000 + i * 100, flags, (1, 0, 0, 0), 0, 0, 0, 0, delta_yaw
        )
        parts += [
            tlog_part(now, ned_message(5000 + i * 100, velocity(i))),
            tlog_part(now, quaternion_message(5000 + i * 100, HALF_TURN_EAST)),
            tlog_part(now, message, (1, 154)),  # a device of its own, with a clock of its own
        ]
    cameras = read(tmp_path, *parts).attitudes
    assert [c.stamp_ns for c in cameras] == [i * 100_000_000 for i in range(5)]
    np.testing.assert_allclose([forward(c) for c in cameras], [looks] * 5, atol=1e-6)


def test_of_two_gimbals_behind_one_autopilot_the_first_carries_the_camera(tmp_path):
    parts, down = [], (math.cos(math.pi / 4), 0, -math.sin(math.pi / 4), 0)
    for i in range(5):
        now = RECEIVED_US + i * 100_000
        parts.append(tlog_part(now, ned_message(5000 + i * 100, velocity(i))))
        for device, looks in ((1, (1, 0, 0, 0)), (2, down)):
            message = mavlink.MAVLink_gimbal_device_attitude_status_message(
                0, 0, 5000 + i * 100 + device, 64, looks, 0, 0, 0, 0, 0, 0, device
            )
            parts.append(tlog_part(now, message))
    telemetry = read(tmp_path, *parts)
    cameras = telemetry.attitudes
    np.testing.assert_allclose([forward(c) for c in cameras], [(1, 0, 0)] * 5, atol=1e-6)
    assert telemetry.counts == {"attitudes of other gimbals": 5}


def gimbal_message(ms, looks, delta_yaw=0.0):
    return mavlink.MAVLink_gimbal_device_attitude_status_message(0, 0, ms, 64, looks, 0, 0, 0, 0, delta_yaw)


def test_of_two_gimbals_with_numbers_of_their_own_the_first_carries_the_camera(tmp_path):
    """The other one's attitudes were left out without a word."""
    parts, down = [], (math.cos(math.pi / 4), 0, -math.sin(math.pi / 4), 0)
    for i in range(5):
        now, ms = RECEIVED_US + i * 100_000, 5000 + i * 100
        parts.append(tlog_part(now, ned_message(ms, velocity(i))))
        parts.append(tlog_part(now, gimbal_message(ms + 7, down), (1, 171)))
        parts.append(tlog_part(now, gimbal_message(ms, (1, 0, 0, 0)), (1, 154)))
    telemetry = read(tmp_path, *parts)
    np.testing.assert_allclose([forward(c) for c in telemetry.attitudes], [(1, 0, 0)] * 5, atol=1e-6)
    assert telemetry.counts == {"attitudes of other gimbals": 5}


def test_a_gimbal_of_another_vehicle_carries_nothing(tmp_path):
    parts = [tlog_part(RECEIVED_US + i, ned_message(i, velocity(i))) for i in range(5)]
    parts += [tlog_part(RECEIVED_US + i, gimbal_message(i, (1, 0, 0, 0)), (2, 154)) for i in range(5)]
    assert not read(tmp_path, *parts).attitudes


def test_a_gimbal_without_a_clock_is_placed_by_its_arrival(tmp_path):
    """Its time is always 0: all reports but the first were dropped as not later than the one before."""
    parts = []
    for i in range(5):
        now = RECEIVED_US + i * 100_000
        parts.append(tlog_part(now, ned_message(5000 + i * 100, velocity(i))))
        message = mavlink.MAVLink_gimbal_device_attitude_status_message(
            0, 0, 0, 64, (1, 0, 0, 0), 0, 0, 0, 0, 0
        )
        parts.append(tlog_part(now + 30_000, message, (1, 154)))
    telemetry = read(tmp_path, *parts)
    cameras = telemetry.attitudes
    assert [c.stamp_ns for c in cameras] == [30_000_000 + i * 100_000_000 for i in range(5)]
    assert telemetry.counts == {}


def test_a_gimbal_without_any_heading_is_counted(tmp_path):
    message = mavlink.MAVLink_gimbal_device_attitude_status_message(
        0, 0, 5000, 32, (1, 0, 0, 0), 0, 0, 0, 0, math.nan
    )
    parts = [tlog_part(RECEIVED_US + i, ned_message(5000 + i, velocity(i))) for i in range(5)]
    telemetry = read(tmp_path, *parts, tlog_part(RECEIVED_US, message))
    assert telemetry.counts == {"gimbal attitudes without a heading": 1}


def test_a_message_with_a_wrong_checksum_is_counted(tmp_path):
    parts = [tlog_part(RECEIVED_US + i, ned_message(i, velocity(i))) for i in range(6)]
    parts[2] = parts[2][:30] + bytes([parts[2][30] ^ 1]) + parts[2][31:]
    telemetry = read(tmp_path, *parts)
    assert velocities(telemetry) == [velocity(i) for i in range(6) if i != 2]
    assert telemetry.counts["messages with a wrong checksum"] == 1


def test_messages_that_nobody_wants_are_passed_over_and_swallow_no_other(tmp_path):
    parts = []
    for i in range(6):
        now = RECEIVED_US + i * 100_000
        parts += [
            tlog_part(now, ned_message(i * 100, velocity(i))),
            tlog_part(now, mavlink.MAVLink_named_value_int_message(i, b"unwanted", 1)),
        ]
    whole = read(tmp_path, *parts)
    assert velocities(whole) == [velocity(i) for i in range(6)]
    assert whole.counts == {}
    size = len(parts[5])
    parts[5] = parts[5][:9] + bytes([len(parts[5]) + len(parts[6]) // 2]) + parts[5][10:]  # its length
    damaged = read(tmp_path, *parts)
    assert velocities(damaged) == [velocity(i) for i in range(6)]
    assert damaged.counts == {"bytes skipped: damaged or cut off": size}


def test_a_log_of_heartbeats_says_what_is_missing(tmp_path):
    parts = [tlog_part(RECEIVED_US + i, heartbeat()) for i in range(5)]
    with pytest.raises(BadInput, match="expected LOCAL_POSITION_NED or ODOMETRY"):
        read(tmp_path, *parts)
