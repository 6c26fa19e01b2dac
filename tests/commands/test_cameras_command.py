"""`flightdepth cameras`, and what `flightdepth run` says of the camera it took."""

import json
import sys
from pathlib import Path

import pytest
from command_flights import SIZE, make_log, make_video

from flightdepth.cli import main
from flightdepth.flight.lenses import known_lenses
from flightdepth.outputs import FlightFolder

sys.path.append(str(Path(__file__).parents[1] / "flight"))
from gopro_files import gopro_video, settings
from photograph_files import photograph


def test_the_table_is_one_line_a_lens(capsys):
    assert main(["cameras"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == [lens.name for lens in known_lenses()]
    assert "71.6 deg" in next(line for line in lines if line.startswith("dji-mini-2 "))


def test_a_video_that_tells_its_camera(tmp_path, capsys):
    path = gopro_video(tmp_path / "v.mp4", settings("HERO10 Black", "L", "Y", "HS EIS"))
    assert main(["cameras", str(path)]) == 0
    said = capsys.readouterr()
    assert "192x108, focal length 100 px; HERO10 Black says Linear" in " ".join(said.out.split())
    assert "electronic stabilisation" in said.err


def test_of_a_video_that_does_not_it_says_what_would_be_asked_for(tmp_path, capsys):
    assert main(["cameras", str(make_video(tmp_path / "v.mp4", frames=2))]) == 0
    said = capsys.readouterr()
    assert said.err == ""
    assert "does not tell its camera; `flightdepth run` would stop" in said.out
    assert "--hfov" in said.out


def test_of_a_log_beside_the_video_it_says_what_run_takes(tmp_path, capsys):
    """It looked inside the video only, and said that `run` would stop."""
    path = make_video(tmp_path / "v.mp4", frames=4)
    told = {"speed_north": 3.0, "speed_east": 0.0, "speed_down": 0.0, "picture_hfov": 90.0}
    frames = [{"time": k * 100_000, "metadata": told} for k in range(4)]
    (tmp_path / "v.json").write_text(json.dumps({"frame": frames}))
    assert main(["cameras", str(path)]) == 0
    assert f"focal length {SIZE / 2:.0f} px" in capsys.readouterr().out


@pytest.fixture
def run(tmp_path, save_difference_network, capsys):
    save_difference_network()
    make_video(tmp_path / "flight.mp4")
    make_log(tmp_path / "log.csv")

    def call(*options):
        out = tmp_path / "out"
        given = ["--telemetry", tmp_path / "log.csv", "--network", tmp_path / "difference.onnx", "--out", out]
        code = main(["run", str(tmp_path / "flight.mp4"), *map(str, [*given, *options])])
        said = capsys.readouterr()
        return code, " ".join(said.out.split()), said.err, out

    return call


def test_run_says_what_it_took_and_how_sure_and_keeps_it(run):
    code, said, _, out = run("--camera", "raspberry-pi-3-wide")
    assert code == 2  # the pictures are square, the sensor is not
    code, said, _, out = run("--hfov", "90")
    assert code == 0
    assert "camera: --hfov 90, an ideal lens" in said
    assert FlightFolder(out).record.source.camera_source == "--hfov 90, an ideal lens"


def test_run_takes_a_photograph(run, tmp_path):
    code, said, _, out = run("--camera", photograph(tmp_path / "p.jpg", 30, size=(300, 300)))
    assert code == 0
    assert "photograph p.jpg by FC7303: 30 mm" in said
    # A square has 0.7071 of its diagonal across.
    focal = SIZE / 2 / (0.70711 * 21.6333 / 30)
    assert FlightFolder(out).record.source.camera.fx == pytest.approx(focal, rel=1e-4)


def test_run_refuses_a_mount_without_the_drones_attitude(run):
    code, _, said, _ = run("--hfov", "90", "--mount-pitch", "0")
    assert code == 2
    assert "attitude of the drone" in said
