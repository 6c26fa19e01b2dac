"""Several processes do what one does with accumulation steps; shares of a batch; batch statistics."""

import json
import os
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest
import torch
import training_runs
from torch import nn
from training_runs import BATCH, free_port, small_pool, small_recipe, small_textures, stage

from flightdepth import cli
from flightdepth.errors import BadInput
from flightdepth.training import learner, loop, precision
from flightdepth.training.checkpoint import read_progress, read_weights
from flightdepth.training.loop import train
from flightdepth.training.processes import Share, weigh_part


@pytest.fixture(scope="module")
def two_processes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("two") / "small"
    training_runs.each_of_two(training_runs.learnt_by_several, folder)
    return folder


@pytest.fixture(scope="module")
def two_accumulation_steps(tmp_path_factory):
    folder = tmp_path_factory.mktemp("one") / "small"
    losses = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(loop, "pool_scenes", small_pool)
        patch.setattr(learner, "mixed_precision", lambda _: "no")  # as in the processes
        recipe, textures = small_recipe(accumulate=2), small_textures()
        train(recipe, textures, folder, resume=False, report=lambda step: losses.append(step.loss_m))
    return folder, losses


def test_two_processes_have_the_loss_curve_of_two_accumulation_steps(two_processes, two_accumulation_steps):
    for process in range(2):
        losses = json.loads((two_processes / f"losses-{process}.json").read_text())
        assert losses == pytest.approx(two_accumulation_steps[1], rel=1e-5)


@pytest.mark.parametrize("part", ["network", "averaged"])
def test_two_processes_end_in_the_weights_of_two_accumulation_steps(
    two_processes, two_accumulation_steps, part
):
    """Batch statistics too, though each process saw only its own."""
    found, expected = (
        read_weights(folder / "checkpoint.safetensors", part)
        for folder in (two_processes, two_accumulation_steps[0])
    )
    for key, value in expected.items():
        if value.is_floating_point():
            assert torch.allclose(found[key], value, rtol=1e-3, atol=1e-4), key


def says_its_precision(folder):
    rank = os.environ["RANK"]
    precision.cpu_runs_bf16 = lambda: True
    precision.cpu_gains_by_bf16 = lambda: rank == "1"
    (folder / rank).write_text(precision.mixed_precision())


def test_processes_agree_on_their_precision(tmp_path):
    """One that timed beside other work computed in float32, and the other waited for it: a third slower."""
    training_runs.each_of_two(says_its_precision, tmp_path)
    assert [(tmp_path / rank).read_text() for rank in "01"] == ["bf16", "bf16"]


def test_parts_see_other_pairs_than_the_whole(two_accumulation_steps, tmp_path, monkeypatch):
    monkeypatch.setattr(loop, "pool_scenes", small_pool)
    losses = []
    recipe = small_recipe(stages=[stage("a", 1)])
    train(recipe, small_textures(), tmp_path, resume=False, report=lambda step: losses.append(step.loss_m))
    assert losses[0] != pytest.approx(two_accumulation_steps[1][0], rel=1e-4)


@pytest.mark.parametrize(
    ("accumulate", "processes", "parts", "shares"),
    [
        (1, 1, 1, [[0]]),
        (2, 1, 2, [[0, 1]]),
        (1, 2, 2, [[0], [1]]),
        (4, 2, 4, [[0, 1], [2, 3]]),
        (4, 4, 4, [[0], [1], [2], [3]]),
    ],
)
def test_each_part_has_one_process(accumulate, processes, parts, shares):
    recipe = small_recipe(accumulate=accumulate, stages=[stage("a", 1) | {"batch": 8}])
    found = [Share.of(recipe, process, processes) for process in range(processes)]
    assert [list(share.mine) for share in found] == shares
    assert {share.parts for share in found} == {parts}


@pytest.mark.parametrize(
    ("accumulate", "processes", "said"),
    [
        (1, 3, f"batch of stage a: expected a multiple of 3, got {BATCH}"),
        (4, 3, "accumulate: expected a multi"),
        (4, 1, f"batch of stage a: expected at least 8: batch norm .*, got {BATCH}"),
    ],
)
def test_what_cannot_be_shared_is_refused(accumulate, processes, said):
    with pytest.raises(BadInput, match=said):
        Share.of(small_recipe(accumulate=accumulate), 0, processes)


