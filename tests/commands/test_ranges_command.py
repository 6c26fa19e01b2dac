"""`flightdepth evaluate ranges`: a study of two methods and one short sequence, its files, and what is refused."""

import json
import shlex
from pathlib import Path

import pytest

pytest.importorskip("plotly", reason="needs flightdepth[report]")

from flightdepth import cli
from flightdepth.evaluation import ranges_study, ranges_trials
from flightdepth.evaluation.ranges_trials import CONSTANT, FLOW, Trial
from flightdepth.scenes import Textures

TEXT = (Path(__file__).parents[2] / "docs" / "ranges.md").read_text(encoding="utf-8")
COMMANDS = [line for line in TEXT.splitlines() if line.startswith("flightdepth ")]
TRIALS = (Trial(FLOW, 1), Trial(FLOW, 2), Trial(CONSTANT, 0))


@pytest.fixture(autouse=True)
def small(monkeypatch):
    """Methods that need no network, and few textures."""
    monkeypatch.setattr(ranges_trials, "all_trials", lambda *, quick=False: TRIALS[:1] if quick else TRIALS)
    monkeypatch.setattr(ranges_study, "test_textures", lambda: Textures.procedural(4, 0))


def call(*arguments):
    return cli.main(["evaluate", "ranges", *map(str, arguments)])


def test_figures_and_page(tmp_path, capsys):
    assert call("--out", tmp_path, "--scenes", 1, "--frames", 34) == 0
    said = capsys.readouterr().out
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


@pytest.mark.slow
def test_quick_is_less(tmp_path):
    assert call("--out", tmp_path, "--scenes", 1, "--frames", 33, "--quick") == 0
    assert len(json.loads((tmp_path / "ranges.json").read_text())["trials"]) == 1


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
