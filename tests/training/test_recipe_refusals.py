"""Slips of a first recipe, each told in a line that says what was meant."""

import pytest

from flightdepth.errors import BadInput
from flightdepth.training import load_recipe
from tests_recipes import recipe_text, stage_text

GOOD = recipe_text(stage_text("64", 8))


@pytest.mark.parametrize(
    ("right", "wrong", "said"),
    [
        ("weight_decay", "weigth_decay", "weigth_decay: .*, stages; perhaps weight_decay, got weigth_decay$"),
        ("learning_rate", "learning_rat", "stages.0.learning_rat: .*; perhaps learning_rate, got"),
        ("[[stages]]", "[[stage]]", "stage: .*; perhaps stages, got stage$"),
        # Once "expected a valid tuple".
        ("[[stages]]", "[stages]", r"stages: expected tables, each under \[\[stages\]\], got"),
        ('name = "small"', 'name = "../small"', "name: expected a name without / .*, got ../small$"),
    ],
)
def test_a_slip_is_told_by_what_was_meant(tmp_path, right, wrong, said):
    path = tmp_path / "mine.toml"
    path.write_text(GOOD.replace(right, wrong))
    with pytest.raises(BadInput, match=said):
        load_recipe(str(path))
