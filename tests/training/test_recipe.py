"""Recipes: what ships is valid, what is wrong is one clear line, and a recipe's hash stays what it was."""

import json
from collections import Counter

import numpy as np
import pytest
from pydantic import ValidationError
from torch import nn
from training_runs import BATCH, small_recipe

from flightdepth.errors import BadInput
from flightdepth.evaluation.table import PAIRS_A_SIZE
from flightdepth.runtimes.network import networks
from flightdepth.training import Recipe, load_recipe, recipe_names
from flightdepth.training.export import weights_of
from flightdepth.training.network import network_of
from flightdepth.training.recipe import Stage
from flightdepth.weights.card import Stage as CardStage
from flightdepth.weights.store import read_network

GOOD = """
name = "mine"
base_width = 8
activation = "none"
nominal_shift = 5
depth_min_m = 10.0
depth_max_m = 60.0
loss = "l1"
weight_decay = 1e-4
ema_decay = 0.99
warmup_samples = 0
floor = 0.0
seed = 0

[[stages]]
name = "64"
full_width = 64
width = 64
height = 64
samples = 100
batch = 10
learning_rate = 1e-3
"""


@pytest.fixture
def written(tmp_path):
    def write(text):
        path = tmp_path / "mine.toml"
        path.write_text(text)
        return str(path)

    return write


# Hashes of recipes that networks were trained with: a new knob at its default changes none.
DIGESTS = {
    "depthnet-256": "e235e094514952d9",
    "tiny-clamped-256": "3bf26cac701778b9",
    "tiny-clamped-512": "8535e78ce0b3b544",
}


@pytest.mark.parametrize(("name", "digest"), DIGESTS.items())
def test_the_hash_of_a_trained_recipe_stays(name, digest):
    assert load_recipe(name).digest == digest


@pytest.mark.parametrize("name", recipe_names())
def test_shipped_recipes_are_valid(name):
    assert load_recipe(name).name == name


@pytest.mark.parametrize("name", networks())
def test_shipped_weights_fit_their_recipe(name):
    """`train NAME --shipped` can go on from them."""
    recipe, shipped = load_recipe(name), read_network(name)
    network_of(recipe).load_state_dict(weights_of(shipped.onnx))
    card = shipped.card
    facts = ("looks", "thorough_last_look", "residual_blocks")
    assert [getattr(card, fact) for fact in facts] == [getattr(recipe, fact) for fact in facts]
    assert card.stages[-1].name == recipe.stages[-1].name


