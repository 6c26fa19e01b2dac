"""What a run begins from, and what of it the recipe's network has no place for."""

import pytest
import torch
from training_runs import small_recipe, stage

from flightdepth.architectures.motionnet import RESIDUAL
from flightdepth.commands.train import introduce
from flightdepth.errors import BadInput
from flightdepth.training import load_recipe
from flightdepth.training.checkpoint import Progress
from flightdepth.training.export import deployed, to_onnx
from flightdepth.training.network import network_of
from flightdepth.training.run_folder import Trained, card_stage
from flightdepth.training.start import Start, start_of
from flightdepth.weights.card import NetworkCard
from flightdepth.weights.store import read_network, save_network, shipped_networks

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


FASTER = {"scenes": {"frames": 3, "speed_m_s": 5.0}}  # a step of 0.5 m


def tiny_recipe(**changes):
    facts = {"name": "mine", "starts_from": "motion-tiny", "base_width": 16, "nominal_shift": 6}
    return motion_recipe(**facts | {"reference_focal_px": 64.0} | changes)


@pytest.mark.parametrize(
    ("changes", "factor", "lines"),
    [
        (FASTER, "0.2", "nominal_shift = 1 and reference_focal_px = 76.8"),
        ({"reference_focal_px": 128.0}, "0.5", "nominal_shift = 3 and reference_focal_px = 128"),
        ({"nominal_shift": 3}, "2", "nominal_shift = 6 and reference_focal_px = 64"),
    ],
    ids=["speed", "focal length", "shift"],
)
def test_a_network_for_any_lens_does_not_start_at_another_scale(tmp_path, changes, factor, lines):
    """The documented recipe with a set's own speed began with depth five times too near, without a word."""
    with pytest.raises(
        BadInput, match=rf"expected 38\.4 m px, as motion-tiny, .* {factor} times .* {lines}\."
    ):
        start_of(tiny_recipe(**changes), tmp_path)


@pytest.mark.parametrize(
    "changes", [{}, FASTER | {"nominal_shift": 1, "reference_focal_px": 76.8}, {"reference_focal_px": 64.5}]
)
def test_the_same_scale_at_another_speed_is_a_start(tmp_path, changes):
    assert start_of(tiny_recipe(**changes), tmp_path).origin == "motion-tiny, which ships"


@pytest.mark.parametrize("name", shipped_networks())
def test_a_shipped_network_that_has_been_through_all_stages_has_nothing_to_learn(name, tmp_path):
    """It ended well after no pair, with a loss of "nan m"."""
    with pytest.raises(BadInput, match=f"stages beyond those that {name} has been through, got none"):
        start_of(load_recipe(name), tmp_path, read_network(name))


def test_the_shipped_network_does_not_go_on_at_another_scale(tmp_path):
    shipped = read_network("motion-tiny")
    recipe = load_recipe("motion-tiny")
    more = recipe.stages[-1].model_copy(update={"name": "more"})
    recipe = recipe.model_copy(update={"reference_focal_px": 128.0, "stages": (*recipe.stages, more)})
    with pytest.raises(BadInput, match=r"where all would begin 0\.5 times"):
        start_of(recipe, tmp_path, shipped)


def test_a_run_does_not_start_from_one_of_another_scale(tmp_path, monkeypatch):
    parent = Trained(
        tmp_path, motion_recipe(), Progress("small", "", stage=1, sample=0, seen=8, loss_m=1.0), None
    )
    monkeypatch.setitem(start_of.__globals__, "read_trained", lambda _: parent)
    (tmp_path / "small").mkdir()
    (tmp_path / "small/checkpoint.safetensors").touch()
    with pytest.raises(BadInput, match=r"expected 9\.6 m px, as small, got 48"):
        start_of(motion_recipe(name="child", starts_from="small", **FASTER), tmp_path)


def test_a_network_for_one_lens_may_start_at_another_shift(tmp_path):
    """As `clamped-256` does, whose depth is metres at 0.5 m."""
    assert start_of(load_recipe("clamped-256"), tmp_path).origin == "depthnet-256, which ships"


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
