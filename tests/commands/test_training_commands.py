"""train, export, evaluate and render on the command line, with a network and a set of next to no size."""

import errno
import json
import os
import re
import signal
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from flightdepth import cli
from flightdepth.commands import export
from flightdepth.commands.signals import stop_request
from flightdepth.evaluation import int8_ranges, peer
from flightdepth.files import held
from flightdepth.scenes.config import SET_VERSION
from flightdepth.training import checkpoint, held_out, learner, loop
from flightdepth.training.checkpoint import read_progress, read_weights
from flightdepth.training.export import weights_of
from flightdepth.weights.store import read_network
from tests_recipes import recipe_text, stage_text

pytestmark = pytest.mark.usefixtures("quick_exports", "few_fixed_textures")

TOML = recipe_text(
    stage_text("square", 8), stage_text("wide", 4, width=128, more="photometric = true"), clamped=True
)
TRAIN = ("train", "small.toml", "--procedural", "2")


@pytest.fixture(autouse=True)
def small_world(monkeypatch, tmp_path):
    """Eight scenes in the pool, one thread, and a folder of its own to work in."""
    monkeypatch.setattr(loop, "pool_scenes", lambda _: 8)
    monkeypatch.setattr(held_out, "SCENES", 8)
    monkeypatch.setattr(held_out, "PAIRS", held_out.AT_ONCE)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.toml").write_text(TOML)
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """A folder with a finished run and its network, exported once."""
    folder = tmp_path_factory.mktemp("exported")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(loop, "pool_scenes", lambda _: 8)
        patch.setattr(held_out, "PAIRS", held_out.AT_ONCE)
        patch.setattr(int8_ranges, "SHARES", (1.0,))
        patch.chdir(folder)
        (folder / "small.toml").write_text(TOML)
        assert cli.main([*TRAIN]) == 0
        assert cli.main(["export", "runs/small", "--scenes", "3"]) == 0
    return folder


def test_two_trainings_do_not_share_a_folder(capsys):
    with held(Path("runs/small"), "run folder", "training", "wait"):
        assert cli.main([*TRAIN, "--resume"]) == 2
    assert "expected no other training in it, got one that is running" in capsys.readouterr().err
    assert not any(Path("runs/small").iterdir())
    assert cli.main([*TRAIN]) == 0  # and the refusal left nothing in the way


def test_train_says_what_it_does_and_what_comes_next(capsys):
    assert cli.main([*TRAIN]) == 0
    out = capsys.readouterr().out
    assert "small: 12 pairs in stages square (64x64 px, 8), wide (128x64 px, 4)" in out
    assert "textures: 2 procedural" in out
    assert "next: flightdepth export runs/small" in out


def test_train_shows_lines_where_there_is_no_terminal(monkeypatch, capsys):
    monkeypatch.setattr("flightdepth.commands.terminal.TOLD_EVERY_S", 0.0)
    cli.main([*TRAIN])
    lines = [line for line in capsys.readouterr().out.splitlines() if " of 12 samples, " in line]
    assert re.match(r"stage wide, loss \d+\.\d{3} m, test \d+\.\d{3} m: 12 of 12 samples, ", lines[-1])
    assert lines[0].startswith("stage square, loss ")
    assert [line.split(": ")[1].split(" of ")[0] for line in lines] == ["4", "8", "12"]


def test_a_folder_that_somebody_looked_into_is_a_new_run_s(capsys):
    Path("runs/small").mkdir(parents=True)
    Path("runs/small/.DS_Store").write_bytes(b"Bud1")
    assert cli.main([*TRAIN]) == 0


def test_a_run_is_not_overwritten(capsys):
    cli.main([*TRAIN])
    before = Path("runs/small/checkpoint.safetensors").stat().st_mtime_ns
    assert cli.main([*TRAIN]) == 2
    error = capsys.readouterr().err
    assert error == (
        "error: run folder runs/small: expected a new one, got one with files in it."
        " Go on with it: --resume; or train elsewhere: --runs DIR.\n"
    )
    assert Path("runs/small/checkpoint.safetensors").stat().st_mtime_ns == before


