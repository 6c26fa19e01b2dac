"""`flightdepth train --set`: a network that learns from a set on the disk."""

import json
import re
import shutil
from functools import partial
from pathlib import Path

import pytest
import torch
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from flightdepth import cli
from flightdepth.commands.export import card_of
from flightdepth.errors import BadInput
from flightdepth.scenes import Textures
from flightdepth.stillbox.stored import open_stored_set
from flightdepth.stillbox.stored_pairs import StoredPairs
from flightdepth.training import held_out, loop
from flightdepth.training.run_folder import keep_sets, keep_textures, read_trained
from tests_recipes import recipe_text, stage_text

RECIPE = recipe_text(stage_text("square", 12), loss="l1")
TRAIN = ("train", "small.toml", "--set", "stillbox")


@pytest.fixture(scope="module")
def stillbox(tmp_path_factory):
    """Ten scenes of 64 px."""
    folder = tmp_path_factory.mktemp("sets") / "stillbox"
    assert cli.main(["render", "64", "--scenes", "10", "--procedural", "2", "--out", str(folder)]) == 0
    return folder


@pytest.fixture(autouse=True)
def small_world(stillbox, monkeypatch, tmp_path):
    """A recipe and a set in a folder to work in; eight scenes in the pool, one thread."""
    monkeypatch.setattr(loop, "StoredPairs", partial(StoredPairs, pool_scenes=8))
    monkeypatch.setattr(held_out, "PAIRS", held_out.AT_ONCE)
    monkeypatch.chdir(tmp_path)
    Path("small.toml").write_text(RECIPE)
    shutil.copytree(stillbox, "stillbox")
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def test_a_run_names_its_set(capsys):
    assert cli.main([*TRAIN]) == 0
    out = capsys.readouterr().out
    assert "stillbox: 10 scenes of 64x64 px, four fifths of them to learn from" in out
    assert "textures" not in out
    used = json.loads(Path("runs/small/sets.json").read_text())
    assert (used["64"]["scenes"], used["64"]["renderer"][:7]) == (8, "raycast")


def test_the_card_says_so():
    cli.main([*TRAIN])
    assert card_of(read_trained(Path("runs/small")), "small").renderer.startswith("stored: raycast-")


def test_a_stopped_run_goes_on_to_the_same_bytes(monkeypatch):
    assert cli.main([*TRAIN, "--runs", "whole"]) == 0
    step = loop.Learner.step

    def stopped(learner, batch, stage, sample):
        if sample == 8:
            raise KeyboardInterrupt
        return step(learner, batch, stage, sample)

    with monkeypatch.context() as patch:
        patch.setattr(loop.Learner, "step", stopped)
        patch.setattr(loop, "train", partial(loop.train, checkpoint_every_s=0))
        assert cli.main([*TRAIN]) == 130
    assert cli.main([*TRAIN, "--resume"]) == 0
    ends = [Path(runs, "small", "checkpoint.safetensors").read_bytes() for runs in ("whole", "runs")]
    assert ends[0] == ends[1]


def test_the_test_error_is_of_scenes_that_are_held_out(monkeypatch):
    opened, batches = [], held_out.HeldOut.batches

    def watched(self, *given, **named):
        opened.append(self.sets[64].digest)
        return batches(self, *given, **named)

    monkeypatch.setattr(held_out.HeldOut, "batches", watched)
    assert cli.main([*TRAIN]) == 0
    learnt_from, left_out = open_stored_set(Path("stillbox")).split()
    assert opened == [left_out.digest]
    assert json.loads(Path("runs/small/sets.json").read_text())["64"]["sha256"] == learnt_from.digest
    curves = EventAccumulator("runs/small/tensorboard").Reload()
    assert [point.step for point in curves.Scalars("test/l1_m")] == [12]


@pytest.mark.parametrize(("option", "value"), [("--textures", "photos"), ("--procedural", "2")])
def test_textures_beside_a_set_would_dress_nothing(option, value, capsys):
    """`--procedural` was passed over."""
    assert cli.main([*TRAIN, option, value]) == 2
    assert f"--set: expected no {option} beside it, got {value}" in capsys.readouterr().err


