"""The folder of a training run: recipe and textures as JSON, the last checkpoint, one per finished stage."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TypeVar

from pydantic import TypeAdapter, ValidationError

from flightdepth.errors import BadInput
from flightdepth.files import write_json
from flightdepth.scenes import Textures
from flightdepth.stillbox.stored import StoredSet
from flightdepth.training.checkpoint import Progress, read_progress
from flightdepth.training.recipe import Recipe, Stage
from flightdepth.weights.card import NetworkCard
from flightdepth.weights.card import Stage as CardStage

CHECKPOINT, RECIPE, TEXTURES = "checkpoint.safetensors", "recipe.json", "textures.json"
SETS = "sets.json"  # the stored sets that the run learns from, where there are any
SHIPPED = "shipped.json"  # the card of the network that the run went on from
PARENT = "parent.json"  # of the run that the run started from, as it stood then

Kept = TypeVar("Kept")


@dataclass(frozen=True)
class Worn:
    """The textures of a run's scenes."""

    count: str
    sha256: str


@dataclass(frozen=True)
class UsedSet:
    """A stored set that a run learns from."""

    scenes: int
    sha256: str
    renderer: str


@dataclass(frozen=True)
class Parent:
    """What a run that another starts from had been through by then: `stages` and `first_shipped` as of `Trained`."""

    stages: tuple[CardStage, ...]
    first_shipped: NetworkCard | None


@dataclass(frozen=True)
class Trained:
    """A checkpoint and the recipe that it follows.

    `parent` is the run that it started from; of a run that did not write that down yet, as it stands now, where it
    still lies beside it. `shipped` is the card of the network that it went on from.
    """

    checkpoint: Path
    recipe: Recipe
    progress: Progress
    parent: Trained | Parent | None
    shipped: NetworkCard | None = None

    @property
    def stages(self) -> tuple[CardStage, ...]:
        """Each stage that was begun here, the parent's first, with the pairs seen in it."""
        before = self.parent.stages if self.parent else ()
        first = stages_behind(self.shipped, self.recipe) if self.shipped else 0
        return before + tuple(
            card_stage(self.recipe, stage, seen)
            for number, stage in enumerate(self.recipe.stages)
            if number >= first and (seen := self._seen(number, stage))
        )

    @property
    def first_shipped(self) -> NetworkCard | None:
        """The card of the shipped network that this run or one of those it started from went on from."""
        return self.shipped or (self.parent.first_shipped if self.parent else None)

    def _seen(self, number: int, stage: Stage) -> int:
        if number == self.progress.stage:
            return self.progress.sample
        return _whole_batches(stage) if number < self.progress.stage else 0


def card_stage(recipe: Recipe, stage: Stage, samples: int) -> CardStage:
    """What a card says of a recipe's stage of which so many pairs were seen."""
    common = CardStage.model_fields.keys() - {"focal_px", "samples", "optimizer"}
    return CardStage(
        **stage.model_dump(include=common),
        focal_px=round(recipe.scenes.focal_px(stage.full_width), 6),
        samples=samples,
        optimizer=recipe.optimizer_in(stage),
    )


def parent_checkpoint(runs: Path, starts_from: str) -> Path:
    """Where a recipe's `starts_from` lies: NAME is a run's last checkpoint, NAME/STAGE that of a stage's end."""
    name, _, stage = starts_from.partition("/")
    return runs / name / (f"{stage}.safetensors" if stage else CHECKPOINT)


def stages_behind(card: NetworkCard, recipe: Recipe) -> int:
    """How many of the recipe's first stages are the card's last: what its network has been through already.

    0 where the card is that of another network, which the recipe starts from.
    """
    if card.name != recipe.name:
        return 0
    trained = [(stage.name, stage.samples) for stage in card.stages]
    wanted = [(stage.name, _whole_batches(stage)) for stage in recipe.stages]
    counts = range(min(len(trained), len(wanted)), 0, -1)
    return next((count for count in counts if trained[-count:] == wanted[:count]), 0)


def read_trained(folder_or_checkpoint: Path) -> Trained:
    """A run's folder, meaning its latest checkpoint, or one of the checkpoints in it.

    Raises:
        BadInput: no checkpoint, no recipe beside it, or the two do not belong together.
    """
    path = folder_or_checkpoint
    checkpoint = path / CHECKPOINT if path.is_dir() else path
    progress = read_progress(checkpoint)
    recipe = read_recipe(checkpoint.parent / RECIPE)
    if progress.digest != recipe.digest:
        raise BadInput(
            f"checkpoint {checkpoint}",
            expected=f"recipe {recipe.name} ({recipe.digest}) as in {RECIPE} beside it",
            got=f"{progress.recipe} ({progress.digest})",
        )
    shipped = _shipped(checkpoint.parent / SHIPPED)
    return Trained(checkpoint, recipe, progress, None if shipped else _parent(checkpoint, recipe), shipped)