def test_resume_says_where_there_is_nothing_to_resume(capsys):
    assert cli.main([*TRAIN, "--resume"]) == 0
    assert "no checkpoint in runs/small to resume: the run begins" in capsys.readouterr().out


def test_resume_tells_of_other_versions(monkeypatch, capsys):
    assert cli.main([*TRAIN]) == 0
    assert cli.main([*TRAIN, "--resume"]) == 0
    assert capsys.readouterr().err == ""
    now = checkpoint.versions()
    monkeypatch.setattr(checkpoint, "versions", lambda: now | {"torch": "99.1"})
    assert cli.main([*TRAIN, "--resume"]) == 0
    assert capsys.readouterr().err == (
        f"warning: runs/small/checkpoint.safetensors is by torch {now['torch']}, here 99.1:"
        " what it goes on to may be other bytes\n"
    )


def test_samples_scale_the_recipe():
    assert cli.main([*TRAIN, "--samples", "24"]) == 0
    assert read_progress("runs/small/checkpoint.safetensors").seen == 24


@pytest.fixture
def minded():
    """A lost terminal counts, as it would not where the tests run under `nohup`."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize(
    "sent", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP], ids=["ctrl-c", "sigterm", "sighup"]
)
def test_a_signal_saves_and_resume_ends_as_if_nothing_had_been(sent, exported, monkeypatch, capsys, minded):
    step, pressed = loop.Learner.step, []

    def step_with_signal(*arguments):
        if not pressed:
            pressed.append(True)
            os.kill(os.getpid(), sent)
        return step(*arguments)

    monkeypatch.setattr(loop.Learner, "step", step_with_signal)
    assert cli.main([*TRAIN]) == 130
    assert "--resume goes on" in capsys.readouterr().out
    assert read_progress("runs/small/checkpoint.safetensors").seen == 4
    assert cli.main([*TRAIN, "--resume"]) == 0
    ends = [Path(work, "runs/small/checkpoint.safetensors").read_bytes() for work in (exported, ".")]
    assert ends[0] == ends[1]


def test_a_full_disk_says_how_to_go_on(monkeypatch, capsys):
    """Once all that was said was `[Errno 28] No space left on device`."""
    save, first = learner.save_checkpoint, []

    def full(path, *given):
        if first:
            raise OSError(errno.ENOSPC, "No space left on device")
        first.append(save(path, *given))

    with monkeypatch.context() as patch:
        patch.setattr(learner, "save_checkpoint", full)
        assert cli.main([*TRAIN]) == 3
    assert capsys.readouterr().err == (
        "error: no room left on the disk of runs/small; what stands there is valid."
        " Free some room and give the same command with --resume\n"
    )
    assert cli.main([*TRAIN, "--resume"]) == 0


def test_a_lost_terminal_that_is_ignored_stays_ignored(monkeypatch):
    """As `nohup` has it."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with stop_request() as stop:
            os.kill(os.getpid(), signal.SIGHUP)
            assert not stop.is_set()
    finally:
        signal.signal(signal.SIGHUP, before)


def test_ctrl_c_is_ctrl_c_again_after_training():
    before = signal.getsignal(signal.SIGINT)
    cli.main([*TRAIN])
    assert signal.getsignal(signal.SIGINT) is before


