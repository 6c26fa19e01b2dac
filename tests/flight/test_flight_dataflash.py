import math
import struct
import tracemalloc

import numpy as np
import pytest
from pymavlink.DFReader import DFReader_binary

from flightdepth.errors import BadInput
from flightdepth.flight.telemetry import read_telemetry
from flightdepth.motion import rotation_from_quaternion
from tests_logs import (
    DATAFLASH,
    START_US,
    dataflash_flight,
    dataflash_fmt,
    dataflash_head,
    dataflash_record,
    quaternion,
    velocity,
    written,
    xkf1,
)


def read(tmp_path, data):
    return read_telemetry(written(tmp_path / "flight.txt", data))


def velocities(telemetry):
    return [tuple(sample.velocity) for sample in telemetry.velocities]


def test_what_was_written_is_read(tmp_path):
    telemetry = read(tmp_path, dataflash_flight(30))
    assert velocities(telemetry) == [velocity(i) for i in range(30)]
    assert [s.stamp_ns for s in telemetry.samples] == [i * 100_000_000 for i in range(30)]
    assert [b.stamp_ns for b in telemetry.body_attitudes] == [20_000_000 + i * 10**8 for i in range(30)]
    for i, body in enumerate(telemetry.body_attitudes):
        np.testing.assert_allclose(body.world_from_body, quaternion(i), atol=1e-7)
    assert telemetry.counts == {}
    assert "XKF1 velocity, XKQ attitude" in telemetry.name