def test_a_recipe_from_a_file(written):
    recipe = load_recipe(written(GOOD))
    assert (recipe.name, recipe.samples, recipe.rule.nominal_shift) == ("mine", 100, 5)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "seed = 0",
            "seed = 0\nspeed = 3",
            "mine.toml, speed: expected keys from name, architecture, .*, stages; perhaps seed, got speed",
        ),
        (
            "batch = 10",
            "batch = 10\nspeed = 3",
            r"stages.0.speed: expected keys from name, full_width, .*, got",
        ),
        (
            "[[stages]]",
            "[scenes]\nframs = 3\n[[stages]]",
            "scenes.frams: expected keys from frames, speed_m_s",
        ),
        ("[[stages]]", "[scenes]\nframes = 900\n[[stages]]", "toml, scenes, room_half_m: expected at least"),
        ("width = 64", "width = 65", r"stages.0.width: expected a multiple of 64, got 65"),
        ("batch = 10", "", "stages.0.batch: expected a value, got none$"),
        # Once what it was meant for was said to be missing, and not a word of what stands there.
        ("batch = 10", "bach = 10", r"stages.0.bach: expected keys from name, full_width, .*, got bach$"),
        ('"none"', '"relu"', "activation: expected 'elu\\+1' or 'none', got relu"),
        ("ema_decay = 0.99", "ema_decay = 1.0", "ema_decay: expected less than 1, got 1.0"),
        ("seed = 0", "seed = ", "mine.toml: expected TOML"),
        ("seed = 0", "seed = 5000000", "seed: expected less than or equal to 4000000, got 5000000"),
        ("learning_rate = 1e-3", "learning_rate = nan", "learning_rate"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(written, old, new, said):
    with pytest.raises(BadInput, match=said) as caught:
        load_recipe(written(GOOD.replace(old, new)))
    assert "\n" not in str(caught.value)


def test_bytes_that_are_no_text(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(BadInput, match="expected TOML"):
        load_recipe(str(path))


def test_a_missing_file():
    with pytest.raises(BadInput, match="no such file"):
        load_recipe("nowhere/mine.toml")


def test_an_unknown_name_lists_the_known_ones():
    with pytest.raises(BadInput, match="clamped-256, depthnet-256, motion, motion-tiny"):
        load_recipe("depthnet")


def test_scaled_to_keeps_shares_and_whole_batches():
    recipe = load_recipe("tiny-clamped-256")
    scaled = recipe.scaled_to(recipe.samples // 10)
    for before, after in zip(recipe.stages, scaled.stages, strict=True):
        assert after.samples % after.batch == 0
        assert after.samples == pytest.approx(before.samples / 10, abs=after.batch)
    assert scaled.warmup_samples == round(recipe.warmup_samples / 10)


def test_scaled_to_next_to_nothing_leaves_a_batch_a_stage():
    assert [stage.samples for stage in small_recipe().scaled_to(1).stages] == [BATCH, BATCH]


def test_more_samples_do_not_lengthen_the_warm_up():
    recipe = small_recipe()
    assert recipe.scaled_to(100 * recipe.samples).warmup_samples == recipe.warmup_samples


def test_the_hash_survives_json():
    recipe = load_recipe("depthnet-256")
    written = json.dumps(recipe.model_dump(mode="json"), indent=2)
    assert Recipe.model_validate_json(written).digest == recipe.digest


KNOBS = {
    "seed": 2,
    "floor": 0.2,
    "scenes": {"frames": 4},
    "leaky_slope": 0.1,
    "batch_norm_momentum": 0.01,
    "optimizer": "sgd",
    "loss_space": "inverse-depth",
    "backward_pairs": False,
    "still_pairs": False,
    "pairs_per_scene": 10,
    "accumulate": 2,
}


@pytest.mark.parametrize(("knob", "value"), KNOBS.items())
def test_a_knob_that_is_turned_is_another_recipe(knob, value):
    assert small_recipe(**{knob: value}).digest != small_recipe().digest


def test_leaky_relu_takes_the_place_of_each_relu():
    network = network_of(small_recipe(leaky_slope=0.2))
    slopes = [module.negative_slope for module in network.modules() if isinstance(module, nn.LeakyReLU)]
    assert slopes == [0.2] * 14
    assert not any(isinstance(module, nn.ReLU) for module in network.modules())
    assert network.state_dict().keys() == network_of(small_recipe()).state_dict().keys()


def test_the_momentum_of_running_statistics():
    network = network_of(small_recipe(batch_norm_momentum=0.02))
    assert {m.momentum for m in network.modules() if isinstance(m, nn.BatchNorm2d)} == {0.02}


def frames_drawn(**changes):
    rule, rng = small_recipe(**changes).rule, np.random.default_rng(1)
    return [rule.draw_frames(rng, 10) for _ in range(400)]


def test_pairs_of_one_frame_can_be_left_out():
    assert any(previous == current for previous, current in frames_drawn())
    assert all(previous != current for previous, current in frames_drawn(still_pairs=False))


def test_backward_pairs_can_be_left_out():
    assert any(previous > current for previous, current in frames_drawn())
    assert all(previous <= current for previous, current in frames_drawn(backward_pairs=False))


def test_the_rest_of_the_draw_stays_when_pairs_are_left_out():
    together = zip(frames_drawn(), frames_drawn(backward_pairs=False), strict=True)
    assert all(sorted(either) == list(forward) for either, forward in together)


TABLE = [name for name in recipe_names() if name.startswith("table-")]


@pytest.mark.parametrize("name", TABLE)
def test_each_size_of_the_table_has_as_many_pairs(name):
    pairs = Counter()
    for stage in load_recipe(name).stages:
        if "-more" not in stage.name:
            pairs[stage.full_width] += stage.samples
    assert set(pairs.values()) == {PAIRS_A_SIZE}


@pytest.mark.parametrize("name", TABLE)
def test_what_the_table_shows_ends_on_whole_pictures(name):
    stages = [stage for stage in load_recipe(name).stages if not stage.name.endswith("-crops")]
    assert all(stage.width == stage.height == stage.full_width for stage in stages)


def compute(*stages):
    """Pixels seen."""
    return sum(stage.samples * stage.width * stage.height for stage in stages)


def test_512_alone_and_64_to_512_come_to_the_compute_of_the_chain():
    chain, alone, short = (
        load_recipe(name).stages for name in ("table-depthnet", "table-depthnet-512", "table-depthnet-64-512")
    )
    assert compute(*alone) == pytest.approx(compute(*chain), rel=0.001)
    assert compute(chain[0], *short) == pytest.approx(compute(*chain), rel=0.001)


def test_seeds_of_shipped_recipes_differ():
    seeds = [load_recipe(name).seed for name in recipe_names()]
    assert len(set(seeds)) == len(seeds)


def test_what_earlier_versions_wrote_of_a_second_size_is_passed_over():
    """Run folders and cards of theirs say `"finer": null`."""
    for kept in (load_recipe("depthnet-256"), read_network("depthnet-256").card):
        facts = kept.model_dump(mode="json")
        for each in facts["stages"]:
            each["finer"] = None
        assert type(kept).model_validate_json(json.dumps(facts)) == kept
    with pytest.raises(ValidationError, match="finer"):
        CardStage.model_validate(facts["stages"][0] | {"finer": [128, 64]})


def test_a_card_tells_all_that_a_stage_says():
    assert set(CardStage.model_fields) - {"focal_px"} == set(Stage.model_fields) - {"full_width"}


@pytest.mark.parametrize(
    ("right", "wrong", "said"),
    [
        ("full_width = 64", "full_width = 32", "stages.0: expected full_width of at least the width, 64"),
        (
            "batch = 10",
            "batch = 10\nfov_deg = [120.0, 55.0]",
            "stages.0: expected fov_deg of a smaller and a larger",
        ),
        (
            "batch = 10",
            "batch = 10\nfov_deg = [55.0, 200.0]",
            "stages.0: expected fov_deg of .* and 180 degrees",
        ),
        ("batch = 10", "batch = 10\nonly_last_look = true", "expected thorough_last_look"),
        (
            'activation = "none"',
            'activation = "elu+1"\narchitecture = "MotionNet"',
            "expected reference_focal_px, since a MotionNet is for any lens",
        ),
        ("seed = 0", "seed = -1", "seed: expected .*got -1"),
        ("depth_max_m = 60.0", "depth_max_m = 10.0", "expected depth_max_m of more than depth_min_m, 10"),
        ("\nheight = 64", "\nheight = 128", "stages.0: expected full_width of at least the height, 128"),
        (
            "full_width = 64\nwidth = 64",
            "photometric = true\nfull_width = 1088\nwidth = 1088",
            "expected pictures of at most 1024 px where there are camera effects",
        ),
        ('name = "64"', 'name = "checkpoint"', "expected a stage of another name than checkpoint"),
        ('name = "64"', 'name = "64/2"', "stages.0.name: expected a name without /"),
        (
            'name = "mine"',
            'name = "../mine"',
            "name: expected a name without / that does not begin with a dot",
        ),
        ('name = "mine"', 'name = ""', "name: expected a name without /"),
        ("learning_rate = 1e-3", "learning_rate = inf", "learning_rate: expected a finite number, got inf"),
        ("[[stages]]", "[scenes]\nframes = 1\n[[stages]]", "expected scenes of at least 2 frames"),
    ],
)
def test_what_would_fail_hours_later_is_told_at_once(written, right, wrong, said):
    with pytest.raises(BadInput, match=said):
        load_recipe(written(GOOD.replace(right, wrong)))


def test_two_stages_of_one_name_would_write_one_checkpoint(written):
    stage = GOOD[GOOD.index("[[stages]]") :]
    with pytest.raises(BadInput, match="expected stages of different names, not 64, 64"):
        load_recipe(written(GOOD + stage))


@pytest.mark.parametrize(
    ("right", "wrong", "said"),
    [
        ("seed = 0", "seed = 0\nlooks = 2", "expected no looks, which a DepthNet has no use for"),
        (
            "seed = 0",
            "seed = 0\nthorough_last_look = true",
            "expected no thorough_last_look, which a DepthNet",
        ),
        ("seed = 0", "seed = 0\nresidual_blocks = true", "expected no residual_blocks, which a DepthNet"),
        ("batch = 10", "batch = 10\ndirection_noise_deg = 2.0", "expected no direction_noise_deg"),
        ("seed = 0", 'seed = 0\narchitecture = "FlowNetS"\nleaky_slope = 0.2', "expected no leaky_slope"),
        (
            "seed = 0",
            'seed = 0\narchitecture = "FlowNetS"\nbatch_norm_momentum = 0.01',
            "expected no batch_norm_momentum, which a FlowNetS",
        ),
        (
            "seed = 0",
            'seed = 0\narchitecture = "MotionNet"\nreference_focal_px = 64.0',
            'expected activation = "elu\\+1"',
        ),
        (
            'activation = "none"',
            'activation = "elu+1"\narchitecture = "MotionNet"\nreference_focal_px = 64.0\nleaky_slope = 0.2',
            "expected no leaky_slope, which a MotionNet has no use for",
        ),
        # Their gradient is 0.
        (
            "seed = 0",
            'seed = 0\nloss_space = "inverse-depth"',
            'expected activation = "elu\\+1", since with loss_',
        ),
        ("batch = 10", "batch = 10\nphotometric_share = 0.3", "stages.0: expected photometric = true"),
        ("batch = 10", "batch = 10\nfov_deg = [55.0, 120.0]", "expected reference_focal_px, since a stage"),
        ("batch = 10", "batch = 10\nupright = true", "stages.0: expected open_share, of whose scenes"),
        ("batch = 10", "batch = 10\nobjects_for_lens = true", "stages.0: expected fov_deg, for whose lenses"),
        ("[[stages]]", "[scenes]\nopen_share = 0.5\n[[stages]]", "expected open_share in each stage, not in"),
    ],
)
def test_what_would_be_passed_over_in_silence_is_refused(written, right, wrong, said):
    with pytest.raises(BadInput, match=said):
        load_recipe(written(GOOD.replace(right, wrong)))
