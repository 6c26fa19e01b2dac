"""The commands of docs/view.md, run on the sample flight's first second."""

import re
import shlex
import shutil
from pathlib import Path

import pytest

from flightdepth.cli import main

TEXT = (Path(__file__).parents[1] / "docs" / "view.md").read_text(encoding="utf-8")
COMMANDS = re.findall(r"^flightdepth (.*)$", TEXT, re.MULTILINE)
WRITING = [command for command in COMMANDS if command.startswith("convert") or "--save" in command]


@pytest.fixture(scope="module")
def work(sample_flown, tmp_path_factory):
    folder = tmp_path_factory.mktemp("docs")
    shutil.copytree(sample_flown, folder / "out")
    return folder


@pytest.mark.parametrize("command", WRITING)
def test_a_command_writes_its_file(work, monkeypatch, command):
    monkeypatch.chdir(work)
    fewer = ["--every", "40"] if ".bt" in command else []  # a second for each picture of an occupancy map
    assert main([*shlex.split(command), *fewer]) == 0
    (file,) = [word for word in command.split() if word.startswith("flight.")]
    written = [path for path in (work / file, *(work / file).rglob("*")) if path.is_file()]
    assert sum(path.stat().st_size for path in written) > 1000


def test_the_others_open_the_viewer():
    """Windows and servers do not end by themselves: tests/outputs/test_view_command.py starts one."""
    assert sorted(set(COMMANDS) - set(WRITING)) == ["view out", "view out --web"]
