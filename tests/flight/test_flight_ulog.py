import math
import struct

import numpy as np
import pytest
from pyulog import ULog

from flightdepth.errors import BadInput
from flightdepth.flight.gimbal import GimbalFlags
from flightdepth.flight.records import VelocitySample
from flightdepth.flight.telemetry import read_telemetry
from flightdepth.motion import rotation_from_euler, rotation_from_quaternion
from tests_logs import (
    ATTITUDE,
    GIMBAL,
    LOCAL_POSITION,
    START_US,
    attitude,
    gimbal,
    local_position,
    quaternion,
    ulog_bytes,
    ulog_flight,
    ulog_message,
    velocity,
    written,
)

NAMES = [(0, 0, "vehicle_local_position"), (0, 1, "vehicle_attitude")]


def read(tmp_path, data):
    return read_telemetry(written(tmp_path / "flight.csv", data))  # the suffix says nothing


def positions(*bodies):
    return ulog_bytes([LOCAL_POSITION], NAMES[:1], [(0, body) for body in bodies])


def test_what_was_written_is_read(tmp_path):
    telemetry = read(tmp_path, ulog_flight(30))
    assert [tuple(s.velocity) for s in telemetry.samples] == [velocity(i) for i in range(30)]
    assert [s.stamp_ns for s in telemetry.samples] == [i * 100_000_000 for i in range(30)]
    for i, body in enumerate(telemetry.body_attitudes):
        np.testing.assert_allclose(body.world_from_body, quaternion(i), atol=1e-7)
        assert body.stamp_ns == i * 100_000_000 + 20_000_000
    assert len(telemetry.body_attitudes) == 30
    assert telemetry.counts == {}
    assert telemetry.name.startswith("ULog flight.csv") and "7.000 s of its clock" in telemetry.name


def test_what_pyulog_writes_is_read_alike(tmp_path):
    first = written(tmp_path / "a.ulg", ulog_flight(20))
    ULog(str(first)).write_ulog(str(tmp_path / "b.ulg"))
    a, b = read_telemetry(first), read_telemetry(tmp_path / "b.ulg")
    assert [tuple(s.velocity) for s in a.samples] == [tuple(s.velocity) for s in b.samples]


def test_a_time_of_measurement_that_nobody_set_is_that_of_publication(tmp_path):
    """All but one of the velocities were left out as "not later than the one before"."""
    bodies = [local_position(START_US + i * 100_000, velocity(i)) for i in range(5)]
    telemetry = read(tmp_path, positions(*[body[:8] + bytes(8) + body[16:] for body in bodies]))
    assert [sample.stamp_ns for sample in telemetry.samples] == [i * 100_000_000 for i in range(5)]
    assert telemetry.counts == {}


def test_times_are_those_of_measurement_however_late_it_is_published(tmp_path):
    bodies = []
    for i in range(5):
        body = local_position(START_US + i * 100_000, velocity(i))
        bodies.append(struct.pack("<Q", START_US + i * 103_000 + 9000) + body[8:])
    assert [s.stamp_ns for s in read(tmp_path, positions(*bodies)).samples] == [i * 10**8 for i in range(5)]


def test_a_damaged_time_costs_its_record_alone(tmp_path):
    bodies = [local_position(START_US + i * 100_000, velocity(i)) for i in range(10)]
    bodies[4] = local_position(2**63, velocity(4))
    telemetry = read(tmp_path, positions(*bodies))
    assert [tuple(s.velocity) for s in telemetry.samples] == [velocity(i) for i in range(10) if i != 4]
    assert telemetry.counts == {"records with a damaged time": 1}


def test_two_power_ups_in_one_log_are_not_mixed(tmp_path):
    """Found in review: their samples were sorted into one flight, by two clocks that each began at power-up."""
    stamps_us = [*range(20_000_000, 24_000_000, 100_000), *range(19_000_000, 22_000_000, 100_000)]
    data = []
    for i, stamp_us in enumerate(stamps_us):
        data += [
            (0, local_position(stamp_us, velocity(i))),
            (1, attitude(stamp_us + 20_000, quaternion(i))),
        ]
    telemetry = read(tmp_path, ulog_bytes([LOCAL_POSITION, ATTITUDE], NAMES, data))
    assert [tuple(s.velocity) for s in telemetry.samples] == [velocity(i) for i in range(40)]
    assert len(telemetry.body_attitudes) == 40
    assert telemetry.counts == {"records of other power-ups of the autopilot": 60}


def test_attitudes_of_an_unknown_power_up_are_left_out(tmp_path):
    """The second power-up has no attitude: nobody knows which of the two the attitudes are of."""
    stamps_us = [*range(20_000_000, 23_000_000, 100_000), *range(9_000_000, 13_000_000, 100_000)]
    data = [(0, local_position(stamp_us, velocity(i))) for i, stamp_us in enumerate(stamps_us)]
    data += [(1, attitude(20_000_000 + i * 100_000, quaternion(i))) for i in range(30)]
    telemetry = read(tmp_path, ulog_bytes([LOCAL_POSITION, ATTITUDE], NAMES, data))
    assert [tuple(s.velocity) for s in telemetry.samples] == [velocity(i) for i in range(30, 70)]
    assert telemetry.body_attitudes == ()
    assert telemetry.counts == {"records of other power-ups of the autopilot": 60}