@pytest.mark.parametrize("parts", [1, 2, 3])
def test_running_statistics_move_towards_the_mean_of_the_parts(parts):
    pictures = torch.randn((parts, 5, 2, 4, 4), generator=torch.Generator().manual_seed(1)) + 3
    norm = nn.BatchNorm2d(2)
    for number, part in enumerate(pictures):
        weigh_part(norm, 0.1, number, parts)
        norm(part)
    means = pictures.mean(dim=(0, 1, 3, 4))  # of parts of one size: the mean of their means
    assert torch.allclose(norm.running_mean, 0.1 * means)
    variances = torch.stack([part.transpose(0, 1).flatten(1).var(dim=1) for part in pictures]).mean(dim=0)
    assert torch.allclose(norm.running_var, 0.9 + 0.1 * variances)


def motion_stages(*only_last_look):
    return [
        stage(name, 2) | {"only_last_look": only} for name, only in zip("abc", only_last_look, strict=False)
    ]


def motion_recipe(stages):
    facts = {"architecture": "MotionNet", "thorough_last_look": True, "reference_focal_px": 32.0}
    return small_recipe(looks=2, stages=stages, **facts)


@pytest.mark.parametrize(
    ("stages", "first", "some_may_be_unused"),
    [
        ((False, True), 0, True),
        ((False, True), 1, True),
        ((True, False), 1, False),
        ((False, False), 0, False),
    ],
)
def test_unused_parameters_are_looked_for_only_where_a_stage_to_come_leaves_some(
    stages, first, some_may_be_unused
):
    learnt = learner.Learner(motion_recipe(motion_stages(*stages)))
    learnt.prepare(first)
    assert learnt.accelerator.ddp_handler.find_unused_parameters == some_may_be_unused


RECIPES = {
    "DepthNet": small_recipe(stages=[stage("a", 2)]),
    "MotionNet": motion_recipe(motion_stages(False)),
    "MotionNet's last look": motion_recipe(motion_stages(True)),
}


IN_SMALL_POOLS = """
import sys

from flightdepth import cli
from flightdepth.training import loop

loop.pool_scenes = lambda _: 8
sys.exit(cli.main())
"""
TRAIN = ("train", "small.toml", "--procedural", "2")


def write_recipe(recipe, path):
    facts = recipe.model_dump(mode="json", exclude_defaults=True)
    (first,) = facts.pop("stages")
    lines = [f"{key} = {json.dumps(value)}" for key, value in facts.items() if key != "scenes"]
    lines += ["[[stages]]", *(f"{key} = {json.dumps(value)}" for key, value in first.items())]
    path.write_text("\n".join(lines))


def check(folder, told):
    """Without a warning of PyTorch's: MotionNet's runs had one of parameters that were sought and not found."""
    assert "find_unused_parameters" not in told
    assert told.count("2 processes, which share each batch") == 1
    assert told.count("next: flightdepth export") == 1
    progress = read_progress(folder / "runs" / "small" / "a.safetensors")
    assert (progress.seen, progress.parts) == (2 * BATCH, 2)


def trains_by_command(folder):
    os.chdir(folder)
    with Path(f"told-{os.environ['RANK']}").open("w") as told, redirect_stdout(told), redirect_stderr(told):
        os.dup2(told.fileno(), 2)  # PyTorch warns there
        assert cli.main(list(TRAIN)) == 0


# What DepthNet learns in two processes is looked at above, and what warned of MotionNet's parameters.
SLOW = dict.fromkeys(("DepthNet", "MotionNet"), pytest.mark.slow)


@pytest.mark.parametrize(
    "recipe", [pytest.param(each, id=name, marks=SLOW.get(name, ())) for name, each in RECIPES.items()]
)
def test_the_command_trains_in_two_processes(tmp_path, recipe):
    write_recipe(recipe, tmp_path / "small.toml")
    training_runs.each_of_two(trains_by_command, tmp_path)
    check(tmp_path, "".join((tmp_path / f"told-{rank}").read_text() for rank in range(2)))


@pytest.mark.slow
@pytest.mark.parametrize("recipe", [pytest.param(each, id=name) for name, each in RECIPES.items()])
def test_torchrun_trains_in_two_processes(tmp_path, recipe):
    write_recipe(recipe, tmp_path / "small.toml")
    launch = ["-m", "torch.distributed.run", "--nproc_per_node", "2", "--master_port", str(free_port())]
    (tmp_path / "in_small_pools.py").write_text(IN_SMALL_POOLS)
    command = [sys.executable, *launch, "in_small_pools.py", *TRAIN]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=900, check=False)
    assert done.returncode == 0, done.stderr
    check(tmp_path, done.stdout + done.stderr)
