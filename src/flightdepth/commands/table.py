"""`flightdepth evaluate table`: the paper's table of results, from a folder of runs."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flightdepth.commands.export import card_of, running
from flightdepth.commands.extras import extra_packages
from flightdepth.commands.figures import JsonOption, check_figures, write_figures
from flightdepth.commands.full_disk import room_on_the_disk
from flightdepth.commands.terminal import counted, say, show_table, warn
from flightdepth.commands.textures import PROCEDURAL, gathered_textures
from flightdepth.commands.train import run
from flightdepth.errors import BadInput
from flightdepth.files import write_json

if TYPE_CHECKING:
    from flightdepth.evaluation.table import Row
    from flightdepth.runtimes.network import Network
    from flightdepth.scenes import Textures
    from flightdepth.training import Recipe
    from flightdepth.training.run_folder import Trained

TIMED_CALLS = 30
Found = dict[str, Any]


def paper_table(
    *,
    runs: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the runs.")] = Path("runs"),
    train: Annotated[
        bool, typer.Option("--train", help="Train what is missing first, or go on where it stopped.")
    ] = False,
    samples: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, help="With --train: pairs of each size, instead of the recipes'."),
    ] = None,
    scenes: Annotated[int, typer.Option(metavar="N", min=1, help="Scenes of each test set.")] = 300,
    textures: Annotated[
        Path | None, typer.Option(metavar="DIR", help="The photos that the runs' scenes wear, as of train.")
    ] = None,
    procedural: Annotated[
        int, typer.Option(metavar="N", help="How many made textures, as of train.")
    ] = PROCEDURAL,
    json: JsonOption = None,
) -> None:
    """The paper's L1 and RMSE for FlowNetS and DepthNet, chain by chain, ours beside the published ones.

    Rows come from the runs folder; what was not trained is marked so. Errors,
    once measured, are kept beside their checkpoint. Shipped networks stand below.

      flightdepth evaluate table

    All of it with one dial; Ctrl-C stops, the same command goes on:

      flightdepth evaluate table --train --samples 20000
    """
    with extra_packages("flightdepth evaluate", "train"):
        from flightdepth.evaluation import table as paper
        from flightdepth.evaluation.provenance import source_commit
        from flightdepth.scenes import Textures

    if samples is not None and not train:
        raise BadInput("--samples", expected="--train beside it", got="it alone")
    check_figures(json)
    some = train or runs.is_dir()
    dressed = gathered_textures(textures, procedural) if some else Textures.from_images([])
    if train:
        train_all(runs, dressed, samples)
    rows = [(row, of_run(row, runs, dressed, scenes)) for row in paper.ROWS] + list(of_shipped())
    for each in paper.tables(rows):
        show_table(each)
    say_what_was_measured(rows)
    write_figures(
        json, {"commit": source_commit(), "scenes": scenes, "rows": [as_json(*each) for each in rows]}
    )


def train_all(runs: Path, textures: Textures, samples: int | None) -> None:
    """Every recipe of the table, one after the other, those before first."""
    from flightdepth.evaluation.table import RECIPES
    from flightdepth.training import load_recipe
    from flightdepth.training.run_folder import read_trained

    for number, name in enumerate(RECIPES, 1):
        recipe = scaled(load_recipe(name), samples)
        say(f"{number} of {len(RECIPES)}: {name}, {recipe.samples:,} pairs in {len(recipe.stages)} stages")
        with room_on_the_disk(runs):
            run(recipe, textures, runs / name, resume=True)
        if read_trained(runs / name).progress.stage < len(recipe.stages):
            say("stopped; the same command goes on from here")
            raise typer.Exit(130)


def scaled(recipe: Recipe, samples: int | None) -> Recipe:
    """The recipe with that many pairs of each size, what comes after in proportion."""
    from flightdepth.evaluation.table import PAIRS_A_SIZE

    return recipe if samples is None else recipe.scaled_to(round(recipe.samples * samples / PAIRS_A_SIZE))


def of_run(row: Row, runs: Path, textures: Textures, scenes: int) -> Found | None:
    """What was measured for a row, now or before; None where its checkpoint is missing."""
    from flightdepth.training.run_folder import parent_checkpoint, read_trained

    checkpoint = parent_checkpoint(runs, row.source)
    if not checkpoint.exists():
        return None
    trained, kept = read_trained(checkpoint), checkpoint.with_suffix(".figures.json")
    wanted = key(checkpoint, trained, textures, scenes)
    found: Found = json.loads(kept.read_bytes()) if kept.exists() else {}
    network = opened(trained, row.source.replace("/", "-"))
    if {name: found.get(name) for name in wanted} != wanted:
        found = wanted | facts(network) | measured_errors(row, network, trained, textures, scenes)
        write_json(kept, found)
    return found | timing(network)


def opened(trained: Trained, name: str) -> Network:
    """The averaged weights of a checkpoint, ready to run by that name."""
    from flightdepth.training.checkpoint import read_weights
    from flightdepth.training.export import deployed, to_onnx

    onnx = to_onnx(deployed(trained.recipe, read_weights(trained.checkpoint, "averaged")))
    card = card_of(trained, name)
    return running(card.model_copy(update={"sha256": hashlib.sha256(onnx).hexdigest()}), onnx)


def key(checkpoint: Path, trained: Trained, textures: Textures, scenes: int) -> Found:
    """What figures depend on; they are measured again when it changes."""
    from flightdepth.renderers.raycast import VERSION
    from flightdepth.scenes.config import SET_VERSION
    from flightdepth.training.run_folder import drawn_in

    return {
        "checkpoint_sha256": hashlib.sha256(checkpoint.read_bytes()).hexdigest(),
        "recipe": trained.recipe.name,
        "recipe_digest": trained.recipe.digest,
        "scenes": scenes,
        "set_version": SET_VERSION,
        "renderer": VERSION,
        "same_textures": drawn_in(checkpoint.parent, textures),
    }


def measured_errors(row: Row, network: Network, trained: Trained, textures: Textures, scenes: int) -> Found:
    """On the test set, and on the last scenes of training where they can be drawn again."""
    from flightdepth.evaluation.network import evaluate_network
    from flightdepth.evaluation.table import LastScenes, whole_set
    from flightdepth.training.run_folder import drawn_in

    tests = whole_set(network.card, scenes)
    name, shown = f"Still Box {tests.picture.width} px", counted(tests, f"{row.title}, test", "scenes")
    found = {"test": evaluate_network(network, shown, set_name=name, seed=tests.seed)}
    if drawn_in(trained.checkpoint.parent, textures):
        last = LastScenes.of(trained, network.card, textures, scenes)
        shown = counted(last, f"{row.title}, train", "scenes")
        found["train"] = evaluate_network(network, shown, set_name="training", seed=last.scenes.seed)
    return found


def facts(network: Network) -> Found:
    """Size and training of a network."""
    from flightdepth.evaluation.provenance import source_commit
    from flightdepth.evaluation.table import parameters

    card = network.card
    of_motion = {"looks", "thorough_last_look", "residual_blocks"} if card.knows_direction else set()
    return {
        "commit": source_commit(),
        "weights_sha256": card.sha256,
        "samples": card.samples,
        "width_px": round(2 * card.focal_px),
        "stages": [stage.model_dump(mode="json", exclude_defaults=True) for stage in card.stages],
        "parameters": parameters(card.architecture, card.base_width, **card.model_dump(include=of_motion)),
    }


def timing(network: Network) -> Found:
    """Of this machine, now: never kept."""
    from flightdepth.evaluation.table import median_ms
    from flightdepth.processor import cpu_name

    return {
        "median_ms": median_ms(network, TIMED_CALLS),
        "runtime": network.runtime.description,
        "cpu": cpu_name(),
    }


def of_shipped() -> Iterator[tuple[Row, Found]]:
    """Shipped networks of the table's range, with the errors on their cards, at the focal length of those."""
    from flightdepth.evaluation.fixed_set import full_width
    from flightdepth.evaluation.table import shipped_row
    from flightdepth.weights.store import read_network, shipped_networks

    for name in shipped_networks():
        stored = read_network(name)
        card = stored.card
        if (card.depth_min_m, card.depth_max_m, card.nominal_shift) != (0, 100, 3) or not card.metrics:
            continue
        card = card.at_focal(full_width(card) / 2)
        found = card.metrics
        test = {"network": {each: found[each] for each in ("l1_m", "rmse_m")}}
        test |= {peer: {"l1_m": found[f"{peer}_l1_m"]} for peer in ("constant", "classical")}
        network = running(card, stored.onnx)
        yield shipped_row(card), facts(network) | timing(network) | {"test": test, "card": card.name}


def say_what_was_measured(rows: list[tuple[Row, Found | None]]) -> None:
    """Whether metres can be compared, and what is missing."""
    from flightdepth.evaluation.table import inside_original

    found = [each for _, each in rows if each]
    depths = {
        each["test"]["set"]: each["test"]["truth_percentiles_m"] for each in found if "set" in each["test"]
    }
    for name, percentiles in depths.items():
        spread = " / ".join(f"{value:.1f}" for value in percentiles.values())
        inside = "inside" if inside_original(percentiles) else "OUTSIDE"
        say(f"{name}: depth percentiles 5/25/50/75/95 {spread} m, {inside} the span of the original's scenes")
    if any("recipe" in each and "train" not in each for each in found):
        warn("no errors on training scenes: give the --textures and --procedural of the runs")
    if found:
        say(f"times: one pair, {found[0]['runtime']} on {found[0]['cpu']}")
    if any(each is None for _, each in rows):
        say("rows that are not trained: flightdepth evaluate table --train [--samples N]")


def as_json(row: Row, found: Found | None) -> Found:
    """A row whole: published figures, measured ones, where each comes from."""
    return asdict(row) | {"measured": found}
