"""The training loop, plain: batch, loss, step, average, report, checkpoint."""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import torch
from accelerate import Accelerator
from torch import nn, optim
from torch.utils.tensorboard import SummaryWriter

from flightdepth.errors import BadInput, FlightDepthError
from flightdepth.files import write_json
from flightdepth.scenes import Textures
from flightdepth.stillbox import Batch, PairStream
from flightdepth.stillbox.stored import StoredSet
from flightdepth.stillbox.stored_pairs import StoredPairs
from flightdepth.training.averaging import MovingAverage
from flightdepth.training.checkpoint import (
    Progress,
    read_optimizer,
    read_progress,
    read_weights,
    save_checkpoint,
)
from flightdepth.training.export import weights_of
from flightdepth.training.inputs import network_inputs
from flightdepth.training.loss import loss_m
from flightdepth.training.network import built
from flightdepth.training.recipe import Recipe, Stage
from flightdepth.training.run_folder import (
    CHECKPOINT,
    RECIPE,
    SHIPPED,
    keep_sets,
    keep_textures,
    stages_behind,
)
from flightdepth.training.schedule import learning_rate
from flightdepth.weights.store import StoredNetwork

SMOOTHING = 0.98  # of the reported loss


@dataclass(frozen=True)
class Report:
    """What a progress bar shows."""

    stage: str
    seen: int
    total: int
    loss_m: float
    samples_per_s: float


def train(
    recipe: Recipe,
    textures: Textures,
    folder: Path,
    *,
    resume: bool,
    shipped: StoredNetwork | None = None,
    sets: Mapping[int, StoredSet] | None = None,
    report: Callable[[Report], None] = lambda _: None,
    stop: Callable[[], bool] = lambda: False,
    checkpoint_every_s: float = 120.0,
    threads: int = 2,
    clock: Callable[[], float] = time.monotonic,
) -> Path:
    """Run a recipe to its end; the path of the last checkpoint. Each stage's end is kept under its name.

    With `resume` a checkpoint in `folder` is taken up where it was; without one, the run starts: from random
    weights, or from those of `shipped`, after the stages that its card lists. With `sets`, by their width,
    pairs come from stored scenes: each stage takes the set as wide as its full picture. `stop` is asked after every
    step; when it says yes, the run is saved and ends there.
    """
    learner = Learner(recipe)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / CHECKPOINT
    progress = learner.restored(path) if resume and path.exists() else learner.started(folder, shipped)
    learner.prepare()
    write_json(folder / RECIPE, recipe.model_dump(mode="json"))
    keep_textures(folder, textures)
    keep_sets(folder, sets or {})
    with SummaryWriter(str(folder / "tensorboard")) as board:
        for number in range(progress.stage, len(recipe.stages)):
            run = _Run(learner, number, textures, sets or {}, threads, board, report, stop, clock)
            progress = run.to_end(progress, path, checkpoint_every_s)
            if stop():
                learner.save(path, progress)
                break
            learner.save(folder / f"{recipe.stages[number].name}.safetensors", progress)
            progress = Progress(recipe.name, recipe.digest, number + 1, 0, progress.seen, progress.loss_m)
            learner.save(path, progress)
    return path


