"""The loop: exact resume after any end, stages, what a run keeps, and that it really is bf16, channels last."""

import hashlib
import math
import multiprocessing
import os
import shutil
import signal
import time
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
import torch
import training_runs
from onnx import helper, numpy_helper
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from training_runs import BATCH, STEPS, small_recipe, small_stream, small_textures, stage

import flightdepth
from flightdepth.commands.export import card_of
from flightdepth.errors import BadInput, FlightDepthError
from flightdepth.files import write_json
from flightdepth.stillbox.stored import StoredSet
from flightdepth.training import held_out as held_out_pairs
from flightdepth.training import learner, loop, precision
from flightdepth.training.checkpoint import read_progress, read_weights
from flightdepth.training.export import deployed, weights_of
from flightdepth.training.held_out import HeldOut
from flightdepth.training.inputs import TensorBatch, normalised
from flightdepth.training.learner import Learner, mixed_precision
from flightdepth.training.loop import train
from flightdepth.training.processes import Share
from flightdepth.training.run_folder import CHECKPOINT, PARENT, RECIPE, SHIPPED, read_trained
from flightdepth.training.schedule import learning_rate
from flightdepth.training.start import start_of
from flightdepth.weights.card import NetworkCard
from flightdepth.weights.card import Stage as CardStage
from flightdepth.weights.store import StoredNetwork, read_network


class PowerCutError(Exception):
    pass


@pytest.fixture(autouse=True)
def small_pool(monkeypatch):
    monkeypatch.setattr(loop, "pool_scenes", training_runs.small_pool)


def run(folder, *, recipe=None, cut_after=None, textures=None, **options):
    """Losses reported, until the end or until `cut_after` steps, when the loop is torn out of its work.

    One that is to be cut keeps each step.
    """
    losses = []

    def report(step):
        losses.append(step.loss_m)
        if len(losses) == cut_after:
            raise PowerCutError

    options = {"resume": False, "checkpoint_every_s": 0.0 if cut_after else 1e9} | options
    try:
        train(recipe or small_recipe(), textures or small_textures(), folder, report=report, **options)
    except PowerCutError:
        assert cut_after is not None
    return losses


