"""Faults in the logs of autopilots: every damage ends in a typed error, or in less data and a count."""

import random
import struct
import sys
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flightdepth.errors import BadInput, MissingExtra
from flightdepth.flight.telemetry import read_telemetry
from flightdepth.ranges.displacement import Trajectory
from tests_logs import (
    DATAFLASH,
    LOCAL_POSITION,
    RECEIVED_US,
    START_US,
    dataflash_flight,
    dataflash_fmt,
    dataflash_head,
    local_position,
    ned_message,
    tlog_flight,
    tlog_part,
    ulog_bytes,
    ulog_flight,
    velocity,
    written,
    xkf1,
)

FLIGHTS = {"ulog": ulog_flight, "dataflash": dataflash_flight, "tlog": tlog_flight}
COUNT = 12  # velocities in each flight


@pytest.fixture(params=sorted(FLIGHTS))
def flight(request):
    return FLIGHTS[request.param]


def read(tmp_path, data):
    return read_telemetry(written(tmp_path / "log", data))


def velocities(telemetry):
    return [tuple(sample.velocity.tolist()) for sample in telemetry.velocities]


# Fault 1: not a log.


def test_a_missing_file(tmp_path):
    with pytest.raises(BadInput, match="No such file"):
        read_telemetry(tmp_path / "none.ulg")


def test_an_empty_file(tmp_path):
    with pytest.raises(BadInput, match=r"PX4 ULog, .*DataFlash, .*tlog, .*CSV, got an empty file"):
        read(tmp_path, b"")


@pytest.mark.parametrize(
    "data", [b"Dear diary\nnothing happened", bytes(5000), b"\xff" * 5000, b"\x89PNG\r\n"]
)
def test_text_and_zeros_and_pictures(tmp_path, data):
    with pytest.raises(BadInput, match=r"expected one of .*CSV.*got something else"):
        read(tmp_path, data)


def test_a_wrong_magic_number(tmp_path, flight):
    data = flight(COUNT)
    with pytest.raises(BadInput, match="expected one of"):
        read(tmp_path, b"\x17" + data[1:])


def test_a_magic_number_alone(tmp_path, flight):
    with pytest.raises(BadInput):
        read(tmp_path, flight(COUNT)[:16])


def test_a_log_whose_package_is_not_installed(tmp_path, flight, monkeypatch):
    for name in ("pyulog", "pymavlink.DFReader", "pymavlink.dialects.v20"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingExtra, match=r"flightdepth\[(px4|ardupilot)\]"):
        read(tmp_path, flight(COUNT))


# Fault 2: cut at any byte.


def test_what_came_before_a_cut_is_used(tmp_path, flight):
    data, whole, reached = flight(COUNT), [velocity(i) for i in range(COUNT)], set()
    for end in range(17, len(data), 7):
        try:
            telemetry = read(tmp_path, data[:end])
        except BadInput:
            assert not reached, f"{end}: nothing, where a shorter log gave something"
            continue
        found = velocities(telemetry)
        assert found == whole[: len(found)]
        assert len(found) >= max(reached, default=0)
        reached.add(len(found))
    assert reached == set(range(1, COUNT + 1))


def test_a_cut_in_the_middle_is_reported(tmp_path, flight):
    counts = read(tmp_path, flight(COUNT)[:-11]).counts
    assert [reason for reason in counts if "cut off" in reason]


# Fault 3: trash.


def trashed(data: bytes, chance: random.Random) -> bytes:
    """One to twenty places overwritten, or a stretch, or a part left out or doubled."""
    copy = bytearray(data)
    for _ in range(chance.randint(1, 20)):
        at = chance.randrange(7, len(copy))
        copy[at] = chance.randrange(256)
    at, length = chance.randrange(7, len(copy)), chance.randrange(60)
    kind = chance.randrange(5)
    if kind == 1:
        copy[at : at + length] = chance.randbytes(length)
    elif kind == 2:
        del copy[at : at + length]
    elif kind == 3:
        copy[at:at] = copy[at : at + length]
    elif kind == 4:
        copy[at : at + length] = bytes([chance.choice([0, 255])]) * length
    return bytes(copy)


def outcomes(tmp_path, data, seeds):
    """How many trashed copies could be read, and processor time of all; anything but BadInput flies out."""
    copies = [trashed(data, random.Random(seed)) for seed in seeds]
    paths = [written(tmp_path / f"{index}", copy) for index, copy in enumerate(copies)]
    start, good = time.process_time(), 0
    for path in paths:
        try:
            telemetry = read_telemetry(path)
        except BadInput as error:
            assert "\n" not in str(error)
            continue
        good += 1
        assert all(np.linalg.norm(v) <= 150 for v in velocities(telemetry))
        assert np.all(np.diff([s.stamp_ns for s in telemetry.samples]) >= 0)
    return good, time.process_time() - start


