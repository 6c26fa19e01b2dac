"""The paper's table: its rows and figures, and every recipe of it trained and measured at next to no size."""

import json
import math
import re
import shlex
from pathlib import Path

import onnx
import pytest
import torch
from rich.console import Console

from flightdepth import cli
from flightdepth.commands import table
from flightdepth.evaluation import table as paper
from flightdepth.runtimes.network import load_network
from flightdepth.scenes import Textures
from flightdepth.stillbox import PairStream
from flightdepth.training import loop, recipe_files, recipe_names
from flightdepth.training.checkpoint import read_progress
from flightdepth.training.run_folder import SETS, drawn_in, keep_textures, parent_checkpoint, read_trained
from flightdepth.weights.store import find_network, read_card, shipped_networks

SMALL = 8, 8  # feature maps of every network, pairs of every batch


def text_of(tables):
    console = Console(width=160)
    with console.capture() as captured:
        for each in tables:
            console.print(each)
    return captured.get()


def test_every_row_of_the_paper_has_a_stage_of_a_recipe():
    for row in paper.ROWS:
        name, stage = row.source.split("/")
        assert name in paper.RECIPES
        assert stage in [each.name for each in recipe_files.load_recipe(name).stages]


def widths(name):
    """The chain of a recipe, with what it starts from; stage by stage."""
    loaded = recipe_files.load_recipe(name)
    before = []
    if loaded.starts_from:
        parent, stage = loaded.starts_from.split("/")
        known = widths(parent)
        before = known[: [name for name, _ in known].index(stage) + 1]
    return before + [(stage.name, stage.full_width) for stage in loaded.stages]


@pytest.mark.parametrize("row", paper.ROWS, ids=lambda row: row.title)
def test_a_row_is_what_its_recipe_trains(row):
    name, stage = row.source.split("/")
    chain = []
    for number, width in widths(name):
        chain += [] if chain[-1:] == [width] else [width]
        if number == stage and len(chain) >= len(row.chain):
            break
    assert tuple(chain) == row.chain


def test_recipes_come_after_those_that_they_start_from():
    parents = [recipe_files.load_recipe(name).starts_from for name in paper.RECIPES]
    for number, parent in enumerate(parents):
        assert parent is None or parent.split("/")[0] in paper.RECIPES[:number]
    assert set(paper.RECIPES) == {name for name in recipe_names() if name.startswith("table-")}


def test_the_authors_later_figures_stand_in_the_rows_of_their_chain():
    found = [row.later_m for row in paper.ROWS if row.later_m]
    assert found == [4.65, 3.08, 2.29, 1.97]


def test_what_is_not_trained_says_so_and_shows_what_others_report():
    text = text_of(paper.tables([(row, None) for row in paper.ROWS]))
    assert len(re.findall(paper.UNTRAINED, text)) == 3 * len(paper.ROWS)
    assert re.search(r"DepthNet 64-128-256 +untrained +0\.88 +- +2\.44 +2\.29", text)
    assert re.search(r"FlowNetS 64 +38\.6", text)


def test_ratio_and_peers_by_hand():
    errors = {who: {"l1_m": value, "rmse_m": 2 * value} for who, value in (("network", 3), ("constant", 12))}
    found = {
        "test": errors | {"classical": {"l1_m": None}},
        "train": {"network": {"l1_m": 2.0, "rmse_m": 3.5}},
    }
    found |= {"parameters": 10_290_473, "samples": 1000, "median_ms": 1.25, "width_px": 64}
    text = text_of(paper.tables([(paper.ROWS[1], found)]))
    assert re.search(r"DepthNet 64 +2\.00 +2\.26 +3\.00 +4\.49 +4\.65 +1\.50 +12\.00 +-", text)
    assert re.search(r"DepthNet 64 +3\.50 +5\.55 +6\.00 +8\.44", text)
    assert re.search(r"DepthNet 64 +10\.3 +1,000 +64 +1\.2", text)


