"""The commands of docs/truth.md, run on the sample flight's first one and a half seconds."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import pytest

from flightdepth.cli import main
from flightdepth.commands.demo import TRUTH

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "docs" / "truth.md").read_text(encoding="utf-8")
COMMANDS = re.findall(r"^flightdepth (evaluate .*)$", TEXT, re.MULTILINE)
PRINTED = TEXT.split("```\n\n```\n")[1].split("```")[0]


@pytest.fixture(scope="module")
def work(sample_flown, tmp_path_factory):
    """The demo's folder, its truth where a clone has it, and the same as a user's own."""
    folder = tmp_path_factory.mktemp("docs")
    for flown in ("out", "flightdepth-demo"):
        shutil.copytree(sample_flown, folder / flown)
    for truth in (folder / TRUTH.relative_to(ROOT), folder / "depths"):
        shutil.copytree(TRUTH, truth)
    return folder


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_runs(work, monkeypatch, command):
    monkeypatch.chdir(work)
    assert main(shlex.split(command)) == 0


def test_what_is_printed_looks_as_on_the_page(work, monkeypatch, capsys):
    monkeypatch.chdir(work)
    assert main(shlex.split(COMMANDS[0])) == 0
    said = capsys.readouterr().out
    headings, rows = PRINTED.splitlines()[:2], PRINTED.splitlines()[2:]
    assert all(heading in said for heading in headings)
    starts = {re.split(r"[:0-9<]", row)[0] for row in rows} - {
        "",
        "nearer_than, told of ",
    }  # so early none is
    assert [start for start in starts if f"\n{start}" not in said] == []


def test_each_line_is_explained():
    table = TEXT.split("| line |")[1].split("\n\n")[0]
    for name in (
        "known",
        "inside sigma",
        "scale",
        "sky",
        "farther_than",
        "nearer_than",
        "confidence",
        "in no range",
    ):
        assert f"`{name}`" in table
