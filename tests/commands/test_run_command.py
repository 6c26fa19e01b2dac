"""`flightdepth run` from end to end, with a network made by hand."""

import errno
import os
from pathlib import Path

import numpy as np
import pytest
from command_flights import FRAMES, SIZE, make_log, make_video

from flightdepth.camera import Camera
from flightdepth.cli import main
from flightdepth.commands.run import refuse_logs
from flightdepth.commands.run_settings import RunSettings
from flightdepth.commands.single_flight import closer
from flightdepth.errors import BadInput
from flightdepth.files import folder_in_progress
from flightdepth.flight.telemetry import is_log
from flightdepth.outputs import FlightFolder, FlightWriter
from flightdepth.outputs.interrupted import RECORDING
from flightdepth.ranges.direction import SeenDirections
from flightdepth.runtimes.network import load_network


@pytest.fixture
def work(tmp_path, save_difference_network):
    """A folder with video, log and network."""
    save_difference_network()
    make_video(tmp_path / "flight.mp4")
    make_log(tmp_path / "log.csv")
    return tmp_path


@pytest.fixture
def run(work, capsys):
    """Run the command; (exit code, stdout, stderr)."""

    def call(*arguments, video="flight.mp4", hfov="90", log="log.csv", network="difference.onnx"):
        options = [
            ("--hfov", hfov),
            ("--telemetry", log and work / log),
            ("--network", network and work / network),
        ]
        given = [str(part) for option in options if option[1] is not None for part in option]
        code = main(
            ["run", str(work / video), *given, "--out", str(work / "made" / "out"), *map(str, arguments)]
        )
        return code, *capsys.readouterr()

    return call


def refused(outcome, work, *words):
    """One line on stderr that holds `words`, exit code 2, and no output folder."""
    code, _, stderr = outcome
    assert code == 2
    assert len(stderr.splitlines()) == 1
    assert stderr.startswith("error: ")
    assert [word for word in words if word not in stderr] == []
    assert not (work / "made").exists()


# What it does


@pytest.mark.parametrize(
    ("hfov", "advice"),
    [("90", "expect coarse depth; `--network motion` looks closer"), ("150", "expect coarse depth")],
    ids=["the video is finer", "it has no more pixels"],
)
def test_who_is_warned_of_a_narrow_picture_hears_what_helps(run, hfov, advice):
    """A DepthNet was told to take `--detail 2`, which it refuses."""
    _, _, stderr = run(hfov=hfov)
    assert " ".join(stderr.split()).endswith(advice)


def test_a_network_for_any_lens_may_look_closer_by_itself(save_difference_network):
    network = load_network(save_difference_network(any_lens=True))
    assert closer(network, Camera.from_fov(128, 128, 90)) == "; `--detail 2` looks closer"


def test_velocities_that_are_faster_than_the_positions_move_are_told(run, work):
    """Depth of a Karma was 3 to 11 % too far, and only a cloud on the Earth told so."""
    rows = [f"{t / 10:.1f},0.0,66.0,0.0,48.0,{11 + t * 6.0 / 74625:.9f}" for t in range(8)]
    header = "time_s,vn_m_s,ve_m_s,vd_m_s,latitude_deg,longitude_deg"
    (work / "log.csv").write_text("\n".join([header, *rows]) + "\n")
    _, _, stderr = run()
    told = "the way by the log's velocities is 10.0 % longer than the log's positions tell"
    assert told in " ".join(stderr.split())
    assert any(line.startswith(told) for line in FlightFolder(work / "made/out").record.source.warnings)


def test_a_flight_gives_depth(run, work):
    code, stdout, _ = run()
    assert code == 0
    folder = FlightFolder(work / "made/out")
    assert len(folder.rows) == FRAMES
    assert folder.record.counts.frames_with_depth > FRAMES / 2
    depth_m = folder.depth_m(FRAMES - 1)
    assert depth_m.shape == (SIZE, SIZE)
    assert np.isfinite(depth_m).any()
    assert f"{FRAMES} frames in" in stdout
    assert "preview.mp4" in stdout
    assert "error bar" not in stdout  # this network tells none


def test_it_says_both_sizes_and_warns_of_a_narrow_input(run, work):
    _, stdout, stderr = run()
    (warned,) = FlightFolder(work / "made/out").record.source.warnings
    assert warned.startswith("the network sees only 64 px across")
    assert "128x128, focal length 64 px -> difference at 64x64" in " ".join(stdout.split())
    assert stderr.startswith("warning: the network sees only 64 px across")
    assert len(stderr.splitlines()) == 1


