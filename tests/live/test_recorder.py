"""Recordings that end before the flight does."""

import errno
import json
import shutil
import threading
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from page_flights import Flying

from flightdepth.errors import BadInput, FlightDepthError
from flightdepth.flight.records import VelocitySample
from flightdepth.live.motion_store import MotionStore
from flightdepth.live.recorder import MISTIMED, Recorder
from flightdepth.outputs import FlightFolder
from flightdepth.outputs import writer as writing
from flightdepth.outputs.film import Film
from flightdepth.outputs.interrupted import keep_interrupted
from flightdepth.outputs.pictures import pictures
from flightdepth.outputs.writer import FlightWriter
from flightdepth.weights.store import find_network, read_card

SETTINGS = {"video": "rtsp://host/path"}


def results(count):
    taken = []
    with Flying() as flying:
        flying.page = SimpleNamespace(take=taken.append)
        for _ in range(count):
            flying.fly()
    return taken


@pytest.fixture
def recorder(tmp_path):
    return Recorder(tmp_path / "recording", read_card(find_network("motion-tiny")), "a link", SETTINGS)


def test_a_disk_that_is_nearly_full_ends_the_recording_and_keeps_it(recorder, tmp_path, monkeypatch):
    first, second, third, fourth = results(4)
    recorder(first)
    recorder(second)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=400 * 10**6))
    with pytest.raises(BadInput, match="expected 500 MB free on its disk, got 400 MB: it ends here"):
        recorder(third)
    recorder(fourth)
    recorder.close({})
    assert len(FlightFolder(tmp_path / "recording").rows) == 2