def run_once(tmp_path_factory, **options):
    """An uninterrupted run, for several tests: its folder and its losses."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(loop, "pool_scenes", training_runs.small_pool)
        folder = tmp_path_factory.mktemp("whole") / "small"
        return folder, run(folder, **options)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return run_once(tmp_path_factory)


@pytest.fixture(scope="module")
def whole_by_two(tmp_path_factory):
    """Of two workers."""
    return run_once(tmp_path_factory, workers=2)


MUON_LATER = small_recipe(stages=[stage("a", 2), stage("b", 2) | {"optimizer": "muon"}])


@pytest.fixture(scope="module")
def whole_with_muon(tmp_path_factory):
    return run_once(tmp_path_factory, recipe=MUON_LATER)


def checkpoint(folder):
    return (folder / "checkpoint.safetensors").read_bytes()


def test_two_runs_are_the_same_to_the_byte(whole, tmp_path):
    assert run(tmp_path) == whole[1]
    assert checkpoint(tmp_path) == checkpoint(whole[0])


@pytest.mark.parametrize("steps", [1, 3, 4, 5])  # before any checkpoint, in stage a, at its end, in stage b
def test_resume_is_exact(whole, tmp_path, steps):
    run(tmp_path, cut_after=steps)
    later = run(tmp_path, resume=True)
    assert later == whole[1][steps - 1 :]  # the step that was reported but not saved comes again
    assert checkpoint(tmp_path) == checkpoint(whole[0])


def test_resume_is_exact_with_a_checkpoint_long_ago(whole, tmp_path):
    ticks = iter(range(10**6))
    run(tmp_path, cut_after=4, checkpoint_every_s=4.0, clock=lambda: float(next(ticks)))
    assert 0 < read_progress(tmp_path / "checkpoint.safetensors").sample < 3 * BATCH
    run(tmp_path, resume=True)
    assert checkpoint(tmp_path) == checkpoint(whole[0])


def test_resume_is_exact_after_a_kill(whole, tmp_path):
    run_to_be_killed = training_runs.beside(training_runs.killed_after, 4, tmp_path, mixed_precision())
    run_to_be_killed.join(timeout=240)
    assert run_to_be_killed.exitcode == -signal.SIGKILL
    run(tmp_path, resume=True)
    assert checkpoint(tmp_path) == checkpoint(whole[0])


@pytest.mark.parametrize("begun_in", ["bf16", "no"])
def test_a_run_goes_on_in_what_it_was_begun_in(tmp_path, monkeypatch, begun_in):
    """Which is faster is timed: on a busy processor a resumed run went on in the other one, without a word."""
    monkeypatch.setattr(precision, "cpu_runs_bf16", lambda: True)
    monkeypatch.setattr(precision, "cpu_gains_by_bf16", lambda: begun_in == "bf16")
    recipe = small_recipe(stages=[stage("a", 2)])
    losses = run(tmp_path / "whole", recipe=recipe)
    run(tmp_path / "cut", recipe=recipe, cut_after=1)
    monkeypatch.setattr(precision, "cpu_gains_by_bf16", lambda: begun_in != "bf16")
    assert run(tmp_path / "cut", recipe=recipe, resume=True) == losses
    assert checkpoint(tmp_path / "cut") == checkpoint(tmp_path / "whole")


def test_a_stop_saves_the_step_just_done(whole, tmp_path):
    losses = []
    options = {"resume": False, "report": losses.append, "stop": lambda: len(losses) == 2}
    path = train(small_recipe(), small_textures(), tmp_path, **options)
    assert read_progress(path).sample == 2 * BATCH
    assert run(tmp_path, resume=True) == whole[1][2:]
    assert checkpoint(tmp_path) == checkpoint(whole[0])


def test_the_end_of_each_stage_is_kept(whole):
    ends = [read_progress(whole[0] / f"{name}.safetensors") for name in ("a", "b")]
    assert [(end.stage, end.sample, end.seen, end.parts) for end in ends] == [(0, 16, 16, 1), (1, 8, 24, 1)]


def test_a_stage_goes_on_in_as_many_parts_as_it_began(tmp_path, monkeypatch):
    """With another number of processes it saw some pairs again, and others never."""
    run(tmp_path, cut_after=3)
    monkeypatch.setattr(Share, "of", lambda *given: Share(2, range(2)))
    with pytest.raises(BadInput, match="--resume: expected pairs in 1 parts, got 2"):
        run(tmp_path, resume=True)


def test_the_last_checkpoint_says_that_all_stages_are_done(whole):
    progress = read_progress(whole[0] / "checkpoint.safetensors")
    assert (progress.stage, progress.sample, progress.seen) == (2, 0, BATCH * STEPS)


def test_resuming_a_finished_run_changes_nothing(whole, tmp_path):
    run(tmp_path)
    assert run(tmp_path, resume=True) == []
    assert checkpoint(tmp_path) == checkpoint(whole[0])


def test_the_average_is_not_the_network(whole):
    network, averaged = (
        read_weights(whole[0] / "checkpoint.safetensors", part) for part in ("network", "averaged")
    )
    apart = (network["conv1.0.weight"] - averaged["conv1.0.weight"]).abs().max()
    assert 0 < apart < 0.1 * network["conv1.0.weight"].abs().max()


def test_curves_are_written(tmp_path, monkeypatch):
    monkeypatch.setattr(loop, "LOGGED_STEPS", 2)
    run(tmp_path)
    curves = EventAccumulator(str(tmp_path / "tensorboard")).Reload()
    for name in ("loss_m", "samples_per_s", "learning_rate"):
        points = curves.Scalars(f"train/{name}")
        assert [point.step for point in points] == [2 * BATCH, 4 * BATCH, 6 * BATCH]
        assert all(point.value > 0 for point in points)


def test_the_learning_rate_that_is_drawn_is_the_step_s_own(tmp_path, monkeypatch):
    """It was the next step's: 0 for the last one, where the floor is 0."""
    monkeypatch.setattr(loop, "LOGGED_STEPS", 1)
    recipe = small_recipe(stages=[stage("a", 3)], floor=0.0)
    run(tmp_path, recipe=recipe)
    points = EventAccumulator(str(tmp_path / "tensorboard")).Reload().Scalars("train/learning_rate")
    rates = [learning_rate(recipe, recipe.stages[0], step * BATCH) for step in range(3)]
    assert [point.value for point in points] == pytest.approx(rates)