@pytest.mark.parametrize("name", shipped_networks())
def test_parameters_are_those_of_the_weights_that_ship(name):
    """But for a factor of each batch norm, which the file holds within the weights before it."""
    held = sum(math.prod(each.dims) for each in onnx.load(find_network(name)).graph.initializer)
    assert table.facts(load_network(name))["parameters"] == pytest.approx(held, rel=0.01)


@pytest.mark.parametrize("name", shipped_networks())
def test_a_shipped_network_stands_beside_its_own_chain_only(name):
    card = read_card(find_network(name))
    row = paper.shipped_row(card)
    assert (row.paper is not None) == (name == "depthnet-256")


def test_a_set_that_is_nearer_than_the_original_is_not_compared():
    pooled = {"5": 4.0, "25": 7.0, "50": 20.0, "75": 50.0, "95": 70.0}
    assert paper.inside_original(pooled)
    assert not paper.inside_original(pooled | {"50": 9.0})


def small_bytes(name, known):
    """A shipped recipe with a small network, small pictures, small batches and short scenes."""
    text = known(name).decode()
    if not name.startswith("table-"):
        return text.encode()
    text = re.sub(r"base_width = \d+", f"base_width = {SMALL[0]}", text)
    text = re.sub(r"batch = \d+", f"batch = {SMALL[1]}", text)
    text = re.sub(r"^(width|height) = \d+", r"\1 = 64", text, flags=re.MULTILINE)
    text = re.sub(r"full_width = (\d+)", lambda m: f"full_width = {64 if m[1] == '64' else 128}", text)
    return (text + "\n[scenes]\nframes = 4\n").encode()


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    """Small recipes, eight scenes in the pool, a folder of its own."""
    known, folder = recipe_files._recipe_bytes, tmp_path_factory.mktemp("table")
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recipe_files, "_recipe_bytes", lambda name: small_bytes(name, known))
        patch.setattr(loop, "pool_scenes", lambda _: 8)
        patch.setattr(table, "TIMED_CALLS", 1)
        patch.chdir(folder)
        yield folder
    torch.set_num_threads(threads)


COMMAND = ["evaluate", "table", "--scenes", "2", "--procedural", "2", "--json", "table.json"]


def test_all_recipes_are_trained_with_one_dial(world, capsys):
    runs, textures = Path("dial"), Textures.procedural(2, 1)
    table.train_all(runs, textures, 8)
    assert "4 of 4: table-flownets, 40 pairs in 5 stages" in capsys.readouterr().out
    seen = {row.source: read_progress(parent_checkpoint(runs, row.source)).seen for row in paper.ROWS}
    assert seen["table-depthnet/512"] == seen["table-flownets/512"] == 5 * 8
    assert seen["table-depthnet-64-512/512"] == 3 * 8
    assert seen["table-depthnet-512/512"] == 2 * 8
    before = {path: path.read_bytes() for path in runs.glob("*/*.safetensors")}
    table.train_all(runs, textures, 8)
    assert {path: path.read_bytes() for path in before} == before


@pytest.mark.slow
def test_the_whole_table_with_one_dial(world, capsys):
    assert cli.main([*COMMAND, "--train", "--samples", "8"]) == 0, capsys.readouterr().err
    out = capsys.readouterr().out
    assert "4 of 4: table-flownets" in out
    assert paper.UNTRAINED not in out
    rows = json.loads((world / "table.json").read_text())["rows"][: len(paper.ROWS)]
    for row in rows:
        measured = row["measured"]
        assert measured["test"]["pairs"] == measured["train"]["pairs"] == 2
        assert measured["test"]["network"]["l1_m"] > 0
        assert {"commit", "weights_sha256", "recipe_digest", "set_version"} <= measured.keys()
    samples = {row["source"]: row["measured"]["samples"] for row in rows}
    assert samples["table-depthnet/512"] == 5 * 8
    assert samples["table-depthnet-64-512/512"] == 3 * 8
    assert samples["table-depthnet-512/512"] == 2 * 8


