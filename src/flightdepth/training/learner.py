"""What learns: a network, its average and its optimizer; a start, a step, a checkpoint."""

from __future__ import annotations

import copy
import math
import warnings
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import torch
from accelerate import Accelerator
from accelerate.state import AcceleratorState
from accelerate.utils import DistributedDataParallelKwargs
from torch import Tensor, nn, optim

from flightdepth.errors import BadInput, FlightDepthError
from flightdepth.training.averaging import MovingAverage
from flightdepth.training.checkpoint import (
    Progress,
    read_optimizer,
    read_progress,
    read_weights,
    save_checkpoint,
    versions,
)
from flightdepth.training.graph import StepGraph
from flightdepth.training.inputs import TensorBatch, network_inputs
from flightdepth.training.loss import l1_m, loss_m
from flightdepth.training.muon import Muon
from flightdepth.training.network import network_of
from flightdepth.training.precision import Arithmetic, mixed_precision
from flightdepth.training.processes import Share, mean_over, weigh_part, without_gpu
from flightdepth.training.recipe import OptimizerName, Recipe, Stage
from flightdepth.training.run_folder import keep_origin
from flightdepth.training.schedule import learning_rate
from flightdepth.training.start import start_of
from flightdepth.weights.store import StoredNetwork

SGD_MOMENTUM = 0.9
LAST_LOOK = "last_look"


