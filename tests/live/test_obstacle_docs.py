"""docs/obstacles.md: its commands parse, its table of the blind cone is the code's, its numbers are the defaults."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
import typer
from obstacle_worlds import SETTINGS, blind_cone_deg

from flightdepth.cli import app
from flightdepth.live.obstacle_messages import COMPONENT
from flightdepth.live.obstacle_sender import RATE_HZ
from flightdepth.live.obstacles import Sight

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "obstacles.md").read_text(encoding="utf-8")
COMMANDS = [line for block in re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL) for line in block.splitlines()]


@pytest.mark.parametrize("command", [line for line in COMMANDS if line.startswith("flightdepth")])
def test_commands_parse(command):
    _, name, *arguments = shlex.split(command)
    live = typer.main.get_command(app).commands[name]
    context = live.make_context(name, arguments)
    assert context.params["obstacles"]


@pytest.mark.parametrize("command", [line for line in COMMANDS if line.startswith("python")])
def test_scripts_exist(command):
    assert (ROOT / shlex.split(command)[1]).exists()


def test_the_table_of_the_blind_cone():
    rows = re.findall(r"^\| (\d+) m \| ([\d.]+)° \| ([\d.]+)° \| ([\d.]+)° \|$", PAGE, re.MULTILINE)
    assert len(rows) == 4
    for range_m, *told in rows:
        for displacement_m, degrees in zip((0.4, 1.0, 3.0), told, strict=True):
            found = blind_cone_deg(float(range_m), displacement_m, Sight(256.0))
            assert found == pytest.approx(float(degrees), abs=0.051)


def test_the_numbers_are_the_defaults():
    said = (SETTINGS.min_m, SETTINGS.max_m, SETTINGS.above_m, SETTINGS.below_m)
    assert (
        said == (1.0, 40.0, 1.5, 1.5) and "100 and 4000 cm" in PAGE and "1.5 m above to 1.5 m below" in PAGE
    )
    assert SETTINGS.hit_share == 0.03 and "nearest 3 % of a sector's rays" in PAGE
    assert SETTINGS.hit_confidence == 0.25 and "0.25 is enough for an obstacle" in PAGE
    assert SETTINGS.known_share == 0.7 and SETTINGS.memory_s == 1.0
    assert f"component {COMPONENT} " in PAGE and f"{RATE_HZ:.0f} times a second" in PAGE


def test_pictures_and_pages_it_names_exist():
    for target in re.findall(r"\]\(([^)#]+)\)", PAGE):
        assert target.startswith("http") or (ROOT / "docs" / target).exists(), target
