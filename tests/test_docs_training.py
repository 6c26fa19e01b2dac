"""The commands of docs/training.md, in their order, with few samples and scenes."""

import json
import re
import shlex
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from flightdepth import cli
from flightdepth.architectures import DepthNet
from flightdepth.evaluation import int8_ranges
from flightdepth.training import held_out, loop, recipe_files
from flightdepth.training.run_folder import stages_behind
from flightdepth.training.start import start_of
from flightdepth.weights.store import find_network, read_card
from tests_recipes import recipe_text, stage_text

pytestmark = pytest.mark.usefixtures("quick_exports", "few_fixed_textures")

TEXT = (Path(__file__).parents[1] / "docs" / "training.md").read_text(encoding="utf-8")
COMMANDS = [
    line
    for block in re.findall(r"```sh\n(.*?)```", TEXT, re.DOTALL)
    for line in block.strip().splitlines()
    if line.startswith("flightdepth ")  # `torchrun` has a test of its own
]


def test_every_command_runs(monkeypatch, tmp_path, capsys):
    stages = [stage_text(name, 4) for name in ("64", "128", "256")]
    text = recipe_text(*stages, name="tiny-clamped-256", clamped=True)
    known = recipe_files._recipe_bytes
    monkeypatch.setattr(
        recipe_files,
        "_recipe_bytes",
        lambda name: text.encode() if name == "tiny-clamped-256" else known(name),
    )
    monkeypatch.setattr(loop, "pool_scenes", lambda _: 8)
    monkeypatch.setattr(held_out, "PAIRS", held_out.AT_ONCE)
    monkeypatch.setattr(int8_ranges, "fitted_int8_ranges", lambda *_: {})  # has tests of its own
    monkeypatch.chdir(tmp_path)
    (tmp_path / "photos").mkdir()
    cv2.imwrite(str(tmp_path / "photos" / "a.jpg"), np.full((60, 80, 3), 90, np.uint8))
    (tmp_path / "networks").mkdir()
    (tmp_path / "mine.toml").write_text(text.replace("tiny-clamped-256", "mine"))
    shipped = recipe_files.load_recipe("tiny-clamped-512")
    trained = shipped.stages[: stages_behind(read_card(find_network(shipped.name)), shipped)]
    size = {"full_width": 64, "width": 64, "height": 64, "samples": 4, "batch": 4}
    more = trained[0].model_copy(update={"name": "more", **size})
    longer = shipped.model_copy(update={"stages": (*trained, more)})
    (tmp_path / "more.toml").write_text(as_toml(longer))
    for command in COMMANDS:
        assert cli.main(small(command)) == 0, capsys.readouterr().err
    made = ["runs/mine", "short/tiny-clamped-256", "networks/tiny-clamped-128.onnx", "figures.json"]
    assert all((tmp_path / path).exists() for path in made)


def test_a_network_from_elsewhere_is_measured_and_gone_on_from(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "networks").mkdir()
    (snippet,) = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    few = snippet.replace("base_width=32", "base_width=4")
    torch.manual_seed(2)
    weights = DepthNet(4).state_dict()
    torch.save({"epoch": 1, "state_dict": weights}, "authors.pth.tar")
    exec(few, {})
    assert cli.main(["evaluate", "network", "networks/authors.onnx", "--scenes", "1"]) == 0
    text = recipe_text(stage_text("64", 4), name="child")
    (tmp_path / "child.toml").write_text('starts_from = "networks/authors.onnx"\n' + text)
    start = start_of(recipe_files.load_recipe("child.toml"), tmp_path / "runs")
    assert all(torch.equal(start.weights[key], weights[key]) for key in weights)


def as_toml(recipe):
    """The recipe as a file, without what stands at its default."""
    facts = recipe.model_dump(mode="json", exclude_defaults=True)
    stages = facts.pop("stages")
    lines = [f"{key} = {json.dumps(value)}" for key, value in facts.items()]
    for stage in stages:
        lines += ["[[stages]]", *(f"{key} = {json.dumps(value)}" for key, value in stage.items())]
    return "\n".join(lines)


def small(command):
    """The arguments of a command, with numbers that take no time."""
    _, name, *rest = shlex.split(command)
    rest = [{"20000": "12", "100": "2", "1000": "2"}.get(word, word) for word in rest]
    scenes = ["--scenes", "2"] if name in ("export", "evaluate") and "--scenes" not in rest else []
    made = ["--procedural", "2"] if name in ("train", "render") and "--procedural" not in rest else []
    return [name, *rest, *scenes, *made]


@pytest.mark.parametrize("name", recipe_files.recipe_names())
def test_every_recipe_is_described(name):
    assert f"| `{name}` |" in TEXT
