"""What a run begins from, and what of it the recipe's network has no place for."""

import pytest
import torch
from training_runs import small_recipe, stage

from flightdepth.architectures.motionnet import RESIDUAL
from flightdepth.commands.train import introduce
from flightdepth.errors import BadInput
from flightdepth.training import load_recipe
from flightdepth.training.export import deployed, to_onnx
from flightdepth.training.network import network_of
from flightdepth.training.run_folder import card_stage
from flightdepth.training.start import Start, start_of
from flightdepth.weights.card import NetworkCard
from flightdepth.weights.store import save_network

DEEPER = {"looks": 2, "thorough_last_look": True, "residual_blocks": True}
BLOCKS = {"conv4_1.3", "conv5_1.3", "conv6_1.3", "deconv5.4", "deconv4.4", "deconv3.4"}


def motion_recipe(**changes):
    facts = {"architecture": "MotionNet", "reference_focal_px": 32.0, "stages": [stage("a", 1)]}
    return small_recipe(**facts | changes)


@pytest.mark.parametrize(
    ("knobs", "left"),
    [
        (DEEPER, set()),
        (DEEPER | {"residual_blocks": False}, BLOCKS),
        (DEEPER | {"looks": 1}, {"refinement"}),
        (DEEPER | {"thorough_last_look": False}, {"last_look"}),
        ({}, BLOCKS | {"last_look"}),
    ],
    ids=["nothing", "blocks", "second look", "last look", "all of them"],
)
def test_what_is_left_behind_is_told_by_its_outermost_module(knobs, left):
    start = Start("a run", network_of(motion_recipe(**DEEPER)).state_dict(), 8)
    found = start.left_behind(motion_recipe(**knobs))
    assert set(found) == left
    assert len(found) == len(left)


def test_nothing_is_left_behind_by_a_network_that_has_more():
    start = Start("a run", network_of(motion_recipe()).state_dict(), 8)
    assert start.left_behind(motion_recipe(**DEEPER)) == ()


def test_a_recipe_that_starts_from_nothing_begins_from_random_weights(tmp_path):
    assert start_of(small_recipe(), tmp_path) is None


def test_training_says_what_it_leaves_behind(tmp_path, capsys):
    """motion's residual blocks and first look went without a word where motion-tiny was trained from it."""
    introduce(load_recipe("motion-tiny"), tmp_path / "motion-tiny")
    lines = capsys.readouterr().out.splitlines()
    told = [line for line in lines if line.startswith("left behind: ")]
    assert len(told) == 1
    assert set(told[0].removeprefix("left behind: ").split(";")[0].split(", ")) == BLOCKS | {"refinement"}
    assert len(BLOCKS) == len(RESIDUAL)
    assert "goes on from motion, which ships" in lines


def test_training_says_nothing_of_the_kind_where_all_is_taken_over(tmp_path, capsys):
    introduce(load_recipe("tiny-clamped-512"), tmp_path / "tiny-clamped-512")
    out = capsys.readouterr().out
    assert "goes on from tiny-clamped-256, which ships" in out
    assert "left behind" not in out


@pytest.fixture
def network_file(quick_exports, tmp_path):
    """A network of the small recipe's size, as `flightdepth export` leaves it, that has seen 8 pairs in stage a."""
    recipe = small_recipe(stages=[stage("a", 1)])
    torch.manual_seed(3)
    weights = network_of(recipe).state_dict()
    card = NetworkCard(
        **recipe.model_dump(include={"name", "base_width", "activation", "nominal_shift"}),
        architecture="DepthNet",
        D0_m=0.3,
        depth_min_m=0,
        depth_max_m=100,
        focal_px=32,
        width=64,
        height=64,
        samples=8,
        stages=(card_stage(recipe, recipe.stages[0], recipe.stages[0].samples),),
    )
    return save_network(tmp_path, card, to_onnx(deployed(recipe, weights))), weights


def test_a_recipe_starts_from_a_network_file(network_file, tmp_path):
    path, weights = network_file
    start = start_of(small_recipe(name="child", starts_from=str(path)), tmp_path)
    assert (start.origin, start.stage, start.seen) == (f"{path}: 8 pairs", 0, 8)
    assert start.weights.keys() == weights.keys()
    assert all(torch.equal(start.weights[key], weights[key]) for key in weights)


def test_a_network_file_of_the_recipes_own_name_and_stages_is_no_start(network_file, tmp_path):
    path, _ = network_file
    with pytest.raises(BadInput, match=f"another name, since it starts from a network of that name, {path}"):
        start_of(small_recipe(stages=[stage("a", 1)], starts_from=str(path)), tmp_path)


def test_a_network_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(BadInput, match=r"expected a path to an ONNX file .*, got 'none.onnx'"):
        start_of(small_recipe(name="child", starts_from="none.onnx"), tmp_path)
