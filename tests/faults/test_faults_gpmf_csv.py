"""Faults 1 to 4, 10, 12 and 14 of the track inside a GoPro's video, and of the CSV that people write themselves."""

import struct
import time
import tracemalloc
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from flight_files import add_gpmf, klv, lned_payload, make_video, nest
from hypothesis import given, settings
from hypothesis import strategies as st
from trash import trashed

from flightdepth.errors import BadInput
from flightdepth.flight.gpmf import GpmfError, streams
from flightdepth.flight.gpmf_telemetry import read_gpmf
from flightdepth.flight.telemetry import read_telemetry

ROWS = 40
LNED = frozenset(["LNED"])


def velocity(k):
    return (1.0 + k / 8, -2.0, 0.25)


def payloads(rows=ROWS, each=velocity):
    """Four samples a second, a payload each second."""
    samples = [(10_000 + 250 * k, *each(k)) for k in range(rows)]
    return [lned_payload(samples[at : at + 4]) for at in range(0, rows, 4)]


def flight(tmp_path, parts):
    """A video of as many seconds as there are payloads, and these in it."""
    path = tmp_path / "flight.mp4"
    path.write_bytes(film_of(len(parts)))
    return add_gpmf(path, parts)


@cache
def film_of(seconds):
    """The bytes of a small video."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "flight.mp4"
        return make_video(path, range(0, 1000 * seconds, 250), width=32, height=32).read_bytes()


def velocities(telemetry):
    return [tuple(sample.velocity.tolist()) for sample in telemetry.samples]


def written(tmp_path, text):
    path = tmp_path / "log.csv"
    path.write_text("time_s,vn_m_s,ve_m_s,vd_m_s\n" + text)
    return path


# Fault 1


def test_fault_1_a_video_without_a_track_has_no_telemetry(tmp_path):
    assert read_gpmf(make_video(tmp_path / "flight.mp4", range(0, 400, 40))) is None


@pytest.mark.parametrize("content", [b"", b"Dear diary,\nwe flew.\n", bytes(3000), b"\xff" * 3000])
def test_fault_1_what_is_no_video_is_refused(tmp_path, content):
    path = tmp_path / "flight.mp4"
    path.write_bytes(content)
    with pytest.raises(BadInput):
        read_gpmf(path)


def test_fault_1_another_magic_is_no_track(tmp_path):
    parts = [part.replace(b"DEVC", b"CVED", 1) for part in payloads()]
    assert read_gpmf(flight(tmp_path, parts)) is None


# Fault 2


def test_fault_2_a_cut_track_gives_what_came_before(tmp_path):
    whole = [velocity(k) for k in range(ROWS)]
    parts = payloads()
    for end in range(4, len(parts[-1]), 13):
        telemetry = read_gpmf(flight(tmp_path, [*parts[:-1], parts[-1][:end]]))
        assert velocities(telemetry) == whole[: ROWS - 4]
        assert telemetry.counts == {"damaged telemetry payloads": 1}


def test_fault_2_a_video_cut_within_its_track_gives_what_came_before(tmp_path):
    path, whole, lengths = flight(tmp_path, payloads()), [velocity(k) for k in range(ROWS)], []
    data = path.read_bytes()
    first = data.index(b"DEVC")
    for end in range(first + 1, len(data), 311):
        path.write_bytes(data[:end])
        telemetry = read_gpmf(path)
        found = [] if telemetry is None else velocities(telemetry)
        assert found == whole[: len(found)]
        lengths.append(len(found))
    assert lengths == sorted(lengths)
    assert set(lengths) <= set(range(0, ROWS + 1, 4))  # whole payloads
    assert len(set(lengths)) > 5


def test_fault_2_a_csv_cut_at_any_byte_gives_what_came_before(tmp_path):
    rows = [(k / 4, *velocity(k)) for k in range(12)]
    text = "".join(",".join(map(str, row)) + "\n" for row in rows)
    path, lengths = written(tmp_path, text), []
    data = path.read_bytes()
    for end in range(data.index(b"\n") + 1, len(data) + 1):
        path.write_bytes(data[:end])
        try:
            telemetry = read_telemetry(path)
        except BadInput:
            assert data[:end].count(b"\n") < 2
            continue
        lengths.append(len(telemetry.samples))
        if len(telemetry.samples) > 1:
            assert velocities(telemetry) == [velocity(k) for k in range(lengths[-1])]
            assert bool(telemetry.counts) == (data[end - 1 : end] != b"\n")
    assert lengths == sorted(lengths)
    assert lengths[-1] == 12


# Fault 3


def test_fault_3_500_trashed_payloads_are_refused_or_counted_in_under_twice_the_time(tmp_path):
    part = payloads(4)[0]
    started = time.process_time()
    for _ in range(500):
        streams(part, LNED)
    normal_s, read = time.process_time() - started, 0
    copies = [trashed(part, seed) for seed in range(500)]
    started = time.process_time()
    for copy in copies:
        try:
            read += len(streams(copy, LNED))
        except GpmfError:
            continue
    assert time.process_time() - started < 2 * normal_s
    assert read > 20


def test_fault_3_trashed_payloads_cost_themselves(tmp_path):
    parts = payloads()
    spoilt = [trashed(part, seed) if seed % 3 == 0 else part for seed, part in enumerate(parts)]
    telemetry = read_gpmf(flight(tmp_path, spoilt))
    assert {velocity(k) for at in (1, 2, 4, 5, 7, 8) for k in range(4 * at, 4 * at + 4)} <= set(
        velocities(telemetry)
    )


def test_fault_3_500_trashed_csv_are_refused_or_counted(tmp_path):
    text = "".join(f"{k / 4},{k / 8},2,0.25\n" for k in range(30))
    path, read = written(tmp_path, text), 0
    data = path.read_bytes()
    for seed in range(500):
        path.write_bytes(trashed(data, seed))
        try:
            telemetry = read_telemetry(path)
        except BadInput as error:
            assert "\n" not in str(error)
            continue
        read += 1
        assert np.isfinite(velocities(telemetry)).all()
    assert read > 20


@given(st.binary(max_size=400))
@settings(max_examples=50)
def test_fault_3_any_bytes_are_a_payload_or_refused(data):
    for payload in (data, nest("DEVC", data[: len(data) // 4 * 4]), nest("DEVC", nest("STRM", data))):
        try:
            assert all(np.ndim(stream.values) == 2 for stream in streams(payload, LNED))
        except GpmfError:
            continue


CELLS = st.sampled_from(["0", "1.5", "-2", "nan", "inf", "1e400", "", '"', "x", "9" * 400, "\x00", "\u0663"])


@given(
    st.lists(st.lists(CELLS, max_size=5).map(",".join), max_size=8).map("\n".join),
    st.sampled_from(["", "\n"]),
)
@settings(max_examples=50)
def test_fault_3_any_cells_are_a_csv_or_refused(tmp_path_factory, text, end):
    path = written(tmp_path_factory.getbasetemp(), text + end)
    try:
        telemetry = read_telemetry(path)
    except BadInput as error:
        assert "\n" not in str(error)
        return
    assert np.isfinite(velocities(telemetry)).all()


# Fault 4


@pytest.mark.parametrize("key", [b"DEVC", b"STRM", b"LNED"])
def test_fault_4_a_length_beyond_the_payload_is_refused_before_allocating(key):
    part = bytearray(payloads(4)[0])
    at = part.index(key) + 5  # one byte for the size of a sample, two for their number: 16 MB at most
    part[at : at + 3] = b"\xff\xff\xff"
    tracemalloc.start()
    try:
        with pytest.raises(GpmfError):
            streams(bytes(part), LNED)
        assert tracemalloc.get_traced_memory()[1] < 1 << 20
    finally:
        tracemalloc.stop()


def test_fault_4_a_track_of_2_to_the_31_bytes(tmp_path):
    path = flight(tmp_path, payloads())
    data = bytearray(path.read_bytes())
    at = data.rindex(b"stsz") + 16  # the size of the first payload
    data[at : at + 4] = struct.pack(">L", 2**31 - 1)
    path.write_bytes(data)
    tracemalloc.start()
    try:
        telemetry = read_gpmf(path)
        assert tracemalloc.get_traced_memory()[1] < 32 << 20
    finally:
        tracemalloc.stop()
    assert telemetry is None or len(telemetry.samples) <= ROWS


# Fault 14


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        ((float("nan"), 0, 0), "velocities that are not numbers"),
        ((0, float("-inf"), 0), "velocities that are not numbers"),
        ((0, 0, 1e30), "velocities above 150 m/s"),
    ],
)
def test_fault_14_a_velocity_that_cannot_be_is_counted(tmp_path, bad, reason):
    telemetry = read_gpmf(flight(tmp_path, payloads(each=lambda k: bad if k == 5 else velocity(k))))
    assert velocities(telemetry) == [velocity(k) for k in range(ROWS) if k != 5]
    assert telemetry.counts == {reason: 1}


def test_fault_14_a_velocity_that_hangs_is_counted(tmp_path):
    telemetry = read_gpmf(flight(tmp_path, payloads(each=lambda k: velocity(min(k, 10)))))
    assert len(telemetry.samples) == 10 + 9  # 2 s of it
    assert telemetry.counts == {"stuck velocities": ROWS - 19}


@pytest.mark.parametrize("bad", ["nan", "inf", "-inf", "1e400", "fast"])
def test_fault_14_a_csv_is_refused_with_its_line(tmp_path, bad):
    with pytest.raises(BadInput, match=rf"line 3: expected a finite number for vn_m_s, got '{bad}'"):
        read_telemetry(written(tmp_path, f"0,1,2,3\n0.25,{bad},2,3\n0.5,1,2,3\n"))


def test_fault_14_no_key_is_taken_for_another():
    damaged = nest("DEVC", nest("STRM", klv("LNEX", "f", 4, 1, bytes(4))))
    assert streams(damaged, LNED) == []