def test_pymavlink_reads_the_same(tmp_path):
    path = written(tmp_path / "flight.bin", dataflash_flight(30))
    log, theirs = DFReader_binary(str(path)), []
    while (message := log.recv_match(type=["XKF1"])) is not None:
        if message.C == 0:
            theirs.append((message.TimeUS, message.VN, message.VE, message.VD))
    log.close()
    ours = [(START_US + s.stamp_ns // 1000, *s.velocity) for s in read_telemetry(path).samples]
    assert ours == theirs


def test_a_log_takes_little_memory(tmp_path):
    """Found in review: all numbers of all records were held at once, 810 bytes a record."""
    parts = [dataflash_head()]
    for i in range(400):
        parts += [xkf1(START_US + i * 1000, (i % 7, 1, 0), core=core) for core in range(3)]
        parts += [dataflash_record("ATT", START_US + i * 1000, 0, 0, 0) for _ in range(3)]
        parts.append(dataflash_record("XKQ", START_US + i * 1000, 0, *quaternion(i)))
    path = written(tmp_path / "flight.bin", b"".join(parts))
    read_telemetry(written(tmp_path / "short.bin", dataflash_flight(3)))  # what is imported is not counted
    tracemalloc.start()
    try:
        telemetry = read_telemetry(path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(telemetry.velocities) == len(telemetry.body_attitudes) == 400
    assert peak < 12 * path.stat().st_size


def test_texts_between_the_numbers_are_left_out(tmp_path):
    head = dataflash_fmt(0x81, "XKF1", "nQBCnfff", "Tag,TimeUS,C,Roll,Text,VN,VE,VD")
    rows = [
        b"\xa3\x95\x81" + struct.pack("<4sQBH4s3f", b"T1", START_US + i * 1000, 0, 4500, b"T2", *velocity(i))
        for i in range(5)
    ]
    telemetry = read(tmp_path, dataflash_head([]) + head + b"".join(rows))
    assert velocities(telemetry) == [velocity(i) for i in range(5)]
    assert telemetry.counts == {}


def test_the_core_that_flies_is_followed(tmp_path):
    parts = [dataflash_head()]
    for i in range(10):
        parts.append(dataflash_record("XKF4", START_US + i * 10, 0, 7, 0 if i < 5 else 1))
        parts += [xkf1(START_US + i * 10, (core, i + 1, 0), core=core) for core in (0, 1)]
    assert velocities(read(tmp_path, b"".join(parts))) == [(i >= 5, i + 1, 0) for i in range(10)]


@pytest.mark.parametrize("status", [0b001, 0b011, 0b101])
def test_velocities_that_the_ekf_calls_bad_are_left_out_and_counted(tmp_path, status):
    parts = [dataflash_head()]
    for i in range(6):
        parts.append(dataflash_record("XKF4", START_US + i, 0, status if i in (1, 4) else 0b111, 0))
        parts.append(dataflash_record("XKF4", START_US + i, 1, 0, 0))  # the other core's says nothing
        parts.append(xkf1(START_US + i, velocity(i)))
    telemetry = read(tmp_path, b"".join(parts))
    assert velocities(telemetry) == [velocity(i) for i in (0, 2, 3, 5)]
    assert telemetry.counts == {"velocities marked invalid": 2}


def test_the_first_velocity_is_as_bad_as_the_ekf_says_next(tmp_path):
    """A log without GPS whose XKF1 came before its XKF4 had one velocity, and a warning of its length."""
    rows = [
        record
        for i in range(3)
        for record in (xkf1(START_US + i, velocity(i)), dataflash_record("XKF4", START_US + i, 0, 1, 0))
    ]
    with pytest.raises(BadInput, match=r"none \(3 velocities marked invalid\)"):
        read(tmp_path, dataflash_head() + b"".join(rows))


def test_what_the_ekf_says_first_is_true_of_what_came_before_not_what_it_says_last(tmp_path):
    parts = [dataflash_head()]
    for i in range(5):
        parts += [xkf1(START_US + i * 10, (core, i + 1, 0), core=core) for core in (0, 1)]
        # The first core flies and is bad at first; the second one, by which the drone flies from row 3 on, is good.
        parts.append(dataflash_record("XKF4", START_US + i * 10, 0, 7 if i else 1, i >= 2))
        parts.append(dataflash_record("XKF4", START_US + i * 10, 1, 7, i >= 2))
    telemetry = read(tmp_path, b"".join(parts))
    assert velocities(telemetry) == [(0, 3, 0), (1, 4, 0), (1, 5, 0)]
    assert telemetry.counts == {"velocities marked invalid": 2}


@pytest.mark.parametrize("flies", [0, 1])
def test_velocity_and_attitude_are_of_the_core_that_flies(tmp_path, flies):
    parts = [dataflash_head()]
    for i in range(3):
        for core in (0, 1):
            parts += [
                dataflash_record("XKF4", START_US + i * 10, core, 7 if core == flies else 1, flies),
                xkf1(START_US + i * 10, (core, i + 1, 0), core=core),
                dataflash_record("XKQ", START_US + i * 10, core, *quaternion(core)),
            ]
    telemetry = read(tmp_path, b"".join(parts))
    assert velocities(telemetry) == [(flies, i + 1, 0) for i in range(3)]
    assert len(telemetry.body_attitudes) == 3
    for body in telemetry.body_attitudes:
        np.testing.assert_allclose(body.world_from_body, quaternion(flies), atol=1e-7)


@pytest.mark.parametrize("attitude", ["NKQ", "NKQ1"])
def test_a_log_of_the_second_ekf_is_read_too(tmp_path, monkeypatch, attitude):
    for old, new in (("XKF1", "NKF1"), ("XKF4", "NKF4"), ("XKQ", attitude)):
        monkeypatch.setitem(DATAFLASH, new, DATAFLASH[old])
    parts = [dataflash_head(["NKF1", "NKF4", attitude])]
    for i in range(4):
        parts += [
            dataflash_record("NKF4", START_US + i * 10, 0, 7 if i else 1, 0),
            dataflash_record("NKF1", START_US + i * 10, 0, 0, 0, 0, *velocity(i)),
            dataflash_record(attitude, START_US + i * 10, 0, *quaternion(i)),
        ]
    telemetry = read(tmp_path, b"".join(parts))
    assert velocities(telemetry) == [velocity(i) for i in range(1, 4)]
    assert f"NKF1 velocity, {attitude} attitude" in telemetry.name
    np.testing.assert_allclose(telemetry.body_attitudes[-1].world_from_body, quaternion(3), atol=1e-7)


def test_a_record_without_a_field_is_counted(tmp_path):
    head = dataflash_fmt(0x81, "XKF1", "QBff", "TimeUS,C,VN,VE")
    row = b"\xa3\x95\x81" + struct.pack("<QBff", START_US, 0, 1, 2)
    with pytest.raises(BadInput, match="2 XKF1 records without VD"):
        read(tmp_path, dataflash_head([]) + head + row + row)


def test_euler_angles_where_there_is_no_quaternion(tmp_path):
    # Centidegrees: rolled 90 degrees to the right while heading east, the right wing points down.
    parts = [dataflash_head(["XKF1", "ATT"])]
    parts += [xkf1(START_US + i, velocity(i)) for i in range(3)]
    parts.append(dataflash_record("ATT", START_US, 9000, 0, 9000))
    (body,) = read(tmp_path, b"".join(parts)).body_attitudes
    rotation = rotation_from_quaternion(body.world_from_body)
    np.testing.assert_allclose(rotation[:, 0], [0, 1, 0], atol=1e-9)
    np.testing.assert_allclose(rotation[:, 1], [0, 0, 1], atol=1e-9)


def test_gps_as_a_last_resort(tmp_path):
    # 5 m/s towards 120 degrees, climbing with 1 m/s; the other receiver and the time without a fix are left.
    parts = [dataflash_head()]
    for i in range(5):
        parts.append(dataflash_record("GPA", START_US + i, 0, 45))
        parts.append(dataflash_record("GPA", START_US + i, 1, 300))
        parts.append(dataflash_record("GPS", START_US + i, 0, 3 if i else 1, 5 + i, 120, -1))
        parts.append(dataflash_record("GPS", START_US + i, 1, 3, 99, 0, 0))
    telemetry = read(tmp_path, b"".join(parts))
    sixty = math.radians(60)
    expected = [((5 + i) * -math.cos(sixty), (5 + i) * math.sin(sixty), -1) for i in range(1, 5)]
    np.testing.assert_allclose(velocities(telemetry), expected, atol=1e-9)
    assert [s.sigma for s in telemetry.samples] == pytest.approx([0.45] * 4)
    assert telemetry.counts == {"velocities without a 3D fix": 1}


def test_a_receiver_without_a_fix_does_not_hide_another(tmp_path):
    parts = [dataflash_head()]
    for i in range(5):
        parts.append(dataflash_record("GPS", START_US + i, 0, 3 if i == 2 else 1, 99, 0, 0))
        parts.append(dataflash_record("GPS", START_US + i, 1, 4, 5 + i, 0, 0.5))
    assert velocities(read(tmp_path, b"".join(parts))) == [(5 + i, 0, 0.5) for i in range(5)]


@pytest.mark.parametrize(("fixes", "chosen"), [(2, 1), (3, 0)])
def test_the_first_receiver_counts_unless_another_has_a_fix_more_than_twice_as_often(tmp_path, fixes, chosen):
    parts = [dataflash_head()]
    for i in range(5):
        parts.append(dataflash_record("GPS", START_US + i, 0, 3 if i < fixes else 1, 7, 0, 0))
        parts.append(dataflash_record("GPS", START_US + i, 1, 3, 8, 0, 0))
    assert {speed for speed, _, _ in velocities(read(tmp_path, b"".join(parts)))} == {7 + chosen}


def test_a_receiver_is_as_sure_as_it_said_last(tmp_path):
    parts = [dataflash_head()]
    for i in range(4):
        parts.append(dataflash_record("GPA", START_US + i, 0, 40 + 10 * i))  # cm/s
        parts.append(dataflash_record("GPS", START_US + i, 0, 3, 5 + i, 0, 0))
    assert [s.sigma for s in read(tmp_path, b"".join(parts)).samples] == pytest.approx([0.4, 0.5, 0.6, 0.7])


def test_the_core_that_flies_is_followed_before_the_log_says_which(tmp_path):
    parts = [dataflash_head()]
    for i in range(3):
        parts += [xkf1(START_US + i * 10, (core, i + 1, 0), core=core) for core in (0, 1)]
        parts.append(dataflash_record("XKF4", START_US + i * 10, 0, 7, 1))
    telemetry = read(tmp_path, b"".join(parts))
    assert velocities(telemetry) == [(1, i + 1, 0) for i in range(3)]
    assert telemetry.counts == {}


def test_a_gimbal_carries_the_camera(tmp_path):
    # Down by 30 degrees towards the east, whatever the drone does; the other gimbal and one without angles are left.
    parts = [dataflash_head()]
    for i in range(3):
        parts.append(xkf1(START_US + i * 10, velocity(i)))
        parts.append(dataflash_record("MNT", START_US + i * 10, 0, 0, 0, -10, -30, 5, 7, 80, 90))
        parts.append(dataflash_record("MNT", START_US + i * 10, 1, 0, 0, 0, 0, 0, 0, 0, 0))
    parts.append(dataflash_record("MNT", START_US + 30, 0, *[math.nan] * 8))
    telemetry = read(tmp_path, b"".join(parts))
    cameras = telemetry.attitudes
    assert [s.stamp_ns for s in cameras] == [0, 10_000, 20_000]
    axes = rotation_from_quaternion(cameras[0].world_from_camera)
    np.testing.assert_allclose(axes[:, 0], [-1, 0, 0], atol=1e-9)  # its right is south
    np.testing.assert_allclose(axes[:, 2], [0, math.sqrt(3) / 2, 0.5], atol=1e-9)
    assert telemetry.counts == {"attitudes of other gimbals": 3, "attitudes that are no rotation": 1}


def test_a_gimbal_rolls_the_camera(tmp_path):
    """Level, to the north, rolled a quarter turn to the right: the picture's right is down."""
    parts = [dataflash_head(), xkf1(START_US, velocity(0)), xkf1(START_US + 10, velocity(1))]
    parts.append(dataflash_record("MNT", START_US, 0, 3, 90, 0, 0, 0, 0, 0, 0))
    (camera,) = read(tmp_path, b"".join(parts)).attitudes
    axes = rotation_from_quaternion(camera.world_from_camera)
    np.testing.assert_allclose(axes[:, [0, 2]], [[0, 1], [0, 0], [1, 0]], atol=1e-9)


def test_a_reboot_inside_a_log(tmp_path):
    before = b"".join(xkf1(60_000_000 + i * 100_000, velocity(i)) for i in range(30))
    after = b"".join(xkf1(5_000_000 + i * 100_000, (7, 7, i)) for i in range(8))
    telemetry = read(tmp_path, dataflash_head() + before + after)
    assert velocities(telemetry) == [velocity(i) for i in range(30)]
    assert telemetry.counts == {"records of other power-ups of the autopilot": 8}


def test_a_damaged_time_is_no_reboot(tmp_path):
    records = [xkf1(START_US + i * 100_000, velocity(i)) for i in range(10)]
    records[4] = xkf1(START_US + 2**40, velocity(4))
    records[7] = xkf1(2**63, velocity(7))
    telemetry = read(tmp_path, dataflash_head() + b"".join(records))
    assert velocities(telemetry) == [velocity(i) for i in range(10) if i not in (4, 7)]
    assert telemetry.counts == {
        "records with a damaged time": 1,
        "XKF1 records with a number that cannot be": 1,
    }


def test_trash_between_records_is_skipped_and_counted(tmp_path):
    # One header that promises a record swallows no more than one record that follows.
    records = [xkf1(START_US + i * 100_000, velocity(i)) for i in range(6)]
    trash = b"\xa3\x95\x99 no record \xa3\x95\x80"
    telemetry = read(tmp_path, dataflash_head() + b"".join(records[:3]) + trash + b"".join(records[3:]))
    assert velocities(telemetry) == [velocity(i) for i in range(6)]
    assert telemetry.counts == {"bytes skipped: damaged or cut off": len(trash)}


@pytest.mark.parametrize("trash", [b"\xa3", b"\xa3\x95", b"trash"])
def test_damage_costs_neither_the_record_before_it_nor_the_last_one(tmp_path, trash):
    records = [xkf1(START_US + i * 100_000, velocity(i)) for i in range(6)]
    data = trash.join([b"".join(records[:3]), b"".join(records[3:5]), records[5]])
    telemetry = read(tmp_path, dataflash_head() + data)
    assert velocities(telemetry) == [velocity(i) for i in range(6)]
    assert telemetry.counts == {"bytes skipped: damaged or cut off": 2 * len(trash)}
    cut = read(tmp_path, dataflash_head() + data + b"\xa3\x95")
    assert velocities(cut) == velocities(telemetry)


def test_names_end_at_the_first_zero_and_need_not_be_ascii(tmp_path):
    letters, columns = DATAFLASH["XKF1"][1:]
    sound = dataflash_fmt(0x81, "XKF1", letters, columns).replace(b",VD\0\0", b",VD\0?")
    other = dataflash_fmt(0x90, "XY", "Q", "TimeUS").replace(b"XY", b"\xff\xfe")
    records = b"".join(xkf1(START_US + i, velocity(i)) for i in range(3))
    telemetry = read(tmp_path, dataflash_head([]) + other + sound + records)
    assert velocities(telemetry) == [velocity(i) for i in range(3)]
    assert telemetry.counts == {}


@pytest.mark.parametrize(
    ("letters", "length"),
    [("QBccCff?", None), ("QBccCff?", 26), ("QBccCfff", 255), ("QBccCff", None), ("", 3)],
)
def test_a_layout_that_contradicts_itself_is_left_out(tmp_path, letters, length):
    known = letters.replace("?", "f")
    fmt = dataflash_fmt(0x81, "XKF1", known, DATAFLASH["XKF1"][2], length)
    fmt = fmt.replace(known.encode() + b"\0", letters.encode() + b"\0") if known != letters else fmt
    with pytest.raises(BadInput, match="1 damaged announcements of a layout"):
        read(tmp_path, dataflash_head([]) + fmt)


def test_a_log_without_velocity_says_so(tmp_path):
    with pytest.raises(BadInput, match=r"no velocity.*expected a velocity \(XKF1 or NKF1 or GPS\)"):
        read(tmp_path, dataflash_head() + dataflash_record("IMU", START_US, 0, 1, 2, 3))


def test_not_a_number_and_too_fast_and_stuck(tmp_path):
    rows = [velocity(i) for i in range(40)]
    rows[3], rows[4], rows[5] = (math.nan, 0, 0), (math.inf, 0, 0), (1e30, 0, 0)
    rows[10:35] = [rows[10]] * 25
    telemetry = read(
        tmp_path, dataflash_head() + b"".join(xkf1(START_US + i * 100_000, row) for i, row in enumerate(rows))
    )
    # The first two seconds of a velocity that stands still are believed: records 10 to 30.
    assert telemetry.counts == {
        "velocities that are not numbers": 2,
        "velocities above 150 m/s": 1,
        "stuck velocities": 4,
    }


@pytest.mark.parametrize("way", [(0.5, 0, 0), (0, 0.5, 0), (0, 0, 0.5)])
def test_an_even_speed_along_a_changing_place_is_not_stuck(tmp_path, monkeypatch, way):
    columns = "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,PN,PE,PD"
    monkeypatch.setitem(DATAFLASH, "XKF1", (0x81, "QBccCffffff", columns))
    steps = [(START_US + i * 100_000, 0, 0, 0, 0, 5, 0, 0, *(i * step for step in way)) for i in range(60)]
    records = b"".join(dataflash_record("XKF1", *step) for step in steps)
    assert len(read(tmp_path, dataflash_head() + records).samples) == 60


def test_standing_on_the_ground_is_not_stuck(tmp_path):
    records = b"".join(xkf1(START_US + i * 100_000, (0, 0, 0)) for i in range(60))
    assert len(read(tmp_path, dataflash_head() + records).samples) == 60
