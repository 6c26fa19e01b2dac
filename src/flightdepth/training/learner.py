"""What learns: a network, its average and its optimizer; a start, a step, a checkpoint."""

from __future__ import annotations

import copy
import math
import warnings
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import torch
from accelerate import Accelerator
from accelerate.state import AcceleratorState
from accelerate.utils import DistributedDataParallelKwargs
from torch import Tensor, nn, optim

from flightdepth.errors import BadInput, FlightDepthError
from flightdepth.files import write_json
from flightdepth.stillbox import Batch
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
from flightdepth.training.muon import Muon
from flightdepth.training.network import network_of
from flightdepth.training.precision import Precision, mixed_precision
from flightdepth.training.processes import Share, mean_over, weigh_part, without_gpu
from flightdepth.training.recipe import OptimizerName, Recipe, Stage
from flightdepth.training.run_folder import SHIPPED, parent_checkpoint, read_trained, stages_behind
from flightdepth.training.schedule import learning_rate
from flightdepth.weights.store import StoredNetwork, read_network, shipped_networks

SGD_MOMENTUM = 0.9
LAST_LOOK = "last_look"


class Learner:
    """A network, its average and its optimizer, on the device that accelerate finds, in what it is fastest in.

    `precision`: what a run that goes on was computed in. With several processes each has its own learner; their
    weights stay equal.
    """

    def __init__(self, recipe: Recipe, precision: Precision | None = None) -> None:
        self.recipe = recipe
        self.precision = mixed_precision(precision)
        # Batch statistics are not taken from the first process: see `processes`.
        own_statistics = DistributedDataParallelKwargs(
            broadcast_buffers=False, find_unused_parameters=recipe.thorough_last_look
        )
        AcceleratorState._reset_state()  # the run before in this process may have been computed in the other
        self.accelerator = Accelerator(
            cpu=without_gpu(), mixed_precision=self.precision, kwargs_handlers=[own_statistics]
        )
        self.share = Share.of(recipe, self.accelerator.process_index, self.accelerator.num_processes)
        torch.manual_seed(recipe.seed)
        network = network_of(recipe)
        self.network: nn.Module = network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self._begin_optimizer(recipe.optimizer_in(recipe.stages[0]))
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
        # A stage that has not begun has the state of the one before.
        stage = recipe.stages[max(progress.stage - (progress.sample == 0), 0)]
        self._begin_optimizer(recipe.optimizer_in(stage))
        read_optimizer(path, self.network, self.optimizer)
        return progress

    def started(self, folder: Path, shipped: StoredNetwork | None = None) -> Progress:
        """A fresh run: from random weights, from those of the recipe that it starts from, or from shipped ones.

        What a recipe starts from is the run in the same folder of runs, or else the network that ships.
        """
        recipe, seen = self.recipe, 0
        (folder / SHIPPED).unlink(missing_ok=True)  # of a run that ended before its first checkpoint
        if shipped is not None:
            return self._after(shipped, folder)
        if recipe.starts_from is not None:
            parent = parent_checkpoint(folder.parent, recipe.starts_from)
            if parent.exists():
                before = read_trained(parent).recipe
                self._check_same_size(before.name, before.architecture, before.base_width)
                self._take(read_weights(parent, "averaged"))
                seen = read_progress(parent).seen
            elif recipe.starts_from in shipped_networks():
                return self._on_from(read_network(recipe.starts_from), folder, stage=0)
            else:
                raise BadInput(
                    f"recipe {recipe.name}",
                    expected=f"{parent} to start from",
                    got="no such file",
                    mend=f"Train {parent.parent.name} first, into the same folder of runs.",
                )
        return Progress(recipe.name, recipe.digest, 0, 0, seen, math.nan)

    def _after(self, shipped: StoredNetwork, folder: Path) -> Progress:
        """Go on from a shipped network, with the first stage that its card does not list."""
        recipe, card = self.recipe, shipped.card
        behind = stages_behind(card, recipe)
        facts = ("architecture", "base_width", "activation")
        if behind == 0 or any(getattr(card, fact) != getattr(recipe, fact) for fact in facts):
            raise BadInput(
                f"recipe {recipe.name}",
                expected=f"a recipe whose first stages are the last of {card.name}'s",
                got=", ".join(f"{stage.name} ({stage.samples:,})" for stage in recipe.stages),
                mend="Append your stages to the recipe that the network was trained with, and give no --samples.",
            )
        return self._on_from(shipped, folder, stage=behind)

    def _on_from(self, shipped: StoredNetwork, folder: Path, *, stage: int) -> Progress:
        """Take a shipped network's weights; its card is kept, so that what they have seen is known."""
        recipe, card = self.recipe, shipped.card
        self._check_same_size(card.name, card.architecture, card.base_width)
        self._take(weights_of(shipped.onnx))
        write_json(folder / SHIPPED, card.model_dump(mode="json"))
        return Progress(recipe.name, recipe.digest, stage, 0, card.samples, math.nan)

    def _check_same_size(self, name: str, architecture: str, base_width: int) -> None:
        recipe = self.recipe
        if (architecture, base_width) != (recipe.architecture, recipe.base_width):
            raise BadInput(
                f"recipe {recipe.name}",
                expected=f"a {architecture} of base width {base_width}, as {name}",
                got=f"a {recipe.architecture} of {recipe.base_width}",
            )

    def _take(self, weights: dict[str, Tensor]) -> None:
        """Into a network of the same size; its looks may be others: what it lacks is left, what it has more stays."""
        drawn = self.network.state_dict()
        weights = drawn | {key: value for key, value in weights.items() if key in drawn}
        self.network.load_state_dict(weights)
        self.averaged.load_state_dict(weights)

    def prepare(self) -> None:
        """Move to the device, for training."""
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

    def _begin_optimizer(self, name: OptimizerName) -> None:
        self._optimizer_name, self.optimizer = name, optimizer_of(self.recipe, self.network, name)

    def step(self, parts: Sequence[Batch], stage: Stage, sample: int) -> float:
        """One step on samples `sample` ... of a stage, of which `parts` are this process's; the loss in metres."""
        for group in self.stepper.param_groups:
            group["lr"] = learning_rate(self.recipe, stage, sample)
        self.stepper.zero_grad(set_to_none=True)
        loss = torch.zeros((), device=self.accelerator.device)
        for number, batch in enumerate(parts):
            weigh_part(self.network, self.recipe.batch_norm_momentum, number, len(parts))
            is_last = number == len(parts) - 1  # which puts the gradients of all processes together
            with nullcontext() if is_last else self.accelerator.no_sync(self.model):
                loss += self._learn(batch, len(parts))
        if not torch.isfinite(loss):
            raise FlightDepthError(
                f"training diverged at sample {sample} of stage {stage.name}: loss {loss};"
                " the last checkpoint stands. Try a lower learning_rate"
            )
        self.stepper.step()
        self.average.update(sample // stage.batch)
        return float(self.accelerator.reduce(loss, "mean"))

    def _learn(self, batch: Batch, parts: int) -> Tensor:
        """Add the gradient of one of `parts` parts; its loss, divided by their number."""
        target_m = torch.from_numpy(batch.target_m).to(self.accelerator.device)
        inputs = network_inputs(self.recipe, batch, self.accelerator.device)
        with self.accelerator.autocast():
            output = self.model(*inputs)
        loss = loss_m(self.recipe, output, target_m) / parts
        self.accelerator.backward(loss)
        return loss.detach()

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
            progress = replace(progress, precision=self.precision)
            save_checkpoint(path, progress, self.network, self.averaged, self.optimizer)
        self.accelerator.wait_for_everyone()


def optimizer_of(recipe: Recipe, network: nn.Module, name: OptimizerName) -> optim.Optimizer:
    """Before the first step; the learning rate is set step by step."""
    # Fused: half the time of the other forms of AdamW, on CPUs too.
    weights, decay = network.parameters(), recipe.weight_decay
    if name == "sgd":
        return optim.SGD(weights, lr=0.0, momentum=SGD_MOMENTUM, weight_decay=decay, fused=True)
    if name == "muon":
        return Muon(network, lr=0.0, weight_decay=decay)
    return optim.AdamW(weights, lr=0.0, weight_decay=decay, fused=True)