@pytest.mark.slow
def test_the_second_time_nothing_is_trained_or_measured_again(world, capsys):
    before = {path: path.stat().st_mtime_ns for path in Path("runs").glob("*/*.figures.json")}
    assert len(before) == len(paper.ROWS)
    assert cli.main([*COMMAND, "--train", "--samples", "8"]) == 0
    assert {path: path.stat().st_mtime_ns for path in before} == before


@pytest.mark.slow
def test_every_command_of_the_page_runs(world, capsys):
    """After the whole table was trained with other numbers: another folder."""
    text = (Path(__file__).parents[2] / "docs" / "table.md").read_text(encoding="utf-8")
    commands = [
        shlex.split(line)[1:]
        for block in re.findall(r"```sh\n(.*?)```", text, re.DOTALL)
        for line in block.splitlines()
    ]
    Path("networks").mkdir()
    for command in commands:
        small = ["8" if word == "20000" else word for word in command] + ["--scenes", "1"]
        made = ["--procedural", "2"] if "table" in command else []
        assert cli.main([*small, *made]) == 0, capsys.readouterr().err
    assert {path.name for path in Path("networks").iterdir()} == {"depthnet-256.md", "depthnet-256.jpg"}


@pytest.mark.slow
def test_a_run_in_the_folder_fills_its_row(world, capsys):
    """The first stage of the chain alone: one row, and those of its other stages stay untrained."""
    assert (
        cli.main(["train", "table-depthnet-512", "--procedural", "2", "--samples", "16", "--runs", "one"])
        == 0
    )
    Path("one/table-depthnet-512/512-more.safetensors").unlink()  # as if training had stopped before
    assert cli.main([*COMMAND, "--runs", "one"]) == 0, capsys.readouterr().err
    rows = {row["title"]: row for row in json.loads((world / "table.json").read_text())["rows"]}
    measured = rows["DepthNet 512"]["measured"]
    assert measured["samples"] == 2 * 8
    assert measured["train"]["pairs"] == 2
    assert rows["DepthNet 64"]["measured"] is None
    assert rows["DepthNet 512, compute of the chain"]["measured"] is None
    assert rows["depthnet-256, shipped"]["measured"]["test"]["network"]["l1_m"] > 0
    assert paper.UNTRAINED in capsys.readouterr().out


def test_training_scenes_are_drawn_again_in_the_same_textures_only(tmp_path):
    keep_textures(tmp_path, Textures.procedural(2, 1))
    assert drawn_in(tmp_path, Textures.procedural(2, 1))
    assert not drawn_in(tmp_path, Textures.procedural(2, 2))
    (tmp_path / SETS).write_text("{}")
    assert not drawn_in(tmp_path, Textures.procedural(2, 1))


@pytest.mark.slow
def test_the_last_scenes_are_those_of_the_stream(world):
    if not Path("one").exists():
        pytest.skip("needs the run of the test before")
    trained = read_trained(Path("one/table-depthnet-512/512.safetensors"))
    card = read_card(find_network("depthnet-256")).model_copy(update={"focal_px": 64.0})
    last = paper.LastScenes.of(trained, card, Textures.procedural(2, 1), 5)
    assert (last.numbers.stop, len(last)) == (PairStream.pool_scenes, 5)
    stream = PairStream(
        trained.recipe.scenes,
        last.scenes.textures,
        last.scenes.picture,
        trained.recipe.rule,
        last.scenes.seed,
    )
    with stream:
        _, rendered, _ = stream._render(last.numbers[0])
    pair = next(iter(last))
    assert any((frame == pair.current).all() for frame in rendered.images)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--samples", "8"], "--samples: expected --train beside it"),
        (["--json", "no/t.json"], "--json: expected"),
    ],
)
def test_bad_input_is_one_line(arguments, said, capsys):
    assert cli.main(["evaluate", "table", *arguments]) == 2
    assert said in capsys.readouterr().err
