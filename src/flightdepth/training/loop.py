"""The training loop, plain: batch, loss, step, average, report, checkpoint."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from torch.utils.tensorboard import SummaryWriter

from flightdepth.errors import BadInput
from flightdepth.files import write_json
from flightdepth.scenes import Textures
from flightdepth.stillbox import PairStream
from flightdepth.stillbox.stored import StoredSet
from flightdepth.stillbox.stored_pairs import StoredPairs
from flightdepth.stillbox.stream import CHUNK, POOL_SCENES
from flightdepth.training.checkpoint import Progress, read_progress
from flightdepth.training.feed import Feed
from flightdepth.training.held_out import HeldOut, StageTest
from flightdepth.training.learner import Learner
from flightdepth.training.processes import without_gpu
from flightdepth.training.recipe import Recipe, Stage
from flightdepth.training.run_folder import CHECKPOINT, RECIPE, keep_sets, keep_textures
from flightdepth.training.schedule import learning_rate
from flightdepth.weights.store import StoredNetwork

FORKING = "linux"  # elsewhere a process can't be split in two beside a GPU
LEAST_POOL_SCENES = 64  # a multiple of CHUNK
STREAM_SEEDS = 10**6  # between the streams of a stage
SMOOTHING = 0.98  # of the reported loss
LOGGED_STEPS = 20  # one in so many is drawn by tensorboard


@dataclass(frozen=True)
class Report:
    """What a progress bar shows; `test_l1_m` is the test error where there is one, as last measured in the stage."""

    stage: str
    seen: int
    total: int
    loss_m: float
    test_l1_m: float | None = None


def train(
    recipe: Recipe,
    textures: Textures,
    folder: Path,
    *,
    resume: bool,
    shipped: StoredNetwork | None = None,
    sets: Mapping[int, StoredSet] | None = None,
    held_out: HeldOut | None = None,
    report: Callable[[Report], None] = lambda _: None,
    stop: Callable[[], bool] = lambda: False,
    checkpoint_every_s: float = 120.0,
    threads: int = 2,
    workers: int | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> Path:
    """Run a recipe to its end; the path of the last checkpoint. Each stage's end is kept under its name.

    With `resume` a checkpoint in `folder` is taken up where it was; without one, the run starts: from random
    weights, or from those of `shipped`, after the stages that its card lists. With `sets`, by their width,
    pairs come from stored scenes: each stage takes the set as wide as its full picture. On pairs of `held_out` the
    first process measures the test error, which changes no weight. `stop` is asked after every step; when it says yes,
    the run is saved and ends there. `threads` make pairs when it is their turn; with `workers`, so many processes for
    each part of a batch make them ahead of time, a thread each. None: as many as the run that goes on had, else one for
    each free thread beside a GPU, and none without one.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / CHECKPOINT
    goes_on = resume and path.exists()
    learner = Learner(recipe, read_progress(path).precision if goes_on else None)
    progress = learner.restored(path) if goes_on else learner.started(folder, shipped)
    learner.prepare(progress.stage)
    workers = _workers(learner, progress, threads) if workers is None else workers
    if workers and sys.platform != FORKING:
        raise BadInput("--workers", expected="Linux, whose processes share what is read", got=sys.platform)
    streamed = partial(
        stage_stream,
        recipe,
        textures=textures,
        sets=sets or {},
        threads=threads,
        workers=workers,
    )
    _open_each(recipe, streamed, progress.stage, learner.share.mine[0])
    keep_sets(folder, sets or {})
    keep_textures(folder, textures)
    write_json(folder / RECIPE, recipe.model_dump(mode="json"))
    if not progress.sample:  # a stage that has not begun may have others
        progress = replace(progress, workers=workers)
    if not goes_on:  # from here on it is known what the run began from
        learner.save(path, progress)
    with _board(folder, progress.seen) if learner.accelerator.is_main_process else nullcontext() as board:
        for number in range(progress.stage, len(recipe.stages)):
            stream = partial(streamed, number)
            run = _Run(learner, number, stream, workers, board, held_out, report, stop, clock)
            progress = run.to_end(progress, path, checkpoint_every_s)
            if learner.agreed(stop()):
                learner.save(path, progress)
                break
            learner.save(folder / f"{recipe.stages[number].name}.safetensors", progress)
            ended = number + 1 == len(recipe.stages)  # a recipe that grows may go on with others
            progress = replace(progress, stage=number + 1, sample=0, parts=0, workers=0 if ended else workers)
            learner.save(path, progress)
    return path


def _workers(learner: Learner, progress: Progress, threads: int) -> int:
    """Where nobody says how many: those that the run goes on with, else the usual number."""
    known = progress.sample or progress.workers
    return progress.workers if known else usual_workers(learner, threads)


def _open_each(recipe: Recipe, streamed: Callable[[int, int], PairStream], first: int, part: int) -> None:
    """What a stage can't learn from, of stage `first` and later ones, is told before the stages that come first."""
    for number in range(first, len(recipe.stages)):
        with streamed(number, part):
            pass


def _board(folder: Path, seen: int) -> SummaryWriter:
    """Curves from `seen` pairs on; what a run that was killed drew beyond its last checkpoint is drawn anew."""
    return SummaryWriter(str(folder / "tensorboard"), purge_step=seen + 1)