def test_trashed_copies_end_well(tmp_path, flight, capfd):
    good, _ = outcomes(tmp_path, flight(40), range(100))
    assert good > 20  # most damage costs a few records, not the log
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", sorted(FLIGHTS))
@given(at=st.integers(0, 10**6), trash=st.binary(max_size=200), repeats=st.integers(1, 20))
@settings(max_examples=60)
def test_any_bytes_at_any_place(tmp_path_factory, name, at, trash, repeats):
    data = FLIGHTS[name](COUNT)
    at = 16 + at % (len(data) - 16)
    path = tmp_path_factory.getbasetemp() / f"any-{name}"
    try:
        telemetry = read_telemetry(written(path, data[:at] + trash * repeats + data[at:]))
    except BadInput:
        return
    assert np.all(np.diff([s.stamp_ns for s in telemetry.samples]) >= 0)


@pytest.mark.slow
def test_500_trashed_copies_take_no_longer_than_twice_as_many_whole_ones(tmp_path, flight):
    data = flight(1000)
    path = written(tmp_path / "whole", data)
    whole_s, trashed_s = [], 0.0
    for first in range(0, 500, 50):  # in turns: a machine is not always as fast
        start = time.process_time()
        read_telemetry(path)
        whole_s.append(time.process_time() - start)
        trashed_s += outcomes(tmp_path, data, range(first, first + 50))[1]
    assert trashed_s < 2 * 500 * np.median(whole_s)


# Fault 4: a declared length that is not there.


def test_a_ulog_array_of_2_to_the_31(tmp_path):
    bomb = LOCAL_POSITION + f"uint8_t[{2**31}] bomb;"
    with pytest.raises(BadInput):
        read(tmp_path, ulog_bytes([bomb], [(0, 0, "vehicle_local_position")], []))


def test_a_ulog_message_longer_than_the_file(tmp_path):
    data = ulog_flight(COUNT) + struct.pack("<HB", 65535, ord("D"))
    assert velocities(read(tmp_path, data)) == [velocity(i) for i in range(COUNT)]


def test_an_appended_part_at_2_to_the_62(tmp_path):
    data = bytearray(ulog_flight(COUNT))
    flags = 16 + 3
    data[flags + 8] = 1  # incompatible flag: data was appended, at
    data[flags + 16 : flags + 24] = struct.pack("<Q", 2**62)
    assert velocities(read(tmp_path, bytes(data))) == [velocity(i) for i in range(COUNT)]


def test_a_dataflash_layout_longer_than_its_fields(tmp_path):
    name, (number, letters, columns) = "XKF1", DATAFLASH["XKF1"]
    fmt = dataflash_fmt(number, name, letters, columns, 255)
    with pytest.raises(BadInput, match="damaged announcements"):
        read(tmp_path, dataflash_head([]) + fmt + xkf1(START_US, velocity(0)))


def test_a_tlog_message_longer_than_the_file(tmp_path):
    last = bytearray(tlog_part(RECEIVED_US + 10**6, ned_message(9000, velocity(0))))
    last[9] = 255
    telemetry = read(tmp_path, tlog_flight(COUNT) + bytes(last))
    assert velocities(telemetry) == [velocity(i) for i in range(COUNT)]
    assert telemetry.counts


# Fault 12: the autopilot starts again inside the log.


def test_nobody_integrates_across_a_reboot(tmp_path):
    second = tlog_flight(30, boot_ms=2000, received_us=RECEIVED_US + 3_000_000)
    telemetry = read(tmp_path, tlog_flight(30, boot_ms=900_000) + second)
    trajectory = Trajectory()
    for sample in telemetry.samples:
        trajectory.add_velocity(sample.stamp_ns, sample.velocity, frame=sample.frame, sigma=sample.sigma)
    last, first = telemetry.samples[29].stamp_ns, telemetry.samples[30].stamp_ns
    states = trajectory.at(np.array([last - 10**8, last, first, first + 10**8]))
    assert states.segment[0] == states.segment[1] != states.segment[2] == states.segment[3]
    assert telemetry.counts == {"reboots inside the log": 1}


# Fault 14: velocities that cannot be.


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        ((float("nan"), 0, 0), "velocities that are not numbers"),
        ((0, float("inf"), 0), "velocities that are not numbers"),
        ((0, 0, 3e38), "velocities above 150 m/s"),
    ],
)
def test_a_velocity_that_cannot_be_is_counted(tmp_path, bad, reason):
    rows = [velocity(0), bad, velocity(2), velocity(3)]
    logs = {
        "ulog": ulog_bytes(
            [LOCAL_POSITION],
            [(0, 0, "vehicle_local_position")],
            [(0, local_position(START_US + i * 10**5, row)) for i, row in enumerate(rows)],
        ),
        "dataflash": dataflash_head()
        + b"".join(xkf1(START_US + i * 10**5, row) for i, row in enumerate(rows)),
        "tlog": b"".join(
            tlog_part(RECEIVED_US + i * 10**5, ned_message(i * 100, row)) for i, row in enumerate(rows)
        ),
    }
    for data in logs.values():
        telemetry = read(tmp_path, data)
        assert velocities(telemetry) == [velocity(i) for i in (0, 2, 3)]
        assert telemetry.counts == {reason: 1}