class Learner:
    """A network, its average and its optimizer, on the device that accelerate finds, in bf16."""

    def __init__(self, recipe: Recipe) -> None:
        self.recipe = recipe
        self.accelerator = Accelerator(mixed_precision="bf16")
        torch.manual_seed(recipe.seed)
        network = built(recipe)
        self.network: nn.Module = network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        # Fused: half the time of the other forms of AdamW, on CPUs too.
        self.optimizer = optim.AdamW(
            self.network.parameters(), lr=0.0, weight_decay=recipe.weight_decay, fused=True
        )
        self.averaged = copy.deepcopy(self.network).requires_grad_(False).eval()

    def restored(self, path: Path) -> Progress:
        """Take up a checkpoint of the same recipe."""
        recipe, progress = self.recipe, read_progress(path)
        if progress.digest != recipe.digest:
            raise BadInput(
                f"checkpoint {path}",
                expected=f"recipe {recipe.name} ({recipe.digest})",
                got=f"{progress.recipe} ({progress.digest})",
                mend="Take the recipe and --samples that the run began with, or train elsewhere: --runs DIR.",
            )
        self.network.load_state_dict(read_weights(path, "network"))
        self.averaged.load_state_dict(read_weights(path, "averaged"))
        read_optimizer(path, self.network, self.optimizer)
        return progress

    def started(self, folder: Path, shipped: StoredNetwork | None = None) -> Progress:
        """A fresh run: from random weights, the last ones of the recipe that it starts from, or shipped ones."""
        recipe, seen = self.recipe, 0
        if shipped is not None:
            return self._after(shipped, folder)
        if recipe.starts_from is not None:
            parent = folder.parent / recipe.starts_from / CHECKPOINT
            if not parent.exists():
                raise BadInput(
                    f"recipe {recipe.name}",
                    expected=f"{parent} to start from",
                    got="no such file",
                    mend=f"Train {recipe.starts_from} first, into the same folder of runs.",
                )
            self.network.load_state_dict(read_weights(parent, "averaged"))
            self.averaged.load_state_dict(self.network.state_dict())
            seen = read_progress(parent).seen
        return Progress(recipe.name, recipe.digest, 0, 0, seen, math.nan)

    def _after(self, shipped: StoredNetwork, folder: Path) -> Progress:
        """Go on from a shipped network, with the first stage that its card does not list."""
        recipe, card = self.recipe, shipped.card
        behind = stages_behind(card, recipe)
        if behind == 0 or (card.base_width, card.activation) != (recipe.base_width, recipe.activation):
            raise BadInput(
                f"recipe {recipe.name}",
                expected=f"a recipe whose first stages are the last of {card.name}'s",
                got=", ".join(stage.name for stage in recipe.stages),
                mend="Append your stages to the recipe that the network was trained with.",
            )
        weights = weights_of(shipped.onnx)
        self.network.load_state_dict(weights)
        self.averaged.load_state_dict(weights)
        write_json(folder / SHIPPED, card.model_dump(mode="json"))
        return Progress(recipe.name, recipe.digest, behind, 0, card.samples, math.nan)

    def prepare(self) -> None:
        """Move to the device, for training."""
        self.model, self.stepper = self.accelerator.prepare(self.network, self.optimizer)
        self.averaged.to(self.accelerator.device)
        self.average = MovingAverage(self.network, self.averaged, self.recipe.ema_decay)
        self.model.train()

    def step(self, batch: Batch, stage: Stage, sample: int) -> float:
        """One step on samples `sample` ... of a stage; the loss in metres."""
        recipe, device = self.recipe, self.accelerator.device
        for group in self.stepper.param_groups:
            group["lr"] = learning_rate(recipe, stage, sample)
        target_m = torch.from_numpy(batch.target_m).to(device)
        inputs = network_inputs(recipe, batch, device)
        with self.accelerator.autocast():
            output = self.model(*inputs)
        loss = loss_m(recipe, output, target_m)
        if not torch.isfinite(loss):
            raise FlightDepthError(f"training diverged at sample {sample} of stage {stage.name}: loss {loss}")
        self.stepper.zero_grad(set_to_none=True)
        self.accelerator.backward(loss)
        self.stepper.step()
        self.average.update(sample // stage.batch)
        return float(loss.detach())

    def save(self, path: Path, progress: Progress) -> None:
        """Write a checkpoint."""
        save_checkpoint(path, progress, self.network, self.averaged, self.optimizer)


@dataclass
class _Run:
    """One stage."""

    learner: Learner
    number: int
    textures: Textures
    sets: Mapping[int, StoredSet]
    threads: int
    board: SummaryWriter
    report: Callable[[Report], None]
    stop: Callable[[], bool]
    clock: Callable[[], float]
    recipe: Recipe = field(init=False)
    stage: Stage = field(init=False)

    def __post_init__(self) -> None:
        self.recipe = self.learner.recipe
        self.stage = self.recipe.stages[self.number]

    def to_end(self, progress: Progress, path: Path, every_s: float) -> Progress:
        """Train from `progress` to the stage's last sample, or until told to stop."""
        saved = began = self.clock()
        began_at, total = progress.seen, self._total(progress)
        with self._stream() as stream:
            while progress.sample < self.stage.samples and not self.stop():
                batch = stream.batch(progress.sample, self.stage.batch)
                loss_m = self.learner.step(batch, self.stage, progress.sample)
                progress = self._after(progress, loss_m)
                rate = (progress.seen - began_at) / max(self.clock() - began, 1e-9)
                self.report(Report(self.stage.name, progress.seen, total, progress.loss_m, rate))
                self._log(progress, loss_m, rate)
                if self.clock() - saved >= every_s:
                    self.learner.save(path, progress)
                    saved = self.clock()
        return progress

    def _after(self, before: Progress, loss_m: float) -> Progress:
        smooth = before.loss_m
        smooth = loss_m if math.isnan(smooth) else SMOOTHING * smooth + (1 - SMOOTHING) * loss_m
        sample, seen = before.sample + self.stage.batch, before.seen + self.stage.batch
        return Progress(self.recipe.name, self.recipe.digest, self.number, sample, seen, smooth)

    def _stream(self) -> PairStream:
        width = self.stage.full_width
        stream = partial(StoredPairs, stored=self.sets[width]) if self.sets else PairStream
        return stream(
            config=self.recipe.scenes.model_copy(update={"open_share": self.stage.open_share}),
            textures=self.textures,
            picture=self.stage.picture,
            rule=self.recipe.rule,
            seed=1000 * self.recipe.seed + self.number,
            photometric=self.stage.photometric,
            noise=self.stage.noise,
            threads=self.threads,
            background=self.learner.accelerator.device.type != "cpu",
        )

    def _total(self, progress: Progress) -> int:
        rest = sum(stage.samples for stage in self.recipe.stages[self.number + 1 :])
        return progress.seen - progress.sample + self.stage.samples + rest

    def _log(self, progress: Progress, loss_m: float, rate: float) -> None:
        if (progress.sample // self.stage.batch) % 20 == 0:
            rate_now = learning_rate(self.recipe, self.stage, progress.sample)
            self.board.add_scalar("train/loss_m", loss_m, progress.seen)
            self.board.add_scalar("train/samples_per_s", rate, progress.seen)
            self.board.add_scalar("train/learning_rate", rate_now, progress.seen)
