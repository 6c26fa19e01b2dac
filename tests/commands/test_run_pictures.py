"""`flightdepth run` of a folder of pictures, beside the video that they come from."""

import json

import cv2
import numpy as np
import pytest
from command_flights import FRAMES, make_log, make_video

from flightdepth.cli import main
from flightdepth.flight.video import Video
from flightdepth.outputs import FlightFolder


@pytest.fixture
def work(tmp_path, save_difference_network):
    """A video, its pictures in the folder `pictures`, a log beside each, and a network."""
    save_difference_network()
    (tmp_path / "pictures").mkdir()
    with Video(make_video(tmp_path / "flight.mp4")) as video:
        for frame in video.frames():
            path = tmp_path / "pictures" / f"left_{frame.index}.png"
            assert cv2.imwrite(str(path), frame.image[..., ::-1])
    for name in ("flight", "pictures"):
        make_log(tmp_path / f"{name}.csv")
    return tmp_path


@pytest.fixture
def run(work, capsys, monkeypatch):
    """Run the command where the flights lie, into `out` there; (exit code, stdout, stderr)."""
    monkeypatch.chdir(work)

    def call(flight, *arguments, out="out"):
        options = ["--hfov", "90", "--network", work / "difference.onnx", "--out", work / out, *arguments]
        code = main(["run", flight, *map(str, options)])
        return code, *capsys.readouterr()

    return call


def test_pictures_of_a_video_have_its_depth(run, work):
    assert run("flight.mp4", "--depth-format", "npz", out="video")[0] == 0
    assert run("pictures", "--rate", 30, "--depth-format", "npz", out="pictures_out")[0] == 0
    video, pictures = FlightFolder(work / "video"), FlightFolder(work / "pictures_out")
    assert len(pictures.rows) == FRAMES
    assert sum(not row.reason for row in pictures.rows) > FRAMES / 2
    for ours, theirs in zip(pictures.rows, video.rows, strict=True):
        assert abs(ours.stamp_ns - theirs.stamp_ns) <= 1
        assert (ours.shifts, ours.reason) == (theirs.shifts, theirs.reason)
        depths = pictures.depth_m(ours.index), video.depth_m(theirs.index)
        assert np.allclose(*depths, rtol=1e-5, equal_nan=True)


def test_each_row_names_its_picture_and_a_video_has_none(run, work):
    run("pictures", "--rate", 30, "--start", 0.1)
    assert [row.picture for row in FlightFolder(work / "out").rows][:3] == [
        "left_3.png",
        "left_4.png",
        "left_5.png",
    ]
    record = json.loads((work / "out" / "flight.json").read_text())
    assert (record["source"]["flight"], record["source"]["settings"]["rate"]) == ("pictures", 30)
    run("flight.mp4")
    assert {row.picture for row in FlightFolder(work / "out").rows} == {""}


def test_the_folder_where_one_is_has_a_name(run, work, monkeypatch):
    monkeypatch.chdir(work / "pictures")
    assert run(".", "--rate", 30)[0] == 0
    assert FlightFolder(work / "out").record.source.flight == "pictures"


def test_pictures_that_are_missing_are_told(run, work):
    (work / "pictures" / "left_7.png").unlink()
    (work / "pictures" / "left_9.png").write_bytes(b"")
    _, stdout, _ = run("pictures", "--rate", 30)
    assert "1 dropped: pictures whose numbers are left out" in stdout
    assert "1 dropped: pictures that are damaged or cannot be read" in stdout


@pytest.mark.parametrize(
    ("flight", "arguments", "words"),
    [
        ("pictures", [], "--rate HZ"),
        ("pictures", ["--rate", "0"], "expected 0.001 to 10000 Hz"),
        ("flight.mp4", ["--rate", "30"], "--rate: expected a folder of pictures"),
        ("pictures", ["--rate", "30", "--out", "pictures"], "output folder"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(run, flight, arguments, words):
    code, _, stderr = run(flight, *arguments)
    assert code == 2
    assert words in stderr
    assert len(stderr.splitlines()) == 1


def test_cameras_takes_a_folder(work, capsys):
    assert main(["cameras", str(work / "pictures"), "--rate", "30"]) == 0
    assert "does not tell its camera" in capsys.readouterr().out
    assert main(["cameras", "--rate", "30"]) == 2


@pytest.mark.parametrize("command", ["tracks", "baselines"])
def test_evaluate_takes_a_folder_and_its_rate(work, capsys, command):
    def told(flight, *rate):
        assert main(["evaluate", command, str(work / flight), "--hfov", "90", *rate]) == 2
        return capsys.readouterr().err

    assert "--rate HZ" in told("pictures")
    assert "--rate: expected a folder of pictures" in told("flight.mp4", "--rate", "30")
    assert "--start" in told("pictures", "--rate", "30", "--start", "9")