def test_a_run_that_was_killed_draws_each_step_once(tmp_path, monkeypatch):
    """After --resume the steps since the last checkpoint stood there twice."""
    monkeypatch.setattr(loop, "LOGGED_STEPS", 1)
    run(tmp_path, cut_after=4, checkpoint_every_s=1e9)
    time.sleep(1.1)  # files of events are in order by the second
    run(tmp_path, resume=True)
    points = EventAccumulator(str(tmp_path / "tensorboard")).Reload().Scalars("train/loss_m")
    assert [point.step for point in points] == [BATCH * (step + 1) for step in range(STEPS)]


@pytest.fixture
def held_out(monkeypatch):
    monkeypatch.setattr(held_out_pairs, "SCENES", training_runs.SMALL_POOL)
    return HeldOut(small_recipe(), small_textures(), {}, 1)


def test_a_test_error_changes_no_weight(whole, tmp_path, held_out, monkeypatch):
    monkeypatch.setattr(held_out_pairs, "TEST_EVERY_S", 0.0)
    assert run(tmp_path, held_out=held_out) == whole[1]
    assert checkpoint(tmp_path) == checkpoint(whole[0])


def test_the_test_error_is_measured_now_and_then_and_at_a_stage_s_end(tmp_path, held_out, monkeypatch):
    reports, at_s = [], [0.0]

    def minutes_later(step):
        reports.append(step)
        at_s[0] += 60.0

    monkeypatch.setattr(held_out_pairs, "TEST_EVERY_S", 120.0)
    options = {"resume": False, "report": minutes_later, "clock": lambda: at_s[0], "held_out": held_out}
    train(small_recipe(), small_textures(), tmp_path, **options)
    points = EventAccumulator(str(tmp_path / "tensorboard")).Reload().Scalars("test/l1_m")
    assert [point.step for point in points] == [3 * BATCH, 4 * BATCH, 6 * BATCH]
    told = [report.test_l1_m for report in reports]
    assert told[:2] == [None, None]
    assert told[4] is None  # of the stage before
    assert [told[2], told[3], told[5]] == pytest.approx([point.value for point in points])


def test_the_test_error_is_that_of_the_average_within_the_range(whole, held_out):
    recipe = small_recipe()
    batches = held_out.batches(1, workers=0, sweep_later=False)
    learner = Learner(recipe)
    learner.restored(whole[0] / CHECKPOINT)
    learner.prepare()
    network = deployed(recipe, read_weights(whole[0] / CHECKPOINT, "averaged"))
    errors = []
    for batch in batches:
        with torch.no_grad(), learner.accelerator.autocast():
            answer_m = network.network(normalised(*batch.inputs))[0].float().clamp(0, 100)
        errors.append((answer_m - torch.nn.functional.avg_pool2d(batch.target_m, 4)).abs().mean())
    assert learner.test_l1_m(batches) == pytest.approx(float(torch.stack(errors).mean()), rel=1e-5)
    assert sum(len(batch.target_m) for batch in batches) == held_out_pairs.PAIRS


def test_pairs_that_are_held_out_are_always_the_same_and_no_training_pairs(held_out):
    first, again = (held_out.batches(0, workers=workers, sweep_later=False) for workers in (0, 2))
    for one, other in zip(first, again, strict=True):
        assert torch.equal(one.inputs[0], other.inputs[0])
        assert torch.equal(one.target_m, other.target_m)
    recipe = small_recipe(seed=4_000_000)
    assert loop.stream_seed(recipe, len(recipe.stages), 200) < held_out_pairs.SEED


def test_pairs_that_are_held_out_are_as_far_apart_as_the_stage_s(held_out):
    [stage, *_] = held_out.recipe.stages
    wide = held_out.recipe.model_copy(update={"stages": (stage.model_copy(update={"wide_share": 0.4}),)})
    with replace(held_out, recipe=wide)._stream(0, 0) as stream:
        assert stream.rule.wide_share == 0.4
        assert not stream.rule.still


def test_a_checkpoint_tells_what_wrote_it(whole):
    progress = read_progress(whole[0] / CHECKPOINT)
    assert (progress.flightdepth, progress.torch) == (flightdepth.__version__, str(torch.__version__))


def test_reports_count_to_the_total(tmp_path):
    reports = []
    train(small_recipe(), small_textures(), tmp_path, resume=False, report=reports.append)
    assert [r.seen for r in reports] == [BATCH * (i + 1) for i in range(STEPS)]
    assert {r.total for r in reports} == {BATCH * STEPS}
    assert [r.stage for r in reports] == ["a"] * 4 + ["b"] * 2


