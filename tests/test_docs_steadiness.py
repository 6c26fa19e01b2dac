"""The commands of the docs' page on steady frames and clocks."""

import re
import shlex
from pathlib import Path

from flightdepth import cli

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "docs" / "steadiness.md").read_text("utf-8")
OPTION = re.compile(r"--[a-z][a-z-]+")
BENCHMARK = re.compile(r"python (benchmarks/\w+\.py)([^`]*)")
COMMANDS = re.findall(r"^flightdepth .*$", TEXT, re.MULTILINE)


def options_of(capsys, *command):
    assert cli.main([*command, "--help"]) == 0
    return set(OPTION.findall(capsys.readouterr().out))


def test_the_options_of_its_commands_exist(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    assert len(COMMANDS) == 2
    for line in COMMANDS:
        words = shlex.split(line)[1:]
        command = words[:2] if words[0] == "evaluate" else words[:1]
        assert {word for word in words if word.startswith("--")} <= options_of(capsys, *command)


def test_the_options_in_its_text_exist(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    assert set(OPTION.findall(BENCHMARK.sub("", TEXT))) - {"--scenes"} <= options_of(capsys, "run")


def test_the_options_of_its_benchmarks_exist():
    asked = [(file, OPTION.findall(options)) for file, options in BENCHMARK.findall(TEXT)]
    assert any(options for _, options in asked)
    for file, options in asked:
        assert set(options) <= set(OPTION.findall((ROOT / file).read_text("utf-8")))
