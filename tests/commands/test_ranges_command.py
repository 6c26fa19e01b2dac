"""`flightdepth evaluate ranges`: a study of two methods and one short sequence, its files, and what is refused."""

import json
import shlex
from pathlib import Path

import pytest

pytest.importorskip("plotly", reason="needs flightdepth[report]")

from flightdepth import cli
from flightdepth.commands.ranges import table
from flightdepth.evaluation import ranges_study, ranges_trials
from flightdepth.evaluation.ranges_trials import CONSTANT, FLOW, Telemetry, Trial, named
from flightdepth.scenes import Textures

TEXT = (Path(__file__).parents[2] / "docs" / "ranges.md").read_text(encoding="utf-8")
COMMANDS = [line for line in TEXT.splitlines() if line.startswith("flightdepth ")]
TRIALS = (Trial(FLOW, 1), Trial(FLOW, 2), Trial(CONSTANT, 0))


def few_trials(sweeps=(), *, quick=False, networks=()):
    """One more where a sweep is asked for, and the figure alone where time is short."""
    swept = tuple(Trial(FLOW, 1, telemetry=Telemetry(bias=0.1)) for name in sweeps if name == "speed")
    return (TRIALS[:1] if quick else TRIALS) + swept + named(networks)


@pytest.fixture(autouse=True)
def small(monkeypatch):
    """Methods that need no network, and few textures."""
    monkeypatch.setattr(ranges_trials, "all_trials", few_trials)
    monkeypatch.setattr(ranges_study, "test_textures", lambda: Textures.procedural(4, 0))


def call(*arguments):
    return cli.main(["evaluate", "ranges", *map(str, arguments)])


def test_figures_and_page(tmp_path, capsys):
    assert call("--out", tmp_path, "--scenes", 1, "--frames", 34) == 0
    said = capsys.readouterr().out
    assert "flights of 34 frames: 3; sequences to render: 1" in said
    assert "DIS flow, n = 2" in said
    assert "best constant depth" in said
    figures = json.loads((tmp_path / "ranges.json").read_text())
    assert [row["label"] for row in figures["trials"]] == [trial.label for trial in TRIALS]
    assert figures["about"]["sequences"]["frames"] == 34
    assert len(figures["examples"]) == 1
    page = (tmp_path / "ranges.html").read_text()
    assert 'id="plot-time"' in page
    assert 'id="plot-noise"' not in page
    assert "data:image/jpeg" in page


def test_a_network_of_ones_own_flies_beside_the_others(tmp_path, save_difference_network, capsys):
    """It had to be written into the installed package's weights."""
    path = save_difference_network(name="mine", focal_px=128.0)
    few = ("--out", tmp_path, "--scenes", 1, "--frames", 34)
    assert call(*few, "--network", path) == 0
    said = capsys.readouterr().out.replace("\n", "")
    assert "flights of 34 frames: 6;" in said
    figures = json.loads((tmp_path / "ranges.json").read_text())
    assert [row["trial"]["ranges"] for row in figures["trials"] if row["trial"]["method"] == str(path)] == [
        1,
        2,
        2,
    ]
    assert f"{path}, n = 2" in (tmp_path / "ranges.html").read_text()
    assert call(*few, "--network", tmp_path / "none.onnx") == 2
    assert "expected a path to an ONNX file" in capsys.readouterr().err


def test_a_time_that_is_not_defined_is_a_dash():
    """Of no predicted frame there is none; the table ended in a TypeError."""
    trial, nothing = Trial(FLOW, 1), {"abs_rel": {"mean": None}}
    errors = dict.fromkeys(("all", "near", "middle", "far"), nothing)
    row = {"trial": trial.facts, "label": trial.label, "errors": errors, "predict_ms": None}
    shown = table({"trials": [row]})
    assert [list(column.cells) for column in shown.columns] == [[trial.label], *[["-"]] * 5]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sweeps", "rows"),
    [((), 1), (("--sweep", "speed"), 2), (("--sweep", "all"), 2), (("--sweep", "noise"), 1)],
)
def test_quick_is_less_and_a_sweep_is_more(tmp_path, sweeps, rows):
    assert call("--out", tmp_path, "--scenes", 1, "--frames", 33, "--quick", *sweeps) == 0
    assert len(json.loads((tmp_path / "ranges.json").read_text())["trials"]) == rows


def test_a_sweep_that_is_none_is_refused(tmp_path, capsys):
    assert call("--out", tmp_path, "--sweep", "weather") == 2
    assert "telemetry" in capsys.readouterr().err


@pytest.mark.parametrize(("option", "value"), [("--scenes", 0), ("--frames", 32)])
def test_too_little_is_refused(tmp_path, capsys, option, value):
    assert call("--out", tmp_path, option, value) == 2
    assert "expected at least" in capsys.readouterr().err


def test_a_file_for_a_folder_is_refused(tmp_path, capsys):
    (tmp_path / "taken").touch()
    assert call("--out", tmp_path / "taken") == 2
    assert "expected a folder" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_of_the_docs_runs(command, tmp_path, monkeypatch):
    """With one sequence of few frames: the last of options given twice counts."""
    monkeypatch.chdir(tmp_path)
    assert call(*shlex.split(command)[3:], "--scenes", 1, "--frames", 33) == 0
    assert (tmp_path / "ranges" / "ranges.html").is_file()