def test_constant_speed_needs_no_log(run, work):
    assert run("--speed", "3", log=None)[0] == 0
    folder = FlightFolder(work / "made/out")
    assert "constant speed of 3 m/s" in folder.record.source.telemetry
    assert not folder.poses  # nobody knows which way


def test_a_log_of_a_speed_alone_is_flown_as_that_speed(run, work):
    (work / "speeds.csv").write_text("time_s,speed_m_s\n0,3\n1,3\n2,3\n")
    assert run(log="speeds.csv")[0] == 0
    by_log = FlightFolder(work / "made/out")
    assert "CSV speeds.csv: speed, any direction" in by_log.record.source.telemetry
    assert not by_log.poses  # nobody knows which way
    depth_m = by_log.depth_m(FRAMES - 1)
    assert run("--speed", "3", log=None)[0] == 0
    assert np.array_equal(depth_m, FlightFolder(work / "made/out").depth_m(FRAMES - 1), equal_nan=True)


def test_part_of_a_flight(run, work):
    assert run("--start", "0.2", "--end", "0.4")[0] == 0
    rows = FlightFolder(work / "made/out").rows
    assert len(rows) == 6
    assert rows[0].stamp_ns == pytest.approx(0.2e9, abs=1e6)


def test_npz_keeps_float32(run, work):
    assert run("--depth-format", "npz")[0] == 0
    assert FlightFolder(work / "made/out").depth_m(FRAMES - 1).dtype == np.float32


def test_the_settings_are_recorded(run, work):
    assert run("--ranges", "3", "--fusion", "paper", "--preview-ranges")[0] == 0
    settings = FlightFolder(work / "made/out").record.source.settings
    assert (settings["ranges"], settings["fusion"], settings["preview_ranges"]) == (3, "paper", True)


def test_the_table_names_the_network_of_each_frame(run, work):
    assert run()[0] == 0
    rows = FlightFolder(work / "made/out").rows
    assert {row.network for row in rows if not row.reason} == {"difference"}
    assert {row.network for row in rows if not row.shifts} == {""}


def test_a_fallback_takes_the_frames_without_a_direction(run, work, monkeypatch, save_difference_network):
    """A velocity in the world's axes, no attitude, and no direction in the pictures."""
    monkeypatch.setattr(SeenDirections, "_seen", lambda self, through, world_m, current: None)
    given = {"network": None, "video": "flight.mp4"}
    assert run("--network", "motion-tiny", **given)[0] == 3  # no frame has depth
    assert FlightFolder(work / "made/out").record.counts.frames_with_depth == 0
    save_difference_network(name="spare")
    code, stdout, _ = run("--network", "motion-tiny", "--fallback", work / "spare.onnx", **given)
    assert code == 0
    folder = FlightFolder(work / "made/out")
    assert {row.network for row in folder.rows if not row.reason} == {"spare"}
    assert folder.record.counts.frames_with_depth > FRAMES / 2
    assert "depth by spare" in " ".join(stdout.split())


def test_a_stopped_run_says_what_stands(run, work, monkeypatch):
    assert run()[0] == 0
    stood = {path: path.read_bytes() for path in (work / "made").rglob("*") if path.is_file()}

    def stopped(self, frame, result, pose=None):
        raise KeyboardInterrupt

    monkeypatch.setattr(FlightWriter, "add", stopped)
    code, _, stderr = run()
    assert code == 130
    assert "stopped: nothing of this flight was written" in stderr
    assert {path: path.read_bytes() for path in (work / "made").rglob("*") if path.is_file()} == stood


@pytest.fixture
def full_disk(monkeypatch):
    """A disk that takes no frame."""

    def full(self, frame, result, pose=None):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(FlightWriter, "add", full)


def test_a_full_disk_says_what_to_do(run, work, full_disk):
    """Once all that was said was `[Errno 28] No space left on device`."""
    code, _, stderr = run()
    assert code == 3
    assert stderr.splitlines()[-1] == (
        f"error: no room left on the disk of {work / 'made/out'}; nothing of this flight was written."
        " Free some room and give the same command again"
    )


