"""The commands of the docs' page on steady frames and clocks."""

import re
import shlex
from pathlib import Path

from flightdepth import cli

TEXT = (Path(__file__).parents[1] / "docs" / "steadiness.md").read_text("utf-8")
COMMANDS = re.findall(r"^flightdepth .*$", TEXT, re.MULTILINE)


def options_of(capsys, *command):
    assert cli.main([*command, "--help"]) == 0
    return set(re.findall(r"--[a-z][a-z-]+", capsys.readouterr().out))


def test_the_options_of_its_commands_exist(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    assert len(COMMANDS) == 2
    for line in COMMANDS:
        words = shlex.split(line)[1:]
        command = words[:2] if words[0] == "evaluate" else words[:1]
        assert {word for word in words if word.startswith("--")} <= options_of(capsys, *command)


def test_the_options_in_its_text_exist(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    assert set(re.findall(r"--[a-z][a-z-]+", TEXT)) - {"--scenes"} <= options_of(capsys, "run")
