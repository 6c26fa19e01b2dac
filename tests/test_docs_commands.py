"""Every command that README and the pages print: it exists, and so do its options. Every file they link to, too."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer

from flightdepth.cli import app

ROOT = Path(__file__).parents[1]
PAGES = sorted(
    [ROOT / "README.md", ROOT / "CHANGELOG.md", *ROOT.glob("docs/**/*.md"), *ROOT.glob("ros2/**/*.md")]
)
COMMAND = re.compile(r"(?:^\s*|`|\$ |-m )flightdepth ([a-z][^`#\n]*)", re.MULTILINE)
LINK = re.compile(r"\]\(([^)#\s]+)(?:#[^)]*)?\)")


def commands() -> Iterator[tuple[str, str]]:
    for page in PAGES:
        text = page.read_text(encoding="utf-8").replace("\\\n", " ")
        for found in COMMAND.findall(text):
            yield page.name, found.strip()


def taken_apart(line: str) -> tuple[typer.core.TyperCommand, list[str]]:
    """The command, and what follows its name."""
    command, words = typer.main.get_command(app), shlex.split(line)
    while isinstance(command, typer.core.TyperGroup) and words and words[0] in command.commands:
        command = command.commands[words.pop(0)]
    return command, words


@pytest.mark.parametrize(("page", "line"), sorted(set(commands())))
def test_a_printed_command_exists(page, line):
    command, words = taken_apart(line)
    assert not isinstance(command, typer.core.TyperGroup) or not words, f"{page}: no such command: {line}"
    known = {name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)}
    asked = {word.split("=")[0] for word in words if word.startswith("--")}
    assert asked <= known | {"--help"}, f"{page}: {line}"


def test_there_are_many():
    assert len(set(commands())) > 60


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    links = [link for link in LINK.findall(page.read_text(encoding="utf-8")) if "://" not in link]
    assert [link for link in links if not (page.parent / link).exists()] == []