def test_results_of_another_size_are_left_out_and_stand_in_the_folder(recorder, tmp_path):
    """They were counted on the terminal alone; the folder looked whole."""
    first, second = results(2)
    recorder(first)
    size = (second.camera.width // 2, second.camera.height // 2)
    half = SimpleNamespace(camera=second.camera.resized(*size))
    with pytest.raises(BadInput, match=r"expected pictures of \d+x\d+, as it began, got \d+x\d+: left out"):
        recorder(half)
    recorder.close({"a newer picture came first": 3})
    told = json.loads((tmp_path / "recording" / "flight.json").read_text())["counts"]["dropped"]
    assert told == {"a newer picture came first": 3, "of another size than the first": 1}


def test_frames_have_the_time_of_day_by_this_computers_clock(recorder, tmp_path):
    """Nothing in a recording had one, so it could not be laid beside another of the same flight."""
    first, second = results(2)
    ago_ns = 3_000_000_000
    earliest_ns = time.time_ns() - ago_ns
    now_ns = time.monotonic_ns()
    first = replace(first, stamp_ns=now_ns - ago_ns, ready_ns=now_ns)
    recorder(first)
    latest_ns = time.time_ns() - ago_ns
    recorder(replace(second, stamp_ns=first.stamp_ns + 40_000_000, ready_ns=now_ns))
    recorder.close({})
    folder = FlightFolder(tmp_path / "recording")
    begun, then = (row.utc_ns for row in folder.rows)
    assert earliest_ns - 1_000_000 <= begun <= latest_ns + 1_000_000
    assert then == begun + 40_000_000
    assert {pose.utc_ns for pose in folder.poses.values()} == {begun, then}
    assert folder.record.source.utc.clock == "computer"


def test_a_file_that_is_played_was_filmed_at_another_time(tmp_path):
    card = read_card(find_network("motion-tiny"))
    recorder = Recorder(tmp_path / "recording", card, "a link", SETTINGS, dated=False)
    recorder(results(1)[0])
    recorder.close({})
    folder = FlightFolder(tmp_path / "recording")
    assert folder.rows[0].utc_ns is folder.record.source.utc is None


def test_poses_are_written_where_telemetry_tells_velocity_and_attitude(recorder, tmp_path):
    """A recording had none, so no cloud and no transforms, though the link told all that they need."""
    flown = results(40)
    flown[2] = replace(flown[2], motion=replace(flown[2].motion, world_from_camera=None))
    flown[4] = replace(flown[4], stamp_ns=flown[0].stamp_ns)  # times that step back
    for i in range(10, 30):  # a link that was down for two seconds
        flown[i] = replace(flown[i], motion=replace(flown[i].motion, velocity_ned=None))
    for each in flown:
        recorder(each)
    recorder.close({})
    poses = FlightFolder(tmp_path / "recording").poses
    assert list(poses) == [i for i in range(40) if i not in (2, 4, *range(10, 30))]
    east_m = [pose.position_ned[1] for pose in poses.values()]
    np.testing.assert_allclose(east_m[:8], [0, 0.3, 0.9, 1.5, 1.8, 2.1, 2.4, 2.7], atol=1e-3)
    np.testing.assert_allclose(east_m[8:], 0.3 * np.arange(10), atol=1e-3)
    assert {(pose.segment, pose.attitude) for pose in poses.values()} == {(0, "log"), (1, "log")}
    np.testing.assert_allclose(poses[0].world_from_camera, flown[0].motion.world_from_camera, atol=1e-6)


@pytest.mark.parametrize("future", [0, 2])
def test_one_picture_from_the_future_costs_no_later_one_its_time_or_pose(recorder, tmp_path, future):
    """For as long as it was ahead no frame had a pose; after a first one so all times were below 0."""
    flown = results(20)
    flown[future] = replace(flown[future], stamp_ns=flown[future].stamp_ns + 30 * 10**9)
    for each in flown:
        recorder(each)
    recorder.close({})
    folder, kept = FlightFolder(tmp_path / "recording"), [k for k in range(20) if k != future]
    assert [row.index for row in folder.rows] == list(folder.poses) == kept
    assert [row.stamp_ns for row in folder.rows] == [(k - kept[0]) * 10**8 for k in kept]
    assert folder.record.counts.dropped == {MISTIMED: 1}


@pytest.mark.parametrize(("back_from", "newer_from"), [(1, 13), (3, 15)])
def test_times_in_a_recording_rise_where_the_stream_s_step_back(recorder, tmp_path, back_from, newer_from):
    """As when the sender's clock becomes known: times below 0 ended `convert` to .mcap with a traceback."""
    for k, each in enumerate(results(20)):
        recorder(replace(each, stamp_ns=each.stamp_ns - 1_250_000_000) if k >= back_from else each)
    recorder.close({})
    folder = FlightFolder(tmp_path / "recording")
    kept = [*range(back_from), *range(newer_from, 20)]
    assert [row.index for row in folder.rows] == list(folder.poses) == kept
    assert [row.stamp_ns for row in folder.rows] == [
        k * 10**8 - (1_250_000_000 if k >= back_from else 0) for k in kept
    ]
    assert folder.record.counts.dropped == {MISTIMED: 12}


def test_a_picture_s_time_may_lie_ahead_by_as_much_as_clocks_are_read_apart(recorder, tmp_path):
    for each, ahead_ns in zip(results(2), (10_000_000, 10_000_001), strict=True):
        recorder(replace(each, stamp_ns=each.ready_ns + ahead_ns))
    recorder.close({})
    assert [row.index for row in FlightFolder(tmp_path / "recording").rows] == [0]


@pytest.mark.parametrize(("silent", "segments"), [(14, {0}), (17, {0, 1})])
def test_no_pose_is_summed_across_a_gap_that_run_would_not_bridge(recorder, tmp_path, silent, segments):
    """The velocity before it holds for half a second: gaps of 1.5 to 2 s looked that much shorter."""
    store = MotionStore()
    for i, each in enumerate(results(40)):
        if not 10 < i < 10 + silent:
            store.add(VelocitySample(each.stamp_ns, each.motion.velocity_ned), each.stamp_ns)
        turn = each.motion.world_from_camera
        recorder(replace(each, motion=replace(store.at(each.stamp_ns), world_from_camera=turn)))
    recorder.close({})
    poses = FlightFolder(tmp_path / "recording").poses
    assert {pose.segment for pose in poses.values()} == segments


def test_a_picture_s_own_focal_length_stands_beside_it_where_the_lens_zooms(recorder, tmp_path):
    first, second = results(2)
    recorder(first)
    recorder(replace(second, camera=second.camera.zoomed(2.0)))
    recorder.close({})
    folder = FlightFolder(tmp_path / "recording")
    assert [row.focal_px for row in folder.rows] == [None, pytest.approx(2 * first.camera.fx, abs=1e-3)]
    assert folder.camera(1).fx == pytest.approx(2 * first.camera.fx, rel=1e-5)


def test_a_result_that_a_slow_disk_takes_at_the_end_is_whole(recorder, tmp_path, monkeypatch):
    """`close` waits for it, and what comes after is not written."""
    begun, add = threading.Event(), FlightWriter.add

    def slow(writer, frame, result, pose):
        begun.set()
        threading.Event().wait(0.2)
        add(writer, frame, result, pose)

    monkeypatch.setattr(FlightWriter, "add", slow)
    first, second = results(2)
    writing = threading.Thread(target=recorder, args=[first])
    writing.start()
    begun.wait(10)
    recorder.close({})
    writing.join()
    recorder(second)
    folder = FlightFolder(tmp_path / "recording")
    assert [folder.depth_m(row.index).ndim for row in folder.rows] == [2]


def broken_disk(*_):
    raise OSError(errno.EIO, "Input/output error")


def heard(recorder, flown):
    """What the recorder says of each result."""
    said = Counter()
    for result in flown:
        try:
            recorder(result)
        except FlightDepthError as error:
            said[str(error)] += 1
    return said


def test_a_frame_that_could_not_be_written_is_left_out_and_the_recording_goes_on(
    recorder, tmp_path, monkeypatch
):
    """Found in review: its row stayed, the next frame's maps were lost and its row came twice; nobody could read it."""
    write, wrong = Path.write_bytes, []

    def flaky(path, data):
        if path.parts[-2:] == ("depth", "000004.png") and not wrong:
            wrong.append(path)
            write(path, data[:10])
            broken_disk()
        return write(path, data)

    monkeypatch.setattr(Path, "write_bytes", flaky)
    said = heard(recorder, results(20))
    warnings = recorder.close({})
    assert said == {
        f"recording {tmp_path / 'recording'}: a frame is left out: [Errno 5] Input/output error": 1
    }
    assert "could not be written are left out: [Errno 5] Input/output error" in warnings[0]
    folder = FlightFolder(tmp_path / "recording")
    told = [index for index in range(20) if index != 4]
    assert [row.index for row in folder.rows] == told
    assert [index for index, _ in pictures(folder)] == told  # `view` and `convert` show them
    assert all(folder.depth_m(index).ndim == 2 for index in told)
    assert not list(folder.folder.glob("*/000004.png"))
    assert folder.record.counts.dropped == {"could not be written": 1}
    assert folder.record.source.warnings == (
        "frames that could not be written are left out: [Errno 5] Input/output error",
    )


def test_depth_goes_on_without_a_preview(recorder, tmp_path, monkeypatch):
    monkeypatch.setattr(Film, "add", broken_disk)
    assert not heard(recorder, results(8))
    assert "no preview, which `view` and `convert` need" in recorder.close({})[0]
    folder = FlightFolder(tmp_path / "recording")
    assert [folder.depth_m(row.index).ndim for row in folder.rows] == [2] * 8
    assert not (folder.folder / "preview.mp4").exists()


def test_a_recording_that_cannot_be_finished_is_kept(recorder, tmp_path, monkeypatch):
    """It was removed, though nobody can fly it again."""
    heard(recorder, results(3))
    monkeypatch.setattr(writing, "write_atomic", broken_disk)
    place = tmp_path / "recording.interrupted-1"
    with pytest.raises(FlightDepthError, match=f"Input/output error; what was written stands in {place}"):
        recorder.close({})
    assert len(list((place / "depth").iterdir())) == 3
    assert len((place / "frames.csv").read_text().splitlines()) == 1 + 3
    assert list(tmp_path.iterdir()) == [place]


def test_a_recording_that_runs_is_not_taken_for_a_killed_one(recorder, tmp_path):
    heard(recorder, results(2))
    assert keep_interrupted(tmp_path / "recording") == []
    recorder.close({})
    assert len(FlightFolder(tmp_path / "recording").rows) == 2