@pytest.mark.parametrize("starts_s", [(20, 9), (30, 20, 9)])
def test_attitudes_that_start_again_more_often_than_the_velocities_are_left_out(tmp_path, starts_s):
    times_us = [start_s * 1_000_000 + k * 100_000 for start_s in starts_s for k in range(20)]
    data = [(1, attitude(stamp_us, quaternion(0))) for stamp_us in times_us]
    with pytest.raises(BadInput, match="expected a velocity"):
        read(tmp_path, ulog_bytes([ATTITUDE], NAMES[1:], data))
    flown_us = times_us[-20 * (len(starts_s) - 1) :]
    data += [(0, local_position(stamp_us, velocity(i))) for i, stamp_us in enumerate(flown_us)]
    telemetry = read(tmp_path, ulog_bytes([LOCAL_POSITION, ATTITUDE], NAMES, data))
    assert [tuple(s.velocity) for s in telemetry.samples] == [velocity(i) for i in range(20)]
    assert telemetry.body_attitudes == ()
    assert telemetry.counts == {
        "records of other power-ups of the autopilot": len(times_us) + len(flown_us) - 20
    }


@pytest.mark.parametrize("numbers", [(0, 1), (1, 0)])
def test_of_two_logs_joined_the_first_is_read(tmp_path, numbers):
    """Found in review: where the second was large, the velocities of both were sorted into one flight."""
    position, turn = numbers
    data = []
    for i in range(400):
        stamp_us = START_US + i * 100_000
        data += [
            (position, local_position(stamp_us, velocity(-i))),
            (turn, attitude(stamp_us, quaternion(i))),
        ]
    names = [(0, position, NAMES[0][2]), (0, turn, NAMES[1][2])]
    telemetry = read(tmp_path, ulog_flight(30) + ulog_bytes([LOCAL_POSITION, ATTITUDE], names, data))
    assert [tuple(s.velocity) for s in telemetry.samples] == [velocity(i) for i in range(30)]
    assert telemetry.counts == {"another log joined to this one, not read": 1}


def test_sigma_is_of_one_axis(tmp_path):
    # Horizontal 0.5 m/s is the length of north and east together: (0.5^2 + 0.25^2) / 3.
    sample = read(tmp_path, ulog_flight(3)).samples[0]
    assert sample.sigma == pytest.approx(math.sqrt((0.25 + 0.0625) / 3))


def test_unknown_deviation_is_no_sigma(tmp_path):
    bodies = [local_position(START_US + i, velocity(i), deviations=(math.nan, 0.1)) for i in range(3)]
    assert all(s.sigma is None for s in read(tmp_path, positions(*bodies)).samples)


@pytest.mark.parametrize("valid", [(False, True), (True, False)])
def test_velocities_marked_invalid_are_left_out_and_counted(tmp_path, valid):
    bodies = [
        local_position(START_US + i * 100_000, velocity(i), valid=valid if i in (1, 4) else (True, True))
        for i in range(6)
    ]
    telemetry = read(tmp_path, positions(*bodies))
    assert [tuple(s.velocity) for s in telemetry.samples] == [velocity(i) for i in (0, 2, 3, 5)]
    assert telemetry.counts == {"velocities marked invalid": 2}


def test_the_first_instance_of_a_topic_counts(tmp_path):
    names = [(1, 0, "vehicle_local_position"), (0, 5, "vehicle_local_position")]
    data = [(0, local_position(START_US, (9, 9, 9)))]
    data += [(5, local_position(START_US + i, velocity(i))) for i in range(3)]
    telemetry = read(tmp_path, ulog_bytes([LOCAL_POSITION], names, data))
    assert [tuple(s.velocity) for s in telemetry.samples] == [velocity(i) for i in range(3)]


def test_the_first_gimbal_carries_the_camera(tmp_path):
    """The others' attitudes were left out without a word."""
    names = [*NAMES, (0, 2, "gimbal_device_attitude_status"), (1, 3, "gimbal_device_attitude_status")]
    data = [(0, local_position(START_US + i, velocity(i))) for i in range(3)]
    data += [(2, gimbal(START_US + i, quaternion(i), GimbalFlags.YAW_LOCK)) for i in range(3)]
    data += [(3, gimbal(START_US + i, (1, 0, 0, 0), GimbalFlags.YAW_LOCK)) for i in range(4)]
    telemetry = read(tmp_path, ulog_bytes([LOCAL_POSITION, ATTITUDE, GIMBAL], names, data))
    assert len(telemetry.attitudes) == 3
    assert telemetry.counts == {"attitudes of other gimbals": 4}


def test_a_log_without_a_velocity_is_refused_with_what_it_lacks(tmp_path):
    """It said "expected a velocity, got none" only."""
    data = [(1, attitude(START_US + i, quaternion(i))) for i in range(3)]
    with pytest.raises(BadInput, match=r"expected a velocity \(vehicle_local_position\), got none$"):
        read(tmp_path, ulog_bytes([ATTITUDE], NAMES[1:], data))


