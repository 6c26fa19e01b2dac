"""Faults 1 to 4 of logs, for DJI subtitles and flight records, GPX, Parrot metadata and ROS recordings: a file that is
nothing of the kind, cut off anywhere, damaged anywhere, or that declares lengths it does not hold."""

import shutil
import struct
import time
import tracemalloc
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from trash import trashed

from flightdepth.errors import BadInput
from flightdepth.flight.ros_frames import ros_frames
from flightdepth.flight.ros_records import DamagedError, decompressed
from flightdepth.flight.telemetry import read_telemetry
from tests_dji_records import airdata, flight_reader, record, steady, txt_log
from tests_gpx import gopro2gpx, points
from tests_recordings import (
    DJI_LAYOUTS,
    Messages,
    cues,
    odometry_flight,
    parrot_csv,
    parrot_json,
    write_mcap,
    write_ros1,
    write_ros2,
)

VELOCITY = (3.0, -4.0, 0.5)
ENU = (-4.0, 3.0, -0.5)  # the same of a body whose axes are the map's


def small_ros1(path, rows=12):
    return write_ros1(path, odometry_flight("ros1", rows=rows, linear=ENU), chunk_size=2000)


def small_sqlite(path, rows=12):
    folder = write_ros2(path.with_suffix(".folder"), odometry_flight("cdr", rows=rows, linear=ENU), "SQLITE3")
    return shutil.move(next(folder.glob("*.db3")), path)


def small_mcap(path, rows=12):
    return write_mcap(
        path, odometry_flight("cdr", rows=rows, linear=ENU), compression="NONE", chunk_size=2000
    )


def small_mcap_zstd(path, rows=12):
    return write_mcap(path, odometry_flight("cdr", rows=rows, linear=ENU), chunk_size=2000)


def text(content):
    def write(path):
        path.write_text(content, encoding="utf-8")
        return path

    return write


def layout(name, seconds=6):
    body, _, _ = DJI_LAYOUTS[name]
    return text(cues(VELOCITY, body, seconds=seconds, rate=2, fixes_per_s=2))


def flown(seconds=1.2):
    return record(steady(VELOCITY), seconds=seconds, recordings=((0.2, seconds - 0.2),))


FILES = {
    "DJI, Mavic 3": layout("Mavic 3"),
    "DJI, Phantom 4 RTK": layout("Phantom 4 RTK"),
    "DJI, AirData": text(airdata(flown())),
    "DJI, Flight Reader": text(flight_reader(flown())),
    "DJI, TXTlogToCSVtool": text(txt_log(flown())),
    "GPX": text(gopro2gpx(points(VELOCITY))),
    "Parrot CSV": text(parrot_csv(VELOCITY, rows=12)),
    "Parrot JSON": text(parrot_json(VELOCITY, rows=12)),
    "ROS 1": small_ros1,
    "ROS 2, SQLite": small_sqlite,
    "MCAP": small_mcap,
    "MCAP, zstd": small_mcap_zstd,
}


def velocities(telemetry):
    return [sample.velocity for sample in telemetry.velocities]


@pytest.fixture(params=FILES)
def whole(request, tmp_path):
    return FILES[request.param](tmp_path / "whole.log")


def test_fault_1_other_things_are_refused(tmp_path):
    for name, data in {
        "empty": b"",
        "text": b"Dear diary,\n",
        "zeros": bytes(500),
        "short": b"\x89MCAP",
    }.items():
        path = tmp_path / name
        path.write_bytes(data)
        with pytest.raises(BadInput):
            read_telemetry(path)
    for path in (tmp_path / "missing", tmp_path):
        with pytest.raises(BadInput):
            read_telemetry(path)