@dataclass
class _Run:
    """One stage; it has a `board`, and measures the test error, in the first process alone."""

    learner: Learner
    number: int
    stream: Callable[[int], PairStream]
    workers: int
    board: SummaryWriter | None
    held_out: HeldOut | None
    report: Callable[[Report], None]
    stop: Callable[[], bool]
    clock: Callable[[], float]

    @property
    def recipe(self) -> Recipe:
        return self.learner.recipe

    @property
    def stage(self) -> Stage:
        return self.recipe.stages[self.number]

    def to_end(self, progress: Progress, path: Path, every_s: float) -> Progress:
        """Train from `progress` to the stage's last sample, or until told to stop."""
        # In another number of streams it would see some pairs again, and others never.
        parts = self.learner.share.parts
        if progress.sample and progress.parts not in (0, parts):
            mend = "Go on as it began: `accumulate` of the recipe, or processes, whichever is more."
            raise BadInput("--resume", expected=f"pairs in {progress.parts} parts", got=f"{parts}", mend=mend)
        if progress.sample and progress.workers != self.workers:
            raise BadInput(
                "--resume", expected=f"--workers {progress.workers}, as it began", got=f"{self.workers}"
            )
        self.learner.begin(self.stage)
        test = self._test()
        saved = began = self.clock()
        began_at, total = progress.seen, self._total(progress)
        with ExitStack() as stack:
            first = progress.sample // self.stage.batch
            mine = self.learner.share.mine
            feeds = [stack.enter_context(self._feed(part).batches(first)) for part in mine]
            while progress.sample < self.stage.samples and not self.learner.agreed(self.stop()):
                loss_m = self.learner.step([next(feed) for feed in feeds], self.stage, progress.sample)
                progress = self._advanced(progress, loss_m)
                if test is not None:
                    test.measure(progress.seen, ended=progress.sample >= self.stage.samples)
                rate = (progress.seen - began_at) / max(self.clock() - began, 1e-9)
                test_l1_m = None if test is None else test.l1_m
                self.report(Report(self.stage.name, progress.seen, total, progress.loss_m, test_l1_m))
                self._log(progress, loss_m, rate)
                if self.learner.agreed(self.clock() - saved >= every_s):
                    self.learner.save(path, progress)
                    saved = self.clock()
        return progress

    def _feed(self, part: int) -> Feed:
        """What one part of each batch is made by."""
        size, each = self.stage.batch // self.learner.share.parts, max(self.workers, 1)
        return Feed(
            self.recipe,
            lambda number: self.stream(part * each + number),
            size,
            self.workers,
            sweep_later=self.learner.on_gpu,
        )

    def _advanced(self, before: Progress, loss_m: float) -> Progress:
        """Progress after one step more, whose loss it was."""
        smooth = before.loss_m
        smooth = loss_m if math.isnan(smooth) else SMOOTHING * smooth + (1 - SMOOTHING) * loss_m
        sample, seen = before.sample + self.stage.batch, before.seen + self.stage.batch
        done = replace(before, sample=sample, seen=seen, loss_m=smooth)
        return replace(done, parts=self.learner.share.parts, workers=self.workers)

    def _total(self, progress: Progress) -> int:
        rest = sum(stage.samples for stage in self.recipe.stages[self.number + 1 :])
        return progress.seen - progress.sample + self.stage.samples + rest

    def _test(self) -> StageTest | None:
        if self.held_out is None or self.board is None:
            return None
        sweep_later = self.learner.on_gpu
        batches = self.held_out.batches(self.number, workers=self.workers, sweep_later=sweep_later)
        return StageTest(batches, self.learner.test_l1_m, self.board, self.clock)

    def _log(self, progress: Progress, loss_m: float, rate: float) -> None:
        if self.board is None or (progress.sample // self.stage.batch) % LOGGED_STEPS:
            return
        learnt_at = learning_rate(self.recipe, self.stage, progress.sample - self.stage.batch)
        for name, value in {"loss_m": loss_m, "samples_per_s": rate, "learning_rate": learnt_at}.items():
            self.board.add_scalar(f"train/{name}", value, progress.seen)


def stage_stream(
    recipe: Recipe,
    number: int,
    stream: int,
    *,
    textures: Textures,
    sets: Mapping[int, StoredSet],
    threads: int,
    workers: int = 0,
) -> PairStream:
    """Pairs of a stage from its stream number `stream`, of drawn scenes or of the set as wide as the full picture.

    Of several workers each has a thread, and a smaller pool of scenes.

    Raises:
        BadInput: the set is not one that the stage can learn from.
    """
    stage = recipe.stages[number]
    picture = stage.picture
    opened = partial(StoredPairs, stored=sets[picture.full_width]) if sets else PairStream
    return opened(
        config=recipe.scenes_in(stage),
        textures=textures,
        picture=picture,
        rule=replace(recipe.rule, wide_share=stage.wide_share),
        seed=stream_seed(recipe, number, stream),
        photometric_share=stage.photometric_share if stage.photometric else 0.0,
        h264_share=stage.h264_share,
        noise=stage.noise,
        upright=stage.upright,
        objects_for_lens=stage.objects_for_lens,
        pairs_per_scene=recipe.pairs_per_scene,
        threads=1 if workers else threads,
        pool_scenes=pool_scenes(workers),
    )


def usual_workers(learner: Learner, cores: int) -> int:
    """For each part of a batch that this process learns from, of the cores that it has."""
    can_be_fed = not without_gpu() and sys.platform == FORKING
    return max(1, (cores - 1) // len(learner.share.mine)) if can_be_fed else 0


def pool_scenes(streams: int) -> int:
    """Scenes that a stream draws pairs from: of several streams' each fewer, but enough for a batch of its own."""
    return max(LEAST_POOL_SCENES, POOL_SCENES // max(streams, 1) // CHUNK * CHUNK)


def stream_seed(recipe: Recipe, stage: int, stream: int = 0) -> int:
    """Seed of the scenes of one of a stage's streams."""
    return 1000 * recipe.seed + stage + STREAM_SEEDS * stream