def test_another_seed_is_another_run(whole, tmp_path):
    assert run(tmp_path, recipe=small_recipe(seed=2)) != whole[1]


def test_another_recipe_is_not_resumed(tmp_path):
    run(tmp_path, cut_after=2)
    with pytest.raises(BadInput, match="expected recipe small"):
        run(tmp_path, resume=True, recipe=small_recipe(weight_decay=0.0))


def test_other_textures_are_not_resumed(tmp_path):
    run(tmp_path, cut_after=2)
    with pytest.raises(BadInput, match="textures of run"):
        run(tmp_path, resume=True, textures=small_textures(seed=9))


def test_a_recipe_starts_from_the_average_of_another(whole, tmp_path):
    (tmp_path / "small").symlink_to(whole[0])
    child = small_recipe(name="child", starts_from="small", stages=[stage("c", 1)])
    learner = Learner(child)
    (tmp_path / "child").mkdir()
    progress = learner.started(tmp_path / "child")
    parent = read_weights(whole[0] / "checkpoint.safetensors", "averaged")
    assert progress.seen == BATCH * STEPS
    for module in (learner.network, learner.averaged):
        assert all(torch.equal(value, parent[key]) for key, value in module.state_dict().items())


def test_a_recipe_starts_from_a_stage_of_another(whole, tmp_path):
    (tmp_path / "small").symlink_to(whole[0])
    child = small_recipe(name="child", starts_from="small/a", stages=[stage("c", 1)])
    run(tmp_path / "child", recipe=child)
    trained = read_trained(tmp_path / "child")
    assert trained.progress.seen == BATCH * (4 + 1)
    assert [(each.name, each.samples) for each in trained.stages] == [("a", 4 * BATCH), ("c", BATCH)]


def child_of_small(folder, **changes):
    """A run of one stage that started from the run `small` beside it."""
    facts = {"name": "child", "starts_from": "small", "stages": [stage("c", 1)]}
    run(folder, recipe=small_recipe(**facts | changes))
    return folder


def test_each_stage_of_a_run_and_its_parent_is_by_its_own_recipe(whole, tmp_path):
    """The card gave the parent's stages the child's optimizer and focal length."""
    (tmp_path / "small").symlink_to(whole[0])
    scenes = {"frames": 3, "horizontal_fov_deg": 60.0}
    folder = child_of_small(tmp_path / "child", optimizer="muon", scenes=scenes)
    stages = card_of(read_trained(folder), "child").stages
    assert [(each.name, each.optimizer) for each in stages] == [("a", "adamw"), ("b", "adamw"), ("c", "muon")]
    assert [each.focal_px for each in stages] == pytest.approx([32, 32, 55.4256], abs=1e-4)


@pytest.mark.parametrize("later", ["gone", "another"])
def test_a_run_keeps_what_its_parent_had_been_through(whole, tmp_path, later):
    """The card read the parent as it stood at the export: resumed or deleted since, it told of other training."""
    copied = shutil.copytree(whole[0], tmp_path / "small")
    first = shipped_after(whole[0], [("before", 99)]).card
    write_json(copied / SHIPPED, first.model_dump(mode="json"))
    folder = child_of_small(tmp_path / "child")
    told = card_of(read_trained(folder), "child")
    shutil.rmtree(copied)
    if later == "another":
        run(copied, recipe=small_recipe(stages=[stage("a", 1)]))
    assert [each.name for each in told.stages] == ["before", "a", "b", "c"]
    assert card_of(read_trained(folder), "child") == told
    assert read_trained(folder).first_shipped == first


def test_a_run_that_did_not_write_that_down_reads_its_parent(whole, tmp_path):
    (tmp_path / "small").symlink_to(whole[0])
    folder = child_of_small(tmp_path / "child")
    told = card_of(read_trained(folder), "child")
    (folder / PARENT).unlink()
    assert card_of(read_trained(folder), "child") == told


def test_a_run_that_has_learnt_nothing_is_no_start(tmp_path):
    """Its random weights were taken."""
    run(tmp_path / "small", stop=lambda: True)
    child = small_recipe(name="child", starts_from="small", stages=[stage("c", 1)])
    with pytest.raises(BadInput, match=r"has learnt, .*small.*, got 0 pairs\. Train small first"):
        start_of(child, tmp_path)