def test_resets_of_the_attitude_are_noted(tmp_path):
    data = [(0, local_position(START_US + i, velocity(i))) for i in range(4)]
    data += [(1, attitude(START_US + i, quaternion(i), resets=i // 2)) for i in range(4)]
    assert "1 resets" in read(tmp_path, ulog_bytes([LOCAL_POSITION, ATTITUDE], NAMES, data)).name


def test_a_gimbal_gives_the_cameras_attitude(tmp_path):
    # The drone heads east, the gimbal looks 30 degrees down, its yaw counts from the drone.
    half = math.pi / 4
    east, down = (math.cos(half), 0, 0, math.sin(half)), rotation_from_euler(0, -math.pi / 6, 0)
    pitch = (math.cos(math.pi / 12), 0, -math.sin(math.pi / 12), 0)
    names = [*NAMES, (0, 2, "gimbal_device_attitude_status")]
    data = [(0, local_position(START_US + i * 1000, velocity(i))) for i in range(3)]
    data += [(1, attitude(START_US, east)), (2, gimbal(START_US + 1000, pitch, 32))]
    telemetry = read(tmp_path, ulog_bytes([LOCAL_POSITION, ATTITUDE, GIMBAL], names, data))
    (camera,) = telemetry.attitudes
    forward = rotation_from_quaternion(camera.world_from_camera)[:, 2]
    np.testing.assert_allclose(forward, [0, math.sqrt(0.75), 0.5], atol=1e-6)
    np.testing.assert_allclose(forward, rotation_from_euler(0, 0, math.pi / 2) @ down[:, 0], atol=1e-6)


def test_a_gimbal_of_an_older_log_tells_no_delta_yaw(tmp_path):
    names = [*NAMES, (0, 2, "gimbal_device_attitude_status")]
    older = GIMBAL.replace("float delta_yaw;", "")
    body = gimbal(START_US, quaternion(0), GimbalFlags.YAW_LOCK)
    data = [(0, local_position(START_US + i, velocity(i))) for i in range(3)]
    data.append((2, body[:24] + body[28:]))
    telemetry = read(tmp_path, ulog_bytes([LOCAL_POSITION, ATTITUDE, older], names, data))
    assert len(telemetry.attitudes) == 1
    assert telemetry.counts == {}


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_even_speed_along_a_changing_place_is_not_stuck(tmp_path, axis):
    fields = LOCAL_POSITION.replace("bool v_xy", "float x;float y;float z;bool v_xy")
    bodies = []
    for i in range(60):
        body, place = local_position(START_US + i * 100_000, (5, 0, 0)), [0.0] * 3
        place[axis] = i / 2
        bodies.append(body[:36] + struct.pack("<3f", *place) + body[36:])
    telemetry = read(tmp_path, ulog_bytes([fields], NAMES[:1], [(0, body) for body in bodies]))
    assert len(telemetry.samples) == 60


def test_drop_outs_are_counted(tmp_path):
    data = ulog_flight(5) + ulog_message("O", struct.pack("<H", 120))
    assert read(tmp_path, data).counts == {"drop-outs that the logger noted": 1}


@pytest.mark.parametrize(
    "formats",
    [
        ["vehicle_local_position:b[60000] x;", "b:c[60000] x;", "c:uint64_t[60000] x;"],
        ["vehicle_local_position:uint64_t timestamp;vehicle_local_position[2] x;"],
    ],
)
def test_a_format_that_unfolds_without_end_is_refused_before_it_does(tmp_path, formats):
    with pytest.raises(BadInput, match="a format"):
        read(tmp_path, ulog_bytes(formats, NAMES[:1], []))


def test_a_log_without_velocity_says_so(tmp_path):
    with pytest.raises(BadInput, match="expected a velocity"):
        read(tmp_path, ulog_bytes([ATTITUDE], [NAMES[1]], [(1, attitude(START_US, quaternion(0)))]))


def test_a_topic_without_its_fields_is_counted(tmp_path):
    broken = LOCAL_POSITION.replace("v_z_valid", "v_z_walid")
    data = ulog_bytes([broken], NAMES[:1], [(0, local_position(START_US, velocity(0)))])
    with pytest.raises(BadInput, match="topics without the field v_z_valid"):
        read(tmp_path, data)


def test_an_endless_stretch_of_ones_comes_to_an_end(tmp_path):
    telemetry = read(tmp_path, ulog_flight(20) + b"\xff" * 20_000)
    assert len(telemetry.samples) == 20
    assert list(telemetry.counts) == ["cut off or damaged: the log is not whole"]


def test_pyulog_prints_nothing(tmp_path, capfd):
    data = ulog_flight(20).replace(ulog_message("A", b"\0\0\0vehicle_local_position"), b"", 1)
    with pytest.raises(BadInput):
        read(tmp_path, data)
    assert capfd.readouterr() == ("", "")


def test_all_velocities_are_of_the_world(tmp_path):
    samples = read(tmp_path, ulog_flight(5)).samples
    assert all(isinstance(s, VelocitySample) and s.frame == "world" for s in samples)