def test_a_full_disk_names_each_flight_that_had_no_room(run, work, full_disk):
    second = make_video(work / "second.mp4", frames=8)
    code, _, stderr = run(second, "--speed", "3", log=None)
    assert code == 3
    assert all(f"disk of {work / 'made/out' / name};" in stderr for name in ("flight", "second"))


def test_an_offset_that_the_pictures_do_not_tell_is_said_once(run):
    _, stdout, stderr = run("--telemetry-offset", "auto")
    assert stderr.count("--telemetry-offset auto: unknown") == 1
    assert "offset between video and log" not in stdout


@pytest.mark.parametrize("name", ["motion", "nowhere.onnx"])
def test_a_fallback_that_needs_a_direction_or_does_not_exist_is_refused(run, work, name):
    refused(run("--network", "motion", "--fallback", name, network=None), work, name)


@pytest.mark.parametrize("option", [["--fallback", "depthnet-256"], ["--no-align"]], ids=" ".join)
def test_options_that_would_do_nothing_with_this_network_are_refused(run, work, option):
    """The network of these tests is a DepthNet."""
    refused(run(*option), work, f"{option[0]}: expected a network")


def test_detail_is_for_networks_for_any_lens(run, work):
    refused(run("--detail", "2"), work, "one focal length")
    code, stdout, _ = run("--network", "motion-tiny", "--detail", "0.5", network=None)
    assert code == 0
    shares = [row.sigma_share for row in FlightFolder(work / "made/out").rows if not row.reason]
    told = f"error bar: {np.median(shares):.1%} of the depth in the median, meant to hold two errors in three"
    assert told in " ".join(stdout.split())
    assert FlightFolder(work / "made/out").record.source.network.focal_px == 64


def test_bytes_need_a_card_that_knows_their_ranges(run, work):
    """The network of these tests has none; the shipped one runs."""
    refused(run("--precision", "int8"), work, "holds no ranges")
    assert run("--network", "tiny-clamped-256", "--precision", "int8", network=None)[0] == 0
    assert FlightFolder(work / "made/out").record.source.settings["precision"] == "int8"


def test_several_flights_get_a_folder_each(run, work):
    second = make_video(work / "second.mp4", frames=8)
    assert run(second, "--speed", "3", log=None)[0] == 0
    assert len(FlightFolder(work / "made/out/flight").rows) == FRAMES
    assert len(FlightFolder(work / "made/out/second").rows) == 8


def test_a_bad_flight_does_not_stop_the_next(run, work):
    second = make_video(work / "second.mp4", frames=8)
    code, _, stderr = run(second, "--speed", "3", log=None, video="nowhere.mp4")
    assert code == 2
    assert "nowhere.mp4" in stderr
    assert [path.name for path in (work / "made/out").iterdir()] == ["second"]


# What it refuses


def test_a_missing_video(run, work):
    refused(run(video="nowhere.mp4"), work, "nowhere.mp4", "no such file")


def test_a_place_that_cannot_be_written_is_refused_before_any_work(run, work):
    outcome = run("--out", work / "log.csv" / "out")
    refused(outcome, work, "log.csv/out", "a place to write", "Not a directory")
    assert outcome[1] == ""


def test_a_name_that_is_not_utf_8(run, work):
    """It was flown, and then ended in a traceback of what writes flight.json."""
    name = os.fsdecode(b"fl\xfcg.mp4")
    (work / "flight.mp4").rename(work / name)
    refused(run(video=name), work, "expected a name in UTF-8", "Rename it.")


@pytest.mark.parametrize("option", ["telemetry", "camera"])
def test_a_log_or_a_calibration_whose_name_is_not_utf_8(option):
    """A traceback, and of several flights the first was flown for nothing."""
    with pytest.raises(
        BadInput, match=rf"^--{option} 'h\\udcf6he': expected a name in UTF-8, got another. Rename"
    ):
        RunSettings(**{option: Path(os.fsdecode(b"h\xf6he"))})


@pytest.mark.parametrize("option", ["telemetry", "camera", "mask", "network"])
def test_a_folder_whose_name_is_not_utf_8_is_recorded_with_escapes(option):
    path = Path(os.fsdecode(b"fl\xfcge"), "a")
    given = str(path) if option == "network" else path
    assert RunSettings(**{option: given}).for_record[option] == str(Path(r"fl\udcfcge", "a"))


def test_an_empty_video(run, work):
    (work / "empty.mp4").touch()
    refused(run(video="empty.mp4"), work, "empty.mp4", "empty file")