def test_photos_are_counted(tmp_path, capsys):
    (tmp_path / "photos").mkdir()
    cv2.imwrite(str(tmp_path / "photos" / "a.png"), np.zeros((40, 60, 3), np.uint8))
    assert cli.main([*TRAIN, "--textures", "photos"]) == 0
    assert "textures: 1 photos from photos, 2 procedural" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["train", "nothing"], "recipe: expected a .toml file or one of clamped-256, depthnet-256"),
        (["train", "small.toml", "--textures", "nowhere"], "--textures: expected a folder of images"),
        (
            ["train", "small.toml", "--runs", "small.toml"],
            "--runs: expected a folder, got the file small.toml",
        ),
        (["train", "small.toml", "--procedural", "0"], "--procedural: expected at least 1"),
        (["export", "nowhere"], "checkpoint nowhere"),
        (["export", "small.toml"], "expected a checkpoint of flightdepth train"),
        (["export", "runs/small", "--name", "a/b"], "--name: expected a name without /"),
        (["export", "runs/small", "--name", ""], "--name: expected a name without /"),
        (["evaluate", "network", "nothing"], "network: expected a path to an ONNX file"),
    ],
)
def test_bad_input_is_one_line(arguments, said, capsys):
    assert cli.main(arguments) == 2
    error = capsys.readouterr().err
    assert said in error
    assert len(error.splitlines()) == 1


def test_without_the_extra_it_says_which(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "flightdepth.training", None)
    for name in [name for name in sys.modules if name.startswith("flightdepth.training")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "accelerate", None)
    assert cli.main([*TRAIN]) == 3
    assert "pip install 'flightdepth[train]'" in capsys.readouterr().err


def test_the_card_holds_the_facts(exported):
    card = read_network(exported / "small.onnx").card
    assert (card.name, card.base_width, card.activation) == ("small", 4, "none")
    assert (card.D0_m, card.depth_min_m, card.depth_max_m) == (pytest.approx(0.5), 10, 60)
    assert (card.focal_px, card.width, card.height, card.samples) == (64, 128, 64, 12)
    assert (card.set_version, card.seed) == (SET_VERSION, 3)
    assert card.renderer.startswith("raycast")


def test_the_card_lists_the_stages(exported):
    square, wide = read_network(exported / "small.onnx").card.stages
    assert (square.name, square.width, square.focal_px, square.samples) == ("square", 64, 32, 8)
    assert (wide.name, wide.height, wide.photometric, wide.samples) == ("wide", 64, True, 4)


def test_the_card_holds_the_errors(exported):
    metrics = read_network(exported / "small.onnx").card.metrics
    names = {"scenes", "l1_m", "rmse_m", "abs_rel", "delta_125", "constant_l1_m", "classical_l1_m"}
    assert names <= metrics.keys()
    assert metrics["scenes"] == 3
    assert metrics["constant_l1_m"] > 0


@pytest.fixture(scope="module")
def halfway(exported):
    """The network of a stage's end, and its mean with that of the run's end."""
    end = "runs/small/square.safetensors"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(int8_ranges, "fitted_int8_ranges", lambda *_: {})
        patch.chdir(exported)
        command = ["export", end, "--name", "halfway", "--mean-with", "small.onnx", "--scenes", "1"]
        assert cli.main(command) == 0
    return read_network(exported / "halfway.onnx")


def test_a_checkpoint_within_a_run_says_how_far_it_came(halfway):
    card = halfway.card
    assert [(stage.name, stage.samples) for stage in card.stages] == [("square", 8)]
    assert (card.focal_px, card.samples) == (32, 8)


def test_the_mean_with_another_network_is_told_and_lies_half_way(exported, halfway):
    other = read_network(exported / "small.onnx")
    assert halfway.card.mean_with == other.card.sha256
    trained = read_weights(exported / "runs/small/square.safetensors", "averaged")
    after, mean = weights_of(other.onnx), weights_of(halfway.onnx)
    for name, weights in mean.items():
        if weights.is_floating_point():
            torch.testing.assert_close(weights, (trained[name] + after[name]) / 2, rtol=2e-3, atol=1e-4)
    assert not torch.allclose(mean["conv1.0.weight"], after["conv1.0.weight"], rtol=2e-3, atol=1e-4)


