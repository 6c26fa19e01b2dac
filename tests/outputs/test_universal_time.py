"""Universal time in what a run writes: tables, flight.json, and recordings that ask for it."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from flown_folder import FRAMES, LOOKING_NORTH, picture, pose, write_flown
from hypothesis import given
from hypothesis import strategies as st
from output_samples import HEIGHT, SOURCE, WIDTH, csv_text, frame, known, unknown
from rosbags.highlevel import AnyReader

from flightdepth.cli import main
from flightdepth.flight import VelocitySample
from flightdepth.flight.universal_time import UniversalTime
from flightdepth.outputs import FlightFolder, FlightWriter, Preview
from flightdepth.outputs.frame_table import COLUMNS as FRAME_COLUMNS
from flightdepth.outputs.frame_table import FrameRow, cells_of, rows_from_csv
from flightdepth.outputs.poses import COLUMNS, FramePose, PoseTrack, pose_cells, poses_from_csv

TEXT = (Path(__file__).parents[2] / "docs" / "telemetry.md").read_text(encoding="utf-8")
(SNIPPET,) = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
UTC = UniversalTime(1_777_627_800_250_000_007, "satellites")  # a float would round it to 256 ns


@pytest.fixture(scope="module")
def work(tmp_path_factory):
    """`out` knows universal time, `silent` does not."""
    folder = tmp_path_factory.mktemp("work")
    source = SOURCE.model_copy(update={"utc": UTC})
    with FlightWriter(folder / "out", source, Preview(WIDTH, HEIGHT)) as writer:
        for i in range(FRAMES):
            at = replace(pose(i, 0.5 * i), utc_ns=UTC.at(i * 100_000_000))
            writer.add(picture(i), known(20) if i else unknown("first frame"), at)
    write_flown(folder / "silent")
    return folder


def test_each_frame_has_its_time(work):
    flight = FlightFolder(work / "out")
    assert [row.utc_ns for row in flight.rows] == [
        1_777_627_800_250_000_007 + i * 100_000_000 for i in range(FRAMES)
    ]
    assert {i: pose.utc_ns for i, pose in flight.poses.items()} == {
        row.index: row.utc_ns for row in flight.rows
    }


def test_the_record_tells_time_0_and_whose_clock_told_it(work):
    told = json.loads((work / "out" / "flight.json").read_text())["source"]["utc"]
    assert told == {"ns_at_zero": 1_777_627_800_250_000_007, "clock": "satellites"}
    assert FlightFolder(work / "out").record.source.utc == UTC


def test_a_flight_whose_log_tells_none_leaves_its_cells_empty(work):
    flight = FlightFolder(work / "silent")
    assert flight.record.source.utc is None
    assert {row.utc_ns for row in flight.rows} == {pose.utc_ns for pose in flight.poses.values()} == {None}


@given(st.integers(0, 2**62), st.integers(0, 2**40))
def test_times_come_back_to_the_nanosecond(ns_at_zero, stamp_ns):
    utc = UniversalTime(ns_at_zero, "computer")
    row = replace(FrameRow.of(frame(), unknown(), utc), stamp_ns=stamp_ns, utc_ns=utc.at(stamp_ns))
    assert rows_from_csv(csv_text(FRAME_COLUMNS, cells_of(row)))[0].utc_ns == ns_at_zero + stamp_ns
    at = FramePose(0, stamp_ns, 0, np.zeros(3), LOOKING_NORTH, "log", utc_ns=utc.at(stamp_ns))
    assert poses_from_csv(csv_text(COLUMNS, pose_cells(at)))[0].utc_ns == ns_at_zero + stamp_ns


def test_tables_of_older_versions_tell_none():
    at = pose(0, 1.0)
    assert poses_from_csv(csv_text(COLUMNS[:14], pose_cells(at)[:14]))[0].utc_ns is None
    row = FrameRow.of(frame(), unknown())
    assert rows_from_csv(csv_text(FRAME_COLUMNS[:-1], cells_of(row)[:-1]))[0].utc_ns is None


def test_a_track_of_poses_has_the_times_of_its_frames():
    track = PoseTrack(utc=UTC)
    for i in range(3):
        track.add(VelocitySample(i * 100_000_000, [1.0, 0, 0]))
    assert track.at(frame(1), unknown()).utc_ns == 1_777_627_800_250_000_007 + 33_366_667


def stamps(path):
    """(of the recording, of the header) of each message that has one, ns."""
    with AnyReader([path]) as reader:
        for connection, stamp_ns, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            header = message.transforms[0].header if hasattr(message, "transforms") else message.header
            yield connection.topic, stamp_ns, header.stamp.sec * 10**9 + header.stamp.nanosec


def test_a_recording_in_universal_time(work, capsys):
    """The same messages as without, each so much later."""
    for name, options in (("plain.mcap", []), ("utc.mcap", ["--utc"])):
        assert main(["convert", str(work / "out"), str(work / name), *options]) == 0
    plain, moved = list(stamps(work / "plain.mcap")), list(stamps(work / "utc.mcap"))
    assert len(moved) > 3 * FRAMES
    assert moved == [(topic, UTC.at(at), UTC.at(header)) for topic, at, header in plain]
    assert min(header for _, _, header in plain) == 0


@pytest.mark.parametrize(
    ("folder", "name", "words"),
    [
        ("silent", "a.mcap", "--utc: expected a flight whose log tells universal time, got none."),
        ("out", "a.ply", "--utc: expected a FILE that ends in .mcap or .tum, got one that ends in .ply"),
    ],
)
def test_universal_time_that_cannot_be_is_refused(work, capsys, folder, name, words):
    assert main(["convert", str(work / folder), str(work / name), "--utc"]) == 2
    assert words in " ".join(capsys.readouterr().err.split())
    assert not (work / name).exists()


def test_the_docs_snippet_compares_poses_with_a_truth(work, monkeypatch):
    """Both fly 5 m/s north; the truth's axes begin elsewhere, and it began to log 3 s earlier."""
    since_s = np.arange(-3, 3, 0.5)
    rows = [f"{UTC.ns_at_zero / 1e9 + s:.6f},{100 + 5 * s},7,-30" for s in since_s.tolist()]
    (work / "rtk.csv").write_text("\n".join(["utc_s,north_m,east_m,down_m", *rows]) + "\n")
    monkeypatch.chdir(work)
    names: dict = {}
    exec(SNIPPET, names)
    assert names["off_m"].shape == (FRAMES, 3)
    assert np.abs(names["off_m"]).max() < 1e-4
    assert names["truth_ned"][0] == pytest.approx((100, 7, -30), abs=1e-4)
