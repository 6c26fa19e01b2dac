"""The tables of knobs in docs/stillbox.md are the code's; `python tests/scenes/test_knob_table.py` prints them."""

from pathlib import Path

import pytest
from pydantic import BaseModel

from flightdepth.scenes import StillBoxConfig
from flightdepth.scenes.outdoor_config import OutdoorConfig

PAGE = Path(__file__).parents[2] / "docs" / "stillbox.md"
UNITS = {"_m_s": "m/s", "_m": "m", "_s": "s", "_hz": "Hz", "_deg": "degrees", "_rad": "rad"}
KNOBS = [(config, name) for config in (StillBoxConfig, OutdoorConfig) for name in config.model_fields]


def row(config: type[BaseModel], name: str) -> str:
    """A line of the table: name, unit, default, what it is."""
    field = config.model_fields[name]
    unit = next((unit for suffix, unit in UNITS.items() if name.endswith(suffix)), "")
    default = " to ".join(map(str, field.default)) if isinstance(field.default, tuple) else str(field.default)
    return f"| `{name}` | {unit} | {default} | {field.description} |"


@pytest.mark.parametrize(("config", "name"), KNOBS)
def test_a_knob_stands_in_the_page(config, name):
    assert row(config, name) in PAGE.read_text(encoding="utf-8").splitlines()


def test_no_other_knob_stands_in_the_page():
    lines = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("| `")]
    assert sorted(lines) == sorted(row(*knob) for knob in KNOBS)


@pytest.mark.parametrize(("config", "name"), KNOBS)
def test_every_knob_says_what_it_is(config, name):
    assert config.model_fields[name].description


if __name__ == "__main__":
    for knob in KNOBS:
        print(row(*knob))