def test_the_origin_tells_of_a_run_that_has_not_finished(whole, tmp_path):
    (tmp_path / "small").symlink_to(whole[0])
    run(tmp_path / "cut" / "small", cut_after=3)
    for runs, parent, told in (
        (tmp_path, "small", "24 pairs"),
        (tmp_path, "small/a", "16 pairs"),
        (tmp_path / "cut", "small", "8 pairs, a run that has not finished"),
    ):
        child = small_recipe(name="child", starts_from=parent, stages=[stage("c", 1)])
        assert start_of(child, runs).origin.split(": ")[1] == told


@pytest.mark.parametrize(
    "steps", [pytest.param(1, marks=pytest.mark.slow), 2, pytest.param(3, marks=pytest.mark.slow), 4]
)
def test_a_stage_with_an_optimizer_of_its_own_is_resumed_exactly(whole_with_muon, tmp_path, steps):
    run(tmp_path, recipe=MUON_LATER, cut_after=steps)
    run(tmp_path, recipe=MUON_LATER, resume=True)
    assert checkpoint(tmp_path) == checkpoint(whole_with_muon[0])


def test_a_stage_with_an_optimizer_of_its_own_learns_by_it(whole_with_muon, tmp_path):
    losses = whole_with_muon[1]
    by_adamw = small_recipe(stages=[stage("a", 2), stage("b", 2)])
    others = run(tmp_path, recipe=by_adamw)
    # The first step of a stage sees what the one before learnt; the second what it learnt itself.
    assert others[:3] == losses[:3]
    assert others[3] != losses[3]


@pytest.mark.parametrize("optimizer", ["sgd", "muon"])
def test_other_optimizers_are_resumed_exactly(tmp_path, optimizer):
    recipe = small_recipe(optimizer=optimizer, stages=[stage("a", 3)])
    losses = run(tmp_path / "whole", recipe=recipe)
    run(tmp_path / "cut", recipe=recipe, cut_after=3)
    assert run(tmp_path / "cut", recipe=recipe, resume=True) == losses[2:]
    assert checkpoint(tmp_path / "cut") == checkpoint(tmp_path / "whole")


def test_without_the_recipe_before_there_is_no_start(tmp_path):
    with pytest.raises(BadInput, match="to start from"):
        run(tmp_path / "child", recipe=small_recipe(name="child", starts_from="small"))


def test_where_the_recipe_before_was_not_trained_its_shipped_network_is_taken(tmp_path):
    """Stages that happen to be called as the network's own last one are trained all the same."""
    shipped = read_network("tiny-clamped-512")
    last = shipped.card.stages[-1]
    again = stage(last.name, 1) | {"samples": last.samples}
    facts = {"base_width": shipped.card.base_width, "starts_from": "tiny-clamped-512"}
    child = small_recipe(name="child", stages=[again], **facts)
    learner = Learner(child)
    (tmp_path / "child").mkdir()
    progress = learner.started(tmp_path / "child")
    assert (progress.stage, progress.sample, progress.seen) == (0, 0, shipped.card.samples)
    weights = weights_of(shipped.onnx)
    for module in (learner.network, learner.averaged):
        assert all(torch.equal(value, weights[key]) for key, value in module.state_dict().items())
    learner.save(tmp_path / "child" / CHECKPOINT, replace(progress, sample=BATCH))
    write_json(tmp_path / "child" / RECIPE, child.model_dump(mode="json"))
    trained = read_trained(tmp_path / "child")
    assert [(each.name, each.samples) for each in trained.stages] == [(last.name, BATCH)]
    assert trained.first_shipped == shipped.card


def test_a_shipped_network_of_another_size_is_no_start(tmp_path):
    with pytest.raises(BadInput, match="base width 16"):
        run(tmp_path / "child", recipe=small_recipe(name="child", starts_from="tiny-clamped-512"))


def test_a_recipe_of_another_size_does_not_start_from_a_run(whole, tmp_path):
    (tmp_path / "small").symlink_to(whole[0])
    with pytest.raises(BadInput, match="base width 4, as small, got a DepthNet of 8"):
        run(tmp_path / "child", recipe=small_recipe(name="child", starts_from="small", base_width=8))


