"""`flightdepth evaluate baselines` on the sample flight and on one made by hand."""

import json

import cv2
import numpy as np
import pytest
from command_flights import make_log, make_video
from plain_install import run_without_extras

from flightdepth import cli
from flightdepth.commands.baselines import lengths
from flightdepth.commands.demo import CALIBRATION, LOG, VIDEO
from flightdepth.commands.figures import check_figures, write_figures
from flightdepth.errors import BadInput
from flightdepth.files import refuse_to_replace
from flightdepth.outputs.encoding import rgb_png

SAMPLE = [str(VIDEO), "--telemetry", str(LOG), "--camera", str(CALIBRATION)]


@pytest.fixture
def make(tmp_path, save_difference_network):
    """Run the command on a flight and a network made by hand; (exit code, arguments' folder)."""
    path = save_difference_network()
    video, log = make_video(tmp_path / "flight.mp4"), make_log(tmp_path / "log.csv")

    def call(*arguments, networks=(path,)):
        chosen = [part for each in networks for part in ("--network", str(each))]
        flight = [str(video), "--hfov", "90", "--telemetry", str(log)]
        return cli.main(["evaluate", "baselines", *flight, *chosen, *map(str, arguments)])

    return call


def test_figures_go_neither_into_a_folder_nor_over_a_log(make, tmp_path, capsys):
    assert make("--json", tmp_path) == 2
    assert "--json: expected a file, got the folder" in capsys.readouterr().err
    before = (tmp_path / "log.csv").read_bytes()
    assert make("--json", tmp_path / "log.csv") == 2
    assert "got another file, which it would replace" in capsys.readouterr().err
    assert (tmp_path / "log.csv").read_bytes() == before
    assert make("--picture", tmp_path / "sheet.jpg") == 2
    assert "expected a .png file" in capsys.readouterr().err


@pytest.mark.parametrize(("option", "name"), [("--json", "camera.json"), ("--picture", "photo.png")])
def test_what_flightdepth_did_not_write_is_not_replaced(make, tmp_path, capsys, option, name):
    photo = cv2.imencode(".png", np.zeros((4, 4, 3), np.uint8))[1].tobytes()
    theirs = b'{"fx": 500}' if option == "--json" else photo
    (tmp_path / name).write_bytes(theirs)
    assert make(option, tmp_path / name) == 2
    assert "got another file, which it would replace" in capsys.readouterr().err
    assert (tmp_path / name).read_bytes() == theirs


def test_its_own_figures_and_picture_are_replaced(tmp_path):
    write_figures(tmp_path / "figures.json", {"rows": []})
    check_figures(tmp_path / "figures.json")
    (tmp_path / "sheet.png").write_bytes(rgb_png(np.zeros((4, 4, 3), np.uint8)))
    refuse_to_replace("--picture", tmp_path / "sheet.png")


def test_figures_and_picture_of_the_sample(tmp_path, capsys):
    files = ["--json", str(tmp_path / "figures.json"), "--picture", str(tmp_path / "sheet.png")]
    options = ["--network", "tiny-clamped-256", "--end", "1.2", "--every", "6", "--baselines", "2,1"]
    assert cli.main(["evaluate", "baselines", *SAMPLE, *options, *files]) == 0
    said = capsys.readouterr().out
    assert "36 frames" in said
    assert "told by the log" in said
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert (figures["flight"], figures["start_s"], figures["end_s"]) == (VIDEO.name, None, 1.2)
    assert figures["camera"]
    assert figures["networks"][0]["weights_sha256"]
    for what, methods in (("photometric", 3), ("agreement", 2), ("slope", 2)):
        assert len({row["method"] for row in figures[what]}) == methods
    shares = {row["method"]: row["error_share"]["mean"] for row in figures["photometric"]}
    assert shares["classical peer"] < shares["best constant"] < 1
    assert [row["baselines_m"] for row in figures["agreement"]] == [[1, 2], [1, 2]]
    assert cv2.imread(str(tmp_path / "sheet.png")).std() > 10


def test_a_table_without_figures_has_dashes(make, capsys):
    """Eight centimetres in all are flown: no baseline of 5 m, no slope."""
    assert make("--baselines", "5") == 0
    said = capsys.readouterr().out
    assert "pairs: 0 over 5 m" in said
    assert "no earlier frame within 20% of 5 m" in said


def test_no_figure_is_no_number_in_the_file(make, tmp_path):
    assert make("--baselines", "5", "--json", tmp_path / "figures.json") == 0
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert {row["median"] for row in figures["slope"]} == {None}


def test_it_needs_no_extra():
    """It ended in a traceback, for want of numba."""
    words = ["evaluate", "baselines", VIDEO, "--telemetry", LOG, "--camera", CALIBRATION]
    done = run_without_extras([*words, "--network", "motion-tiny", "--baselines", "1", "--end", "0.5"])
    assert done.returncode == 0, done.stderr


def test_networks_of_one_name_are_refused(make, save_difference_network, capsys):
    path = save_difference_network()
    assert make(networks=(path, path)) == 2
    assert "different names" in capsys.readouterr().err


def test_networks_of_two_focal_lengths_are_refused(make, save_difference_network, capsys):
    paths = [save_difference_network(name=f"f{focal}", focal_px=focal) for focal in (32.0, 64.0)]
    assert make(networks=paths) == 2
    assert "one focal length" in capsys.readouterr().err


@pytest.mark.parametrize("option", ["--json", "--picture"])
def test_a_folder_that_is_not_there_is_refused_first(make, tmp_path, capsys, option):
    assert make(option, tmp_path / "nowhere" / "file") == 2
    assert option in capsys.readouterr().err


@pytest.mark.parametrize("text", ["", "one", "0", "-1,2", "nan", "inf,1"])
def test_lengths_that_are_none(text):
    with pytest.raises(BadInput, match="baselines"):
        lengths(text)


def test_lengths_rise():
    assert lengths("2,0.5, 1,1") == (0.5, 1.0, 2.0)