def test_a_text_in_place_of_a_video(run, work):
    refused(run(video="log.csv"), work, "log.csv", "text file", "--telemetry")


def test_a_truncated_video(run, work):
    video = (work / "flight.mp4").read_bytes()
    (work / "cut.mp4").write_bytes(video[: len(video) // 2])
    refused(run(video="cut.mp4"), work, "cut.mp4", "cut off")


def test_a_missing_log(run, work):
    refused(run(log="nowhere.csv"), work, "nowhere.csv")


def test_an_empty_log(run, work):
    (work / "empty.csv").touch()
    refused(run(log="empty.csv"), work, "empty.csv")


def test_a_text_in_place_of_a_log(run, work):
    (work / "text.csv").write_text("Dear diary,\ntoday we flew along the cliff.\n")
    refused(run(log="text.csv"), work, "text.csv", "time_s")


def test_a_video_in_place_of_a_log(run, work):
    refused(run(log="flight.mp4"), work, "flight.mp4")


def test_a_log_of_another_time(run, work):
    make_log(work / "later.csv", ["900.0,0,3,0", "901.0,0,3,0"])
    refused(run(log="later.csv"), work, "later.csv", "900.000 s")


def test_a_velocity_that_is_no_number(run, work):
    make_log(work / "nan.csv", ["0.0,0,3,0", "0.3,nan,3,0", "0.9,0,3,0"])
    refused(run(log="nan.csv"), work, "nan.csv", "nan")


def test_no_velocity_at_all(run, work):
    refused(run(log=None), work, "velocity", "--telemetry", "--speed")


def test_an_unknown_network(run, work):
    refused(run(network="alexnet"), work, "alexnet", "network")


def test_a_pickle_in_place_of_a_network(run, work):
    (work / "weights.pth").write_bytes(b"\x80\x04")
    refused(run(network="weights.pth"), work, "weights.pth", "pickle")


def test_no_focal_length(run, work):
    """Nothing said that there is a table of lenses."""
    refused(run(hfov=None), work, "focal length", "--hfov", "--camera NAME", "`flightdepth cameras`")


def test_a_camera_file_without_a_focal_length(run, work):
    (work / "camera.json").write_text('{"width": 128, "height": 128}')
    refused(run("--camera", work / "camera.json", hfov=None), work, "camera.json", "focal length")


@pytest.mark.parametrize("ranges", ["0", "5", "-1"])
def test_a_number_of_ranges_that_cannot_be(run, work, ranges):
    code, _, stderr = run("--ranges", ranges)
    assert code == 2
    assert stderr.splitlines()[-1] == f"error: ranges: expected 1 to 4, got {ranges}"
    assert not (work / "made").exists()


def test_one_log_for_several_flights(run, work):
    refused(run(work / "flight.mp4"), work, "--telemetry", "2 flights")


@pytest.mark.parametrize("videos", [1, 2])
def test_a_log_among_the_flights_is_refused_before_any_is_flown(run, work, videos):
    """The first was flown to its end before the log was found to be no video."""
    more = ["flight.mp4", "log.csv"][2 - videos :]
    outcome = run(*(work / name for name in more), log=None)
    mend = f"--telemetry {work / 'log.csv'}" if videos == 1 else "A log beside each video"
    refused(outcome, work, "log.csv", "a video", mend)
    assert outcome[1] == ""


def test_a_folder_of_pictures_that_looks_like_a_bag_is_a_flight(tmp_path):
    """Any `metadata.yaml` among the pictures made a log of it."""
    (tmp_path / "metadata.yaml").write_text("camera: x\n")
    assert is_log(tmp_path)
    refuse_logs([tmp_path, tmp_path])


def test_a_folder_that_another_run_is_writing(run, work):
    """Found in review: two flights without --out, in two windows: whichever ended last replaced the other's depth."""
    with folder_in_progress(work / "made/out", kind=RECORDING):
        code, _, stderr = run()
    assert code == 2
    assert "no other run or recording that writes it" in stderr.splitlines()[-1]


def test_a_folder_that_holds_something_else(run, work, capsys):
    (work / "made/out").mkdir(parents=True)
    (work / "made/out/holiday.jpg").write_bytes(b"precious")
    code, _, stderr = run()
    assert code == 2
    assert "holiday.jpg" in stderr.splitlines()[-1]
    assert (work / "made/out/holiday.jpg").read_bytes() == b"precious"