@cache
def exported(folder):
    trained = read_trained(folder)
    weights = read_weights(trained.checkpoint, "averaged")
    named = [numpy_helper.from_array(value.numpy(), name) for name, value in weights.items()]
    model = helper.make_model(helper.make_graph([], "weights alone", [], [], named))
    return trained, bytes(model.SerializeToString())


def shipped_after(folder, stages):
    """The weights that an export of the whole run holds, with the card's stages given by hand."""
    trained, onnx = exported(folder)
    facts = {"width": 64, "height": 64, "focal_px": 32.0, "batch": BATCH, "learning_rate": 1e-3}
    card = NetworkCard(
        **{
            "name": "small",
            "architecture": "DepthNet",
            "D0_m": 0.3,
            "focal_px": 32,
            "width": 64,
            "height": 64,
        },
        **{key: getattr(trained.recipe, key) for key in ("base_width", "activation", "nominal_shift")},
        **{key: getattr(trained.recipe, key) for key in ("depth_min_m", "depth_max_m")},
        samples=BATCH * STEPS,
        stages=[CardStage(name=name, samples=n, photometric=False, **facts) for name, n in stages],
        sha256=hashlib.sha256(onnx).hexdigest(),
    )
    return StoredNetwork(card, onnx)


def test_a_shipped_network_goes_on_with_the_stages_that_it_lacks(whole, tmp_path):
    shipped = shipped_after(whole[0], [("before", 99), ("a", 4 * BATCH), ("b", 2 * BATCH)])
    longer = small_recipe(stages=[stage("a", 4), stage("b", 2), stage("c", 1)])
    run(tmp_path, recipe=longer, shipped=shipped)
    trained = read_trained(tmp_path)
    assert trained.progress.seen == BATCH * (STEPS + 1)
    assert [(each.name, each.samples) for each in trained.stages] == [("c", BATCH)]
    assert [each.name for each in trained.shipped.stages] == ["before", "a", "b"]


def test_a_shipped_network_starts_with_its_own_weights(whole, tmp_path):
    learner = Learner(small_recipe())
    learner.started(tmp_path, shipped_after(whole[0], [("a", 4 * BATCH)]))
    parent = read_weights(whole[0] / "checkpoint.safetensors", "averaged")
    for module in (learner.network, learner.averaged):
        for key, value in module.state_dict().items():
            assert key.endswith("num_batches_tracked") or torch.equal(value, parent[key])


def test_a_run_knows_what_it_began_from_before_its_first_step_is_saved(whole, tmp_path):
    """Killed early and resumed without --shipped it began from random weights, and its card said otherwise."""
    shipped = shipped_after(whole[0], [("a", 4 * BATCH)])
    losses = run(tmp_path / "whole", shipped=shipped)
    run(tmp_path / "cut", shipped=shipped, cut_after=1, checkpoint_every_s=1e9)
    assert run(tmp_path / "cut", resume=True) == losses
    assert checkpoint(tmp_path / "cut") == checkpoint(tmp_path / "whole")


def test_a_run_that_begins_from_random_weights_names_no_shipped_network(whole, tmp_path):
    shipped = shipped_after(whole[0], [("a", 4 * BATCH)])
    write_json(tmp_path / SHIPPED, shipped.card.model_dump(mode="json"))  # killed before its first checkpoint
    run(tmp_path, resume=True)
    assert read_trained(tmp_path).shipped is None


def test_a_shipped_network_of_other_stages_is_refused(whole, tmp_path):
    with pytest.raises(BadInput, match="first stages are the last of small's"):
        run(tmp_path, shipped=shipped_after(whole[0], [("a", 5 * BATCH)]))


def test_a_run_that_diverges_stops(tmp_path, monkeypatch):
    monkeypatch.setattr(learner, "loss_m", lambda *_: torch.tensor(math.nan, requires_grad=True))
    with pytest.raises(FlightDepthError, match="diverged at sample 0 of stage a"):
        run(tmp_path)


def test_weights_that_are_no_numbers_leave_the_checkpoint_before(tmp_path):
    wild = small_recipe(warmup_samples=0, stages=[stage("a", 2) | {"learning_rate": 1e39}])
    with pytest.raises(FlightDepthError, match="diverged: weights that are no numbers after 4 pairs"):
        run(tmp_path, recipe=wild, checkpoint_every_s=0.0)
    assert read_progress(tmp_path / CHECKPOINT).seen == 0
    assert all(
        weights.isfinite().all() for weights in read_weights(tmp_path / CHECKPOINT, "network").values()
    )