def test_another_set_is_another_run(capsys):
    cli.main([*TRAIN])
    cli.main(["render", "64", "--scenes", "10", "--seed", "2", "--procedural", "2", "--out", "other"])
    assert cli.main(["train", "small.toml", "--set", "other", "--resume"]) == 2
    assert "stored sets of run runs/small: expected those that it began with" in capsys.readouterr().err


def test_drawn_scenes_are_another_run(capsys):
    cli.main([*TRAIN])
    assert cli.main(["train", "small.toml", "--procedural", "2", "--resume"]) == 2
    error = capsys.readouterr().err
    assert "stored sets of run runs/small: expected those that it began with (sets.json), got none" in error


def test_a_run_of_drawn_scenes_does_not_go_on_with_a_set(tmp_path):
    textures = Textures.from_images([])  # as beside a set
    keep_sets(tmp_path, {})
    keep_textures(tmp_path, textures)
    keep_sets(tmp_path, {})
    with pytest.raises(BadInput, match=r"stored sets of run .*: expected none, as it began, got stillbox"):
        keep_sets(tmp_path, {64: open_stored_set(Path("stillbox"))})


def test_a_set_too_small_to_be_parted_is_one_line(capsys):
    """Four fifths of one scene are none."""
    cli.main(["render", "64", "--scenes", "1", "--procedural", "2", "--out", "one"])
    assert cli.main(["train", "small.toml", "--set", "one"]) == 2
    assert "set one: expected a scene to learn from, got none" in capsys.readouterr().err


def test_a_stage_without_a_set_is_one_line(capsys):
    Path("small.toml").write_text(RECIPE.replace("full_width = 64", "full_width = 128"))
    assert cli.main([*TRAIN]) == 2
    assert capsys.readouterr().err == (
        "error: --set: expected a set of 128 px for stage square, got stillbox of 64 px."
        " Give --set once for each width.\n"
    )


def test_a_damaged_picture_is_one_line(capsys):
    for path in Path("stillbox/00").glob("RGB_*_00.jpg"):
        path.write_bytes(b"")
    assert cli.main([*TRAIN]) == 2
    assert "picture stillbox/00/RGB_" in capsys.readouterr().err


def test_a_shipped_network_goes_on_from_scenes_of_ones_own(capsys):
    """The recipe that docs/stillbox-disk.md prints, with few pairs."""
    text = (Path(__file__).parents[2] / "docs" / "stillbox-disk.md").read_text("utf-8")
    (recipe,) = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    Path("mine.toml").write_text(recipe.replace("samples = 4000", "samples = 16"))
    assert cli.main(["train", "mine.toml", "--set", "stillbox"]) == 0
    assert "goes on from motion-tiny, which ships" in capsys.readouterr().out


def test_the_line_that_a_refused_set_proposes_is_taken(capsys):
    """Found in review: of a field of view by a focal length it kept six digits, and was refused again."""
    for path in Path("stillbox").glob("*/metadata.json"):
        path.write_text(path.read_text().replace('"fov": 90.0', '"fov": 73.7397909945048'))
    assert cli.main([*TRAIN]) == 2
    line = capsys.readouterr().err.strip().rpartition(": ")[2].rstrip(".")
    Path("small.toml").write_text(f"{RECIPE}\n[scenes]\n{line}\n")
    assert cli.main([*TRAIN]) == 0


def test_a_set_of_another_lens_or_speed_is_refused_before_there_is_a_run(capsys):
    """The run's folder was there by then, and had to be removed before the mended recipe could run."""
    for key, own in (("horizontal_fov_deg", 90.0), ("speed_m_s", 1)):
        Path("small.toml").write_text(f"{RECIPE}\n[scenes]\n{key} = {0.8 * own}\n")
        assert cli.main([*TRAIN]) == 2
        assert capsys.readouterr().err.strip().endswith(f"Write under [scenes] of the recipe: {key} = {own}.")
        assert not Path("runs/small").exists()