def read_recipe(path: Path) -> Recipe:
    """The recipe that a run wrote down."""
    return _read(path, Recipe)


def keep_origin(folder: Path, *, shipped: NetworkCard | None = None, parent: Parent | None = None) -> None:
    """Write down what a fresh run begins from, instead of what one began from that came to no checkpoint."""
    for name, kind, kept in ((SHIPPED, NetworkCard, shipped), (PARENT, Parent, parent)):
        if kept is None:
            (folder / name).unlink(missing_ok=True)
        else:
            write_json(folder / name, TypeAdapter(kind).dump_python(kept, mode="json"))


def keep_textures(folder: Path, textures: Textures) -> None:
    """Write down what the scenes of a run wear; a run resumed in other clothes would not be the same run.

    Raises:
        BadInput: the run was begun with other textures.
    """
    path = folder / TEXTURES
    worn = Worn(str(len(textures)), textures.digest)
    before = _read(path, Worn) if path.exists() else worn
    if before != worn:
        raise BadInput(
            f"textures of run {folder}",
            expected=f"the {before.count} that it began with ({before.sha256[:16]})",
            got=f"{worn.count} ({worn.sha256[:16]})",
            mend="Give the same --textures and --procedural, or train elsewhere: --runs DIR.",
        )
    write_json(path, asdict(worn))


def keep_sets(folder: Path, sets: Mapping[int, StoredSet]) -> None:
    """Write down which stored sets a run learns from, by their width; none leaves no file. Before `keep_textures`.

    Raises:
        BadInput: the run was begun with other sets.
    """
    used = {str(width): UsedSet(len(each), each.digest, each.renderer) for width, each in sets.items()}
    begun = (folder / TEXTURES).exists()
    before = _used_sets(folder) if begun or (folder / SETS).exists() else used
    if before != used:
        raise BadInput(
            f"stored sets of run {folder}",
            expected=f"those that it began with ({SETS})" if before else "none, as it began",
            got=", ".join(str(each.folder) for each in sets.values()) or "none",
            mend="Give the same --set, or train elsewhere: --runs DIR.",
        )
    if used:
        write_json(folder / SETS, {width: asdict(each) for width, each in used.items()})


def drawn_in(folder: Path, textures: Textures) -> bool:
    """Whether a run drew its scenes, in these textures: then those that it learnt from can be drawn again."""
    return not (folder / SETS).exists() and _read(folder / TEXTURES, Worn).sha256 == textures.digest


def stored_renderers(folder: Path) -> str | None:
    """What drew the stored sets that a run learnt from; None where it drew its scenes itself."""
    return ", ".join(sorted({f"stored: {each.renderer}" for each in _used_sets(folder).values()})) or None


def _used_sets(folder: Path) -> dict[str, UsedSet]:
    """By their width; none where the run draws its scenes."""
    return _read(folder / SETS, dict[str, UsedSet]) if (folder / SETS).exists() else {}


def _read(path: Path, kind: type[Kept]) -> Kept:
    """What a run wrote down in one of its JSON files.

    Raises:
        BadInput: it is not there, or not what a run writes.
    """
    try:
        return TypeAdapter(kind).validate_json(path.read_bytes())
    except OSError as error:
        raise BadInput(str(path), expected="a readable file", got=str(error.strerror)) from error
    except ValidationError as error:
        first = error.errors()[0]
        where = ", ".join([str(path), *([".".join(map(str, first["loc"]))] if first["loc"] else [])])
        raise BadInput(where, expected="what train wrote there", got=first["msg"]) from error


def _whole_batches(stage: Stage) -> int:
    return math.ceil(stage.samples / stage.batch) * stage.batch


def _shipped(path: Path) -> NetworkCard | None:
    return _read(path, NetworkCard) if path.exists() else None


def _parent(checkpoint: Path, recipe: Recipe) -> Trained | Parent | None:
    if recipe.starts_from is None:
        return None
    if (kept := checkpoint.parent / PARENT).exists():
        return _read(kept, Parent)
    before = parent_checkpoint(checkpoint.parent.parent, recipe.starts_from)
    return read_trained(before) if before.exists() else None