class Learner:
    """A network, its average and its optimizer, on the device that accelerate finds, in what it is fastest in.

    `precision`: what a run that goes on was computed in. With several processes each has its own learner; their
    weights stay equal.
    """

    def __init__(self, recipe: Recipe, precision: Arithmetic | None = None) -> None:
        self.recipe = recipe
        self.precision = mixed_precision(precision)
        # Batch statistics are not taken from the first process: see `processes`.
        own_statistics = DistributedDataParallelKwargs(broadcast_buffers=False)
        AcceleratorState._reset_state()  # the run before in this process may have been computed in the other
        self.accelerator = Accelerator(
            cpu=without_gpu(), mixed_precision=self.precision, kwargs_handlers=[own_statistics]
        )
        if self.on_gpu:
            torch.backends.cudnn.benchmark = True  # all batches of a stage are of one size
            torch.set_float32_matmul_precision("high")
        self.share = Share.of(recipe, self.accelerator.process_index, self.accelerator.num_processes)
        torch.manual_seed(recipe.seed)
        network = network_of(recipe)
        self.network: nn.Module = network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self._begin_optimizer(recipe.optimizer_in(recipe.stages[0]))
        self._graph: StepGraph | None = None
        self.averaged = copy.deepcopy(self.network).requires_grad_(False).eval()

    @property
    def on_gpu(self) -> bool:
        """Whether it is NVIDIA's, or looks like one to PyTorch."""
        return bool(self.accelerator.device.type == "cuda")

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
        # A stage that has not begun has the state of the one before.
        stage = recipe.stages[max(progress.stage - (progress.sample == 0), 0)]
        self._begin_optimizer(recipe.optimizer_in(stage))
        read_optimizer(path, self.network, self.optimizer)
        return progress

    def started(self, folder: Path, shipped: StoredNetwork | None = None) -> Progress:
        """A fresh run: from random weights, from those of the recipe that it starts from, or from shipped ones.

        What a recipe starts from is the run in the same folder of runs, or else the network that ships.
        """
        recipe = self.recipe
        start = start_of(recipe, folder.parent, shipped)
        if start is None:
            keep_origin(folder)
            return Progress(recipe.name, recipe.digest, 0, 0, 0, math.nan)
        self._load_what_fits(start.weights)
        keep_origin(
            folder, shipped=start.card, parent=start.parent
        )  # so that what its weights have seen is known
        return Progress(recipe.name, recipe.digest, start.stage, 0, start.seen, math.nan)

    def _load_what_fits(self, weights: Mapping[str, Tensor]) -> None:
        """Of a network of the same size whose looks may be others: what it lacks stays as drawn."""
        drawn = self.network.state_dict()
        fitting = drawn | {key: value for key, value in weights.items() if key in drawn}
        self.network.load_state_dict(fitting)
        self.averaged.load_state_dict(fitting)

    def prepare(self, stage: int = 0) -> None:
        """Move to the device, to train stage number `stage` and those that follow."""
        # Only where not all is trained may a gradient be missing, and looking for those takes time.
        self.accelerator.ddp_handler.find_unused_parameters = any(
            each.only_last_look for each in self.recipe.stages[stage:]
        )
        with warnings.catch_warnings():  # what should stand in its place can't say as much yet
            warnings.filterwarnings("ignore", "`broadcast_buffers` is deprecated", FutureWarning)
            self.model, self.stepper = self.accelerator.prepare(self.network, self.optimizer)
        self.averaged.to(self.accelerator.device)
        self.average = MovingAverage(self.network, self.averaged, self.recipe.ema_decay)

    def begin(self, stage: Stage) -> None:
        """A stage begins, or goes on: what it does not train stays as it is, running statistics too."""
        name = self.recipe.optimizer_in(stage)
        if name != self._optimizer_name:
            self._begin_optimizer(name)
            self.stepper = self.accelerator.prepare(self.optimizer)
        self.model.train(not stage.only_last_look)
        self.network.requires_grad_(not stage.only_last_look)
        if stage.only_last_look:
            self.network.get_submodule(LAST_LOOK).train().requires_grad_()
        self._graph = self._recorded_step()

    def _recorded_step(self) -> StepGraph | None:
        """For one process with a GPU; a stage has a graph of its own, since its batches have their own size."""
        if not self.on_gpu or self.accelerator.num_processes > 1:
            return None
        for group in self.stepper.param_groups:  # what is recorded reads the rate where it is then written
            group["lr"] = torch.zeros((), device=self.accelerator.device)
            group["capturable"] = True
        return StepGraph(self._learn_all, self.accelerator.device)

    def _begin_optimizer(self, name: OptimizerName) -> None:
        self._optimizer_name, self.optimizer = name, optimizer_of(self.recipe, self.network, name)

    def step(self, parts: Sequence[TensorBatch], stage: Stage, sample: int) -> float:
        """One step on samples `sample` ... of a stage, of which `parts` are this process's; the loss in metres."""
        set_learning_rate(self.stepper, learning_rate(self.recipe, stage, sample))
        loss = self._learn_all(parts) if self._graph is None else self._graph(parts)
        if not torch.isfinite(loss):
            raise FlightDepthError(
                f"training diverged at sample {sample} of stage {stage.name}: loss {loss};"
                " the last checkpoint stands. Try a lower learning_rate"
            )
        self.average.update(sample // stage.batch)
        return float(self.accelerator.reduce(loss, "mean"))

    def _learn_all(self, parts: Sequence[TensorBatch]) -> Tensor:
        """Move the weights along the gradient of this process's parts; their loss."""
        self.stepper.zero_grad(set_to_none=True)
        loss = torch.zeros((), device=self.accelerator.device)
        for number, batch in enumerate(parts):
            weigh_part(self.network, self.recipe.batch_norm_momentum, number, len(parts))
            is_last = number == len(parts) - 1  # which puts the gradients of all processes together
            with nullcontext() if is_last else self.accelerator.no_sync(self.model):
                loss += self._learn(batch, len(parts))
        self.stepper.step()
        return loss

    def _learn(self, batch: TensorBatch, parts: int) -> Tensor:
        """Add the gradient of one of `parts` parts; its loss, divided by their number."""
        batch = batch.to(self.accelerator.device)
        inputs = network_inputs(self.recipe, batch)
        with self.accelerator.autocast():
            output = self.model(*inputs)
        loss = loss_m(self.recipe, output, batch.target_m) / parts
        self.accelerator.backward(loss)
        return loss.detach()

    @torch.no_grad()
    def test_l1_m(self, batches: Sequence[TensorBatch]) -> float:
        """Mean error of the average on batches of one size, metres; of this process alone, and no weight changes."""
        errors = []
        for batch in (each.to(self.accelerator.device) for each in batches):
            with self.accelerator.autocast():
                output = self.averaged(*network_inputs(self.recipe, batch))
            errors.append(float(l1_m(self.recipe, output, batch.target_m)))
        return sum(errors) / len(errors)

    def agreed(self, flag: bool) -> bool:
        """Whether any process says so; all get the same answer."""
        if self.accelerator.num_processes == 1:
            return flag
        said = torch.tensor(float(flag), device=self.accelerator.device)
        return bool(self.accelerator.reduce(said, "sum") > 0)

    def save(self, path: Path, progress: Progress) -> None:
        """Write a checkpoint; all processes come here, the first one writes.

        Raises:
            FlightDepthError: the weights are no numbers any more; the checkpoint before stays.
        """
        mean_over(self.accelerator, self.network, self.averaged)
        if not all(torch.isfinite(each).all() for each in self.network.state_dict().values()):
            raise FlightDepthError(
                f"training diverged: weights that are no numbers after {progress.seen:,} pairs;"
                " the last checkpoint stands. Try a lower learning_rate"
            )
        if self.accelerator.is_main_process:
            now = versions()
            progress = replace(
                progress, precision=self.precision, flightdepth=now["flightdepth"], torch=now["torch"]
            )
            save_checkpoint(path, progress, self.network, self.averaged, self.optimizer)
        self.accelerator.wait_for_everyone()


def set_learning_rate(optimizer: optim.Optimizer, rate: float) -> None:
    """Of all parameters; in place where it is a tensor."""
    for group in optimizer.param_groups:
        if isinstance(group["lr"], Tensor):
            group["lr"].fill_(rate)
        else:
            group["lr"] = rate


def optimizer_of(recipe: Recipe, network: nn.Module, name: OptimizerName) -> optim.Optimizer:
    """Before the first step; the learning rate is set step by step."""
    # Fused: half the time of the other forms of AdamW, on CPUs too.
    weights, decay = network.parameters(), recipe.weight_decay
    if name == "sgd":
        return optim.SGD(weights, lr=0.0, momentum=SGD_MOMENTUM, weight_decay=decay, fused=True)
    if name == "muon":
        return Muon(network, lr=0.0, weight_decay=decay)
    return optim.AdamW(weights, lr=0.0, weight_decay=decay, fused=True)
