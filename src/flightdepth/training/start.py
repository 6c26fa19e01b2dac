"""What a run begins from, but for random weights: another run's average, or a network that ships."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from flightdepth.errors import BadInput
from flightdepth.training.checkpoint import read_weights
from flightdepth.training.export import weights_of
from flightdepth.training.network import network_of
from flightdepth.training.recipe import Recipe
from flightdepth.training.run_folder import CHECKPOINT, Parent, parent_checkpoint, read_trained, stages_behind
from flightdepth.weights.card import NetworkCard
from flightdepth.weights.store import StoredNetwork, read_network, shipped_networks

SAME_SCALE = 0.01  # by which share its unit may be another


@dataclass(frozen=True)
class Start:
    """Weights of a network of the recipe's size; its looks and residual blocks may be others.

    origin   where they are from, in words
    weights  a state dict
    seen     pairs that they learnt from
    stage    number of the recipe's stage that comes next
    card     of the network that ships, where it is one
    parent   what the run had been through, where it is one
    """

    origin: str
    weights: Mapping[str, Tensor]
    seen: int
    stage: int = 0
    card: NetworkCard | None = None
    parent: Parent | None = None

    def left_behind(self, recipe: Recipe) -> tuple[str, ...]:
        """What of it the recipe's network has no place for: the outermost modules, as `refinement`."""
        with torch.device("meta"):  # names are all that is asked
            network = network_of(recipe)
        known = {*dict(network.named_modules()), *network.state_dict()}
        paths = [_prefixes(key) for key in self.weights]
        lacking = [next((each for each in path if each not in known), None) for path in paths]
        return tuple(dict.fromkeys(each for each in lacking if each is not None))


def start_of(recipe: Recipe, runs: Path, shipped: StoredNetwork | None = None) -> Start | None:
    """What a fresh run in the folder `runs` begins from; None means random weights.

    That is `shipped`, where it is given, after the stages that its card lists; else what the recipe starts from: its
    run among `runs`, or the network of that name that ships, or the ONNX file of that path, beside its card.

    Raises:
        BadInput: there is neither, or it is a network of another size.
    """
    if shipped is not None:
        return _shipped_after_its_stages(recipe, shipped)
    if recipe.starts_from is None:
        return None
    parent = parent_checkpoint(runs, recipe.starts_from)
    if parent.exists():
        return _run(recipe, parent)
    if recipe.starts_from in shipped_networks():
        return _shipped(recipe, read_network(recipe.starts_from), stage=0)
    if Path(recipe.starts_from).suffix == ".onnx":
        return _file(recipe, recipe.starts_from)
    raise BadInput(
        f"recipe {recipe.name}",
        expected=f"{parent} to start from",
        got="no such file",
        mend=f"Train {parent.parent.name} first, into the same folder of runs.",
    )


def _run(recipe: Recipe, checkpoint: Path) -> Start:
    """The averaged weights of a run at a checkpoint."""
    run = read_trained(checkpoint)
    before, seen = run.recipe, run.progress.seen
    _check_same_size(recipe, before.name, before.architecture, before.base_width)
    _check_same_scale(recipe, before.name, before.shift_px_m)
    if not seen:
        raise BadInput(
            f"recipe {recipe.name}",
            expected=f"a run to start from that has learnt, {checkpoint}",
            got="0 pairs",
            mend=f"Train {before.name} first.",
        )
    goes_on = checkpoint.name == CHECKPOINT and run.progress.stage < len(before.stages)
    origin = f"{checkpoint}: {seen:,} pairs{', a run that has not finished' if goes_on else ''}"
    weights = read_weights(checkpoint, "averaged")
    return Start(origin, weights, seen, parent=Parent(run.stages, run.first_shipped))


def _shipped_after_its_stages(recipe: Recipe, shipped: StoredNetwork) -> Start:
    """A shipped network, with the first of the recipe's stages that its card does not list."""
    card, behind = shipped.card, stages_behind(shipped.card, recipe)
    facts = ("architecture", "base_width", "activation")
    if behind == 0 or any(getattr(card, fact) != getattr(recipe, fact) for fact in facts):
        raise BadInput(
            f"recipe {recipe.name}",
            expected=f"a recipe whose first stages are the last of {card.name}'s",
            got=", ".join(f"{stage.name} ({stage.samples:,})" for stage in recipe.stages),
            mend="Append your stages to the recipe that the network was trained with, and give no --samples.",
        )
    if behind == len(recipe.stages):
        raise BadInput(
            f"recipe {recipe.name}",
            expected=f"stages beyond those that {card.name} has been through",
            got="none",
            mend="Append your stages to a copy of the recipe.",
        )
    return _shipped(recipe, shipped, stage=behind)


def _shipped(recipe: Recipe, shipped: StoredNetwork, *, stage: int) -> Start:
    card = shipped.card
    _check_same_size(recipe, card.name, card.architecture, card.base_width)
    _check_same_scale(recipe, card.name, card.D0_m * card.focal_px if card.any_lens else None)
    return Start(f"{card.name}, which ships", weights_of(shipped.onnx), card.samples, stage, card)


def _file(recipe: Recipe, path: str) -> Start:
    """A network file of the user's own, which every stage of the recipe goes on from."""
    start = _shipped(recipe, read_network(path), stage=0)
    assert start.card is not None
    if stages_behind(start.card, recipe):  # they would be taken for what the file has been through
        raise BadInput(
            f"recipe {recipe.name}",
            expected=f"another name, since it starts from a network of that name, {path}",
            got=recipe.name,
        )
    return replace(start, origin=f"{path}: {start.seen:,} pairs")


def _check_same_size(recipe: Recipe, name: str, architecture: str, base_width: int) -> None:
    if (architecture, base_width) != (recipe.architecture, recipe.base_width):
        raise BadInput(
            f"recipe {recipe.name}",
            expected=f"a {architecture} of base width {base_width}, as {name}",
            got=f"a {recipe.architecture} of {recipe.base_width}",
        )


def _check_same_scale(recipe: Recipe, name: str, shift_px_m: float | None) -> None:
    """Where both know any lens, what the weights say is metres at the recipe's nominal displacement, too."""
    own = recipe.shift_px_m
    if own is None or shift_px_m is None or abs(own / shift_px_m - 1) <= SAME_SCALE:
        return
    shift = max(1, round(recipe.nominal_shift * shift_px_m / own))
    raise BadInput(
        f"recipe {recipe.name}, nominal_shift * step * reference_focal_px",
        expected=f"{shift_px_m:g} m px, as {name}",
        got=f"{own:g}, where all would begin {shift_px_m / own:.3g} times as far away as it is",
        mend=f"Write nominal_shift = {shift} and reference_focal_px = {shift_px_m / shift / recipe.scenes.step_m:.6g}.",
    )


def _prefixes(key: str) -> list[str]:
    """ "a.b.c" as "a", "a.b" and "a.b.c"."""
    parts = key.split(".")
    return [".".join(parts[: number + 1]) for number in range(len(parts))]