def flown_set(width, speed_m_s):
    """Steps of 0.1 s to the right; its pictures are nowhere."""
    scene = {"imgs": ["1", "2", "3"], "speed": [speed_m_s, 0.0, 0.0], "time_step": 0.1}
    return StoredSet(Path("nowhere"), width, width, 90.0, "unknown", ((Path("nowhere"), scene),))


def test_what_the_last_stage_cannot_learn_from_is_told_before_the_first(tmp_path):
    recipe = small_recipe(stages=[stage("a", 1), stage("b", 1) | {"full_width": 128}])
    with pytest.raises(BadInput, match=r"set nowhere, step: expected 0\.100 m everywhere, got 0\.200 m"):
        run(tmp_path, recipe=recipe, sets={64: flown_set(64, 1.0), 128: flown_set(128, 2.0)})
    assert not any(tmp_path.iterdir())  # the same folder does for the right set


@pytest.fixture
def seen_by_layers():
    """What the third layer got and gave in one training step."""
    recipe = small_recipe()
    learner = Learner(recipe)
    learner.prepare()
    seen = []
    learner.network.conv3[0].register_forward_hook(
        lambda layer, given, out: seen.append((layer, given[0], out))
    )
    with small_stream(recipe.scenes, small_textures(), recipe.stages[0].picture, recipe.rule, 1) as stream:
        learner.step([TensorBatch.of(recipe, stream.batch(0, BATCH))], recipe.stages[0], 0)
    return seen[0]


def test_layers_compute_in_what_the_machine_is_fastest_in(seen_by_layers):
    layer, given, out = seen_by_layers
    computed = {"bf16": torch.bfloat16, "no": torch.float32}[mixed_precision()]
    assert (given.dtype, out.dtype, layer.weight.dtype) == (computed, computed, torch.float32)


def test_layers_keep_channels_last(seen_by_layers):
    layer, *pictures = seen_by_layers
    for tensor in (layer.weight, *pictures):
        assert tensor.is_contiguous(memory_format=torch.channels_last)
        assert not tensor.is_contiguous()  # else it would say nothing


def test_normalisation():
    pairs = torch.tensor([[[[0, 255, 102, 153, 51, 204]]]], dtype=torch.uint8)
    expected = torch.tensor([-2.5, 2.5, -0.5, 0.5, -1.5, 1.5])
    assert torch.allclose(normalised(pairs)[0, :, 0, 0], expected, atol=1e-6)


def motion_recipe(**changes):
    facts = {"architecture": "MotionNet", "looks": 2, "thorough_last_look": True, "reference_focal_px": 32.0}
    return small_recipe(**facts | changes)


def test_a_stage_of_the_last_look_leaves_all_else_as_it_is(tmp_path):
    """Weights and running statistics; and the stage after it trains all of it again."""
    only = stage("b", 2) | {"only_last_look": True}
    stages = [stage("a", 1), only, stage("c", 1)]
    run(tmp_path, recipe=motion_recipe(stages=stages))
    ends = [read_weights(tmp_path / f"{s['name']}.safetensors", "network") for s in stages]

    def changed(before, after):
        return {k for k, v in after.items() if not torch.equal(v, before[k])}

    kernels = {k for k in ends[0] if k.endswith("0.weight")}
    assert all(key.startswith("last_look.") for key in changed(*ends[:2]))
    assert {"last_look.trunk.0.weight", "last_look.trunk.1.running_mean"} <= changed(*ends[:2])
    assert kernels & changed(*ends[1:]) == kernels


@pytest.mark.parametrize(
    ("parent", "child"), [((2, True), (1, False)), ((2, True), (1, True)), ((2, False), (2, True))]
)
def test_a_network_may_start_from_one_with_other_looks(tmp_path, parent, child):
    """What it lacks is left, what it has more is drawn."""
    for name, (looks, thorough), start in (("small", parent, None), ("child", child, "small")):
        recipe = motion_recipe(
            name=name, starts_from=start, looks=looks, thorough_last_look=thorough, stages=[stage("a", 1)]
        )
        run(tmp_path / name, recipe=recipe)
    looks, thorough = child
    found = read_weights(tmp_path / "child" / "a.safetensors", "network").keys()
    assert ("last_look.head.bias" in found) == thorough
    assert ("refinement.head.bias" in found) == (looks > thorough)