def test_there_is_no_mean_of_two_architectures(exported, capsys):
    assert cli.main(["export", str(exported / "runs/small"), "--mean-with", "tiny-clamped-256"]) == 2
    assert "--mean-with: expected a network of the run's architecture" in capsys.readouterr().err


def test_evaluate_agrees_with_the_card(exported, capsys):
    arguments = [
        "evaluate",
        "network",
        str(exported / "small.onnx"),
        "--scenes",
        "3",
        "--json",
        "figures.json",
    ]
    assert cli.main(arguments) == 0
    figures = json.loads(Path("figures.json").read_text())
    card = read_network(exported / "small.onnx").card
    assert figures["network"]["l1_m"] == pytest.approx(card.metrics["l1_m"], rel=1e-6)
    assert {"commit", "weights_sha256", "samples", "seed"} <= figures.keys()
    assert "small on Still Box 128 px, shift 5, 3 pairs" in capsys.readouterr().out


def test_evaluate_writes_pictures(exported, tmp_path):
    (tmp_path / "seen").mkdir()
    network = str(exported / "small.onnx")
    assert cli.main(["evaluate", "network", network, "--scenes", "2", "--pictures", "seen"]) == 0
    assert sorted(path.name for path in (tmp_path / "seen").iterdir()) == ["000.png", "001.png"]


@pytest.mark.parametrize("options", ["--scenes 1", "--outdoor --scenes 1", "--textures DIR --scenes 1"])
def test_a_page_repeats_the_options_that_it_was_made_with(options, exported, tmp_path):
    """Once a page of flights outdoors named the command that measures rooms."""
    (tmp_path / "photos").mkdir()
    cv2.imwrite(str(tmp_path / "photos/one.png"), np.full((8, 8, 3), 90, np.uint8))
    given = options.replace("DIR", "photos").split()
    assert cli.main(["evaluate", "network", str(exported / "small.onnx"), *given, "--report", "pages"]) == 0
    page = (tmp_path / "pages/small.md").read_text()
    assert f"`flightdepth evaluate network small {options} --report DIR`" in page


def test_a_run_whose_peer_can_tell_nothing_is_exported(exported, tmp_path, monkeypatch, capsys):
    """Once an export of a network with a short displacement and a wide lens ended in a traceback."""
    monkeypatch.setattr(export, "with_int8_ranges", lambda card, *_: card)
    monkeypatch.setattr(export, "PRECISIONS", ())
    monkeypatch.setattr(peer, "BLIND_PX", 1e9)
    run = str(exported / "runs/small")
    assert cli.main(["export", run, "--scenes", "1", "--full-precision", "--out", "blind"]) == 0
    out = capsys.readouterr().out
    assert "classical peer - m" in out
    # Once both were called a test set.
    assert [line.split(" ━")[0] for line in out.splitlines() if "━" in line] == ["test set", "calibration"]
    assert "classical_l1_m" not in read_network(tmp_path / "blind/small.onnx").card.metrics


def test_evaluate_noise_writes_what_it_takes_to_repeat_it(exported):
    network = str(exported / "small.onnx")
    assert cli.main(["evaluate", "noise", network, "--scenes", "1", "--json", "noise.json"]) == 0
    figures = json.loads(Path("noise.json").read_text())
    assert {"commit", "seed", "noise_seed", "scenes", "set"} <= figures.keys()
    card = read_network(exported / "small.onnx").card
    assert [each["weights_sha256"] for each in figures["networks"]] == [card.sha256]
    assert {row["size"] for row in figures["rows"]} >= {0.0, 0.05, 10.0}


def test_going_on_from_a_shipped_network_takes_its_name(capsys):
    """It said that a path to an ONNX file was expected."""
    assert cli.main([*TRAIN, "--shipped"]) == 2
    message = capsys.readouterr().err
    assert "--shipped: expected a recipe by the name of a network that ships: " in message
    assert "got small. Keep that name, or write starts_from" in message
    assert not Path("runs").exists()