@pytest.mark.parametrize("magic", [b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n", b"SQLite format 3\0"])
def test_fault_1_a_magic_number_alone_is_refused(tmp_path, magic):
    path = tmp_path / "flight"
    for rest in (b"", b"\0" * 100, b"\xff" * 100):
        path.write_bytes(magic + rest)
        with pytest.raises(BadInput, match=r"got .*no message"):
            read_telemetry(path)


def test_fault_2_a_cut_log_gives_what_came_before(whole, tmp_path):
    data, cut = whole.read_bytes(), tmp_path / "cut.log"
    full = velocities(read_telemetry(whole))
    lengths = []
    for end in [*range(1, len(data), max(1, len(data) // 60)), len(data)]:
        cut.write_bytes(data[:end])
        try:
            telemetry = read_telemetry(cut)
        except BadInput:
            lengths.append(0)
            continue
        found = velocities(telemetry)
        lengths.append(len(found))
        assert np.allclose(found, VELOCITY, atol=0.6)  # positions of DJI are rounded to 0.1 m
        looks_whole = data[:end].endswith((b"\n", b"</font>"))  # a text cut between two subtitles or rows
        told = telemetry.counts or looks_whole or len(found) == len(full)
        assert told, f"{end} of {len(data)} bytes: the cut is not told"
    assert lengths == sorted(lengths)
    assert lengths[-1] == len(full)


LONG_FILES = {
    "DJI, Mavic 3": layout("Mavic 3", seconds=60),
    "DJI, AirData": text(airdata(flown(20))),
    "DJI, Flight Reader": text(flight_reader(flown(20))),
    "GPX": text(gopro2gpx(points(VELOCITY, seconds=100))),
    "Parrot CSV": text(parrot_csv(VELOCITY, rows=100)),
    "Parrot JSON": text(parrot_json(VELOCITY, rows=100)),
    "ROS 1": lambda path: small_ros1(path, rows=100),
    "ROS 2, SQLite": lambda path: small_sqlite(path, rows=100),
    "MCAP": lambda path: small_mcap(path, rows=100),
}


@pytest.mark.parametrize("name", LONG_FILES)
def test_fault_2_half_a_log_gives_about_half(tmp_path, name):
    path = LONG_FILES[name](tmp_path / "whole.log")
    full = len(velocities(read_telemetry(path)))
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    half = velocities(read_telemetry(path))
    assert 0.25 * full < len(half) < 0.65 * full
    assert np.allclose(half, VELOCITY, atol=0.6)


def test_fault_2_a_bag_that_was_never_closed_is_read(tmp_path):
    bag = write_ros1(tmp_path / "flight.bag", odometry_flight("ros1", rows=12))
    data = bytearray(bag.read_bytes())
    at = data.index(b"index_pos=") + len(b"index_pos=")
    data = data[: int.from_bytes(data[at : at + 8], "little")]  # the index was not written
    data[at : at + 8] = bytes(8)
    bag.write_bytes(data)
    telemetry = read_telemetry(bag)
    assert len(velocities(telemetry)) == 12
    assert telemetry.counts == {"recordings cut off": 1}


@pytest.mark.parametrize(
    "seeds", [range(100), pytest.param(range(100, 500), marks=pytest.mark.slow)], ids=["100", "400 more"]
)
def test_fault_3_trash_is_refused_or_counted(whole, tmp_path, seeds):
    data, damaged = whole.read_bytes(), tmp_path / "damaged.log"
    read_telemetry(whole)  # rosbags prepares its types once
    started = time.process_time()
    for _ in range(10):
        read_telemetry(whole)
    normal_s = (time.process_time() - started) / 10
    read, spent_s = 0, 0.0
    for seed in seeds:
        damaged.write_bytes(trashed(data, seed))
        started = time.process_time()
        try:
            telemetry = read_telemetry(damaged)
            assert all(np.isfinite(velocity).all() for velocity in velocities(telemetry))
            read += 1
        except BadInput:
            pass
        spent_s += time.process_time() - started
    assert read > len(seeds) / 10
    assert spent_s / len(seeds) < 5 * normal_s


def test_fault_3_nested_brackets_and_long_numbers_are_counted(tmp_path):
    path = tmp_path / "flight.json"
    good = parrot_json(VELOCITY, rows=3)
    path.write_text(good[:-2] + ', {"time": ' + "[" * 100_000 + ', {"time": ' + "9" * 10_000 + "}]}")
    telemetry = read_telemetry(path)
    assert len(velocities(telemetry)) == 3
    assert telemetry.counts == {"damaged or cut frames": 2}


def peak_bytes(path):
    tracemalloc.start()
    try:
        with pytest.raises(BadInput):
            read_telemetry(path)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_fault_4_declared_lengths_are_refused_before_allocating(tmp_path):
    huge = struct.pack("<L", 2**31)
    op = b"\x04\0\0\0op=\x05" + b"\x10\0\0\0compression=none"[:0]
    size = struct.pack("<L", len(b"size=") + 4) + b"size=" + huge
    kind = struct.pack("<L", len(b"compression=bz2")) + b"compression=bz2"
    header = op + size + kind
    lengths = {
        "a record": b"#ROSBAG V2.0\n" + huge + bytes(50),
        "data": b"#ROSBAG V2.0\n" + struct.pack("<L", len(op)) + op + huge + bytes(50),
        "a chunk": b"#ROSBAG V2.0\n"
        + struct.pack("<L", len(header))
        + header
        + struct.pack("<L", 9)
        + bytes(9),
        "an MCAP record": b"\x89MCAP0\r\n" + struct.pack("<BQ", 6, 2**31) + bytes(50),
        "an MCAP string": b"\x89MCAP0\r\n" + struct.pack("<BQHL", 3, 50, 1, 2**31) + bytes(44),
        "an MCAP chunk": b"\x89MCAP0\r\n"
        + struct.pack("<BQQQQLL", 6, 49, 0, 0, 2**31, 0, 4)
        + b"zstd"
        + struct.pack("<Q", 5)
        + bytes(5),
    }
    path = tmp_path / "flight"
    for data in lengths.values():
        path.write_bytes(data)
        read_once = peak_bytes(path)
        assert read_once < 64 << 20


@pytest.mark.parametrize("compression", ["bz2", "lz4", "zstd"])
def test_fault_4_a_chunk_that_unpacks_to_more_than_it_says_is_refused(compression):
    import bz2

    import lz4.frame
    import zstandard

    packed = {"bz2": bz2.compress, "lz4": lz4.frame.compress, "zstd": zstandard.compress}[compression](
        bytes(50 << 20)
    )
    tracemalloc.start()
    try:
        with pytest.raises(DamagedError):
            decompressed(packed, compression, 1000)
        assert tracemalloc.get_traced_memory()[1] < 16 << 20
    finally:
        tracemalloc.stop()


def test_fault_3_trashed_pictures_are_refused_or_counted(tmp_path):
    made = Messages("cdr")
    images = [
        ("/image", i / 10, made.image(i / 10, np.full((8, 8, 3), i, np.uint8), "rgb8")) for i in range(8)
    ]
    path = write_mcap(tmp_path / "flight.mcap", images, compression="NONE", chunk_size=500)
    data, read = path.read_bytes(), 0
    for seed in range(200):
        path.write_bytes(trashed(data, seed))
        with suppress(BadInput):
            read += len(list(ros_frames(path)))
    assert read > 200


TEXT_PARTS = st.sampled_from(
    [
        "00:00:01,000 --> 00:00:02,000\n",
        "00:00:0",
        "[latitude: 48.7]",
        "[longitude: 2,2]",
        "GPS(2.2,48.7,9",
        ")",
        "H.S ",
        "1",
        "-999999999.9",
        "G.PRY (1, 2, 3)",
        "gb_yaw: 9",
        '{"time": 5, ',
        '"metadata": {"speed": {"north": 1e999}',
        "}}]",
        "time speed_north speed_east speed_down\n",
        "0 1 2 3\n",
        "nan inf -inf 1e400\n",
        "<font",
        "sep=;\n",
        "time(millisecond),latitude,longitude,xSpeed(mph), ySpeed(mph),zSpeed(),isVideo,GIMBAL.yaw,GIMBAL.pitch\n",
        "OSD.flyTime [s];OSD.latitude;OSD.longitude;OSD.xSpeed [m/s];OSD.ySpeed [m/s];OSD.zSpeed [m/s]\n",
        "0,48.7,2.2,1,2,3,1,4,5\n",
        "9e99,-1e300,nan,inf,2,3,true,1e18,5\n",
        "1;48,7;2,2;1;2,5;3\n",
        "\ufeff",
        "\x00",
    ]
)


@given(st.lists(TEXT_PARTS, max_size=30).map("".join))
def test_fault_3_any_mixture_of_text_is_refused_or_read(tmp_path_factory, mixture):
    path = tmp_path_factory.getbasetemp() / "mixture"
    path.write_text(mixture, encoding="utf-8")
    with suppress(BadInput):
        assert all(np.isfinite(velocity).all() for velocity in velocities(read_telemetry(path)))


@given(st.sampled_from([b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n", b"SQLite format 3\0"]), st.binary(max_size=300))
def test_fault_3_any_bytes_after_a_magic_number_are_refused(tmp_path_factory, magic, rest):
    path = tmp_path_factory.getbasetemp() / "bytes"
    path.write_bytes(magic + rest)
    with pytest.raises(BadInput):
        read_telemetry(path)