def test_a_stage_says_how_many_of_its_pairs_are_wide(tmp_path, monkeypatch):
    shares = []

    def stream(**facts):
        shares.append(facts["rule"].wide_share)
        return small_stream(**facts)

    monkeypatch.setattr(loop, "PairStream", stream)
    run(tmp_path, recipe=small_recipe(stages=[stage("a", 1), stage("b", 1) | {"wide_share": 0.25}]))
    assert shares == 2 * [0.0, 0.25]  # once to see whether it can be had


def test_one_worker_makes_the_pairs_that_would_have_been_made_here(whole, tmp_path):
    assert run(tmp_path, workers=1) == whole[1]
    assert checkpoint(tmp_path) == checkpoint(whole[0])


@pytest.mark.parametrize("steps", [2, 3])  # so that either worker's turn comes first
def test_a_run_of_several_workers_goes_on_exactly(whole_by_two, tmp_path, steps):
    begun = run(tmp_path, workers=2, cut_after=steps)
    assert begun[: steps - 1] + run(tmp_path, workers=2, resume=True) == whole_by_two[1]
    assert checkpoint(tmp_path) == checkpoint(whole_by_two[0])


def test_workers_are_as_many_as_they_were(tmp_path):
    run(tmp_path, workers=2, cut_after=3)
    with pytest.raises(BadInput, match="--resume: expected --workers 2, as it began, got 3"):
        run(tmp_path, workers=3, resume=True)
    run(tmp_path, resume=True)  # unasked, with as many


@pytest.mark.parametrize("steps", [1, 5])
def test_a_run_killed_early_in_a_stage_goes_on_with_as_many_workers(whole_by_two, tmp_path, steps):
    """Killed before a stage's first checkpoint it went on with as many as a fresh run has: other steps."""
    run(tmp_path, workers=2, cut_after=steps, checkpoint_every_s=1e9)
    assert read_progress(tmp_path / CHECKPOINT).sample == 0
    assert run(tmp_path, resume=True) == whole_by_two[1][steps - 1 :]
    assert checkpoint(tmp_path) == checkpoint(whole_by_two[0])


def test_a_stage_that_has_not_begun_may_have_other_workers(tmp_path):
    run(tmp_path, workers=2, cut_after=5, checkpoint_every_s=1e9)
    train(small_recipe(), small_textures(), tmp_path, resume=True, workers=1, stop=lambda: True)
    assert read_progress(tmp_path / CHECKPOINT).workers == 1


def test_several_workers_have_smaller_pools(monkeypatch):
    monkeypatch.undo()
    assert [loop.pool_scenes(workers) for workers in (0, 1, 2, 3, 15)] == [192, 192, 96, 64, 64]


def test_what_a_worker_meets_is_told_as_it_is(tmp_path, monkeypatch):
    def damaged(*_, **__):
        raise BadInput("scene 3", expected="a picture", got="half of one")

    monkeypatch.setattr(loop.PairStream, "batch", damaged)
    before = set(multiprocessing.active_children())
    with pytest.raises(BadInput, match="scene 3: expected a picture, got half of one") as told:
        run(tmp_path, workers=2)
    assert set(multiprocessing.active_children()) <= before, f"with {told.value} at hand workers live on"


def test_a_worker_that_dies_is_told_in_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(loop.PairStream, "batch", lambda *_: os.kill(os.getpid(), signal.SIGKILL))
    with pytest.raises(FlightDepthError, match="a process that makes pairs has died"):
        run(tmp_path, workers=2)


def test_what_stops_a_run_leaves_its_workers_to_it(tmp_path):
    """A batch system tells all of a run's processes at once; the first one saves."""
    of_others, mine = set(multiprocessing.active_children()), set()

    def told() -> bool:
        mine.update(set(multiprocessing.active_children()) - of_others)
        for worker in mine:
            if worker.is_alive():
                os.kill(worker.pid, signal.SIGTERM)
        return False

    assert len(run(tmp_path, workers=2, stop=told)) == STEPS
    assert len(mine) == 4  # two a stage
    assert not any(worker.is_alive() for worker in mine)


def test_workers_are_for_linux(tmp_path, monkeypatch):
    monkeypatch.setattr(loop.sys, "platform", "win32")
    with pytest.raises(BadInput, match=r"--workers: expected Linux, .* got win32"):
        run(tmp_path, workers=1)
