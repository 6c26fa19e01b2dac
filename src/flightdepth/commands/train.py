"""`flightdepth train`: a recipe, from the first pair to the last checkpoint."""

from __future__ import annotations

import io
from contextlib import ExitStack, nullcontext, redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flightdepth.commands.extras import extra_packages
from flightdepth.commands.full_disk import room_on_the_disk
from flightdepth.commands.signals import stop_request
from flightdepth.commands.terminal import ToldProgress, progress_bar, say, warn
from flightdepth.commands.textures import ProceduralOption, TexturesOption, gathered_textures
from flightdepth.errors import BadInput
from flightdepth.files import held, make_folder, names_in

if TYPE_CHECKING:
    from flightdepth.scenes import Textures
    from flightdepth.stillbox.stored import StoredSet
    from flightdepth.training import Recipe
    from flightdepth.training.loop import Report
    from flightdepth.weights.store import StoredNetwork


SAVING = "finishing this step, then saving; Ctrl-C again ends at once, without saving"


def train(
    recipe: Annotated[str, typer.Argument(metavar="RECIPE", help="A shipped recipe's name, or a TOML file.")],
    *,
    resume: Annotated[bool, typer.Option("--resume", help="Go on where the run was stopped.")] = False,
    shipped: Annotated[
        bool,
        typer.Option(
            "--shipped", help="Go on from the shipped network of that name, with the stages it lacks."
        ),
    ] = False,
    samples: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="Pairs in all, instead of the recipe's.")
    ] = None,
    textures: TexturesOption = None,
    procedural: ProceduralOption = None,
    sets: Annotated[
        list[Path] | None,
        typer.Option("--set", metavar="DIR", help="Learn from a stored set, one for each picture width."),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            min=0,
            help="Processes that make pairs ahead of time: a free core each beside a GPU, none without one.",
        ),
    ] = None,
    runs: Annotated[Path, typer.Option(metavar="DIR", help="The run is kept in DIR/NAME-OF-RECIPE.")] = Path(
        "runs"
    ),
) -> None:
    """Train a network; scenes are rendered while it learns, nothing is downloaded.

    Ctrl-C saves the run and stops it. --resume goes on with exactly the steps
    that would have come.

      flightdepth train depthnet-256

    Your own photos on the scenes' walls, and a twentieth of the pairs:

      flightdepth train tiny-clamped-256 --textures photos --samples 20000

    Stages of your own, appended to a copy of the recipe, on top of the shipped
    weights:

      flightdepth train my/tiny-clamped-512.toml --shipped

    Stored sets instead of drawn scenes, the original's or those of `render`:

      flightdepth train depthnet-256 --set stillbox/64 --set stillbox/128 \\
        --set stillbox/256

    Several GPUs, or several processes on one CPU, share each batch:

      torchrun --nproc_per_node 2 -m flightdepth train depthnet-256
    """
    with extra_packages("flightdepth train", "train"):
        from flightdepth.scenes import Textures
        from flightdepth.training import load_recipe
        from flightdepth.training.processes import this_process
    from flightdepth.weights.store import read_network, shipped_networks

    wanted = load_recipe(recipe)
    wanted = wanted if samples is None else wanted.scaled_to(samples)
    if shipped and wanted.name not in shipped_networks():
        raise BadInput(
            "--shipped",
            expected=f"a recipe by the name of a network that ships: {', '.join(shipped_networks())}",
            got=wanted.name,
            mend='Keep that name, or write starts_from = "NETWORK" into the recipe.',
        )
    folder, first = runs / wanted.name, this_process().is_main_process
    with nullcontext() if first else redirect_stdout(io.StringIO()):  # one of several processes speaks
        if first:  # before long there are files of this run
            make_folder("--runs", runs)
            refuse_to_overwrite(folder, resume=resume)
        start = read_network(wanted.name) if shipped else None
        introduce(wanted, folder, resume=resume, shipped=start)
        for option, value in (("--textures", textures), ("--procedural", procedural)):
            if sets and value is not None:
                raise BadInput(
                    "--set", expected=f"no {option} beside it", got=f"{value}: its scenes are dressed"
                )
        stored = opened_sets(sets or [], wanted)
        dressed = Textures.from_images([]) if stored else gathered_textures(textures, procedural)
        with room_on_the_disk(folder, "give the same command with --resume"):
            run(wanted, dressed, folder, resume=resume, shipped=start, sets=stored, workers=workers)
        conclude(wanted, folder)


def run(
    recipe: Recipe,
    textures: Textures,
    folder: Path,
    *,
    resume: bool,
    shipped: StoredNetwork | None = None,
    sets: dict[int, StoredSet] | None = None,
    workers: int | None = None,
) -> None:
    """Train with a progress bar, until the end, Ctrl-C or SIGTERM."""
    from flightdepth.machine import usable_cores
    from flightdepth.training.freed_memory import keep_freed_memory
    from flightdepth.training.held_out import HeldOut
    from flightdepth.training.loop import train as train_on
    from flightdepth.training.processes import this_process

    state = this_process()
    if state.device.type == "cpu":
        keep_freed_memory()
    # The launcher of several processes passes on what the terminal has told them already.
    alone = state.num_processes == 1
    threads = max(1, usable_cores() // state.num_processes)
    learnt_from, left_out = (
        {width: each.split()[part] for width, each in (sets or {}).items()} for part in (0, 1)
    )
    with stop_request(SAVING if alone else None, insist=alone) as stop, ExitStack() as stack:
        options: dict[str, Any] = {}
        if state.is_main_process:
            stack.enter_context(held(folder, "run folder", "training", "train elsewhere: --runs DIR"))
            bar = stack.enter_context(progress_bar(recipe.name, recipe.samples, "samples"))
            options |= {"report": Display(bar), "held_out": HeldOut(recipe, textures, left_out, threads)}
        train_on(
            recipe,
            textures,
            folder,
            resume=resume,
            shipped=shipped,
            sets=learnt_from,
            stop=stop.is_set,
            threads=threads,
            workers=workers,
            **options,
        )


def refuse_to_overwrite(folder: Path, *, resume: bool) -> None:
    """A run is never begun on top of another."""
    if not resume and folder.exists() and names_in(folder):
        raise BadInput(
            f"run folder {folder}",
            expected="a new one",
            got="one with files in it",
            mend="Go on with it: --resume; or train elsewhere: --runs DIR.",
        )


def opened_sets(folders: list[Path], recipe: Recipe) -> dict[int, StoredSet]:
    """Each stored set by its width; every stage of the recipe finds one that it can learn from, if there are any."""
    from flightdepth.stillbox.stored import open_stored_set
    from flightdepth.stillbox.stored_pairs import refuse_unfit

    sets = {each.width: each for each in map(open_stored_set, folders)}
    if len(sets) < len(folders):
        raise BadInput("--set", expected="one set of each width", got=", ".join(map(str, folders)))
    lacking = [(stage.full_width, stage.name) for stage in recipe.stages if stage.full_width not in sets]
    if folders and lacking:
        raise BadInput(
            "--set",
            expected="a set of {} px for stage {}".format(*lacking[0]),
            got=", ".join(f"{each.folder} of {each.width} px" for each in sets.values()),
            mend="Give --set once for each width.",
        )
    for each in sets.values():
        say(
            f"{each.folder}: {len(each):,} scenes of {each.width}x{each.height} px, four fifths of them to learn from"
        )
    parts = {width: each.split() for width, each in sets.items()}  # to learn from, and held out
    for stage in recipe.stages if sets else ():
        for part in parts[stage.full_width]:
            refuse_unfit(part, recipe.scenes_in(stage), stage.picture)
    return sets


def introduce(
    recipe: Recipe, folder: Path, *, resume: bool = False, shipped: StoredNetwork | None = None
) -> None:
    """Say what is about to run, and from where."""
    from flightdepth.training.processes import this_process
    from flightdepth.training.run_folder import CHECKPOINT
    from flightdepth.training.start import start_of

    stages = ", ".join(
        f"{stage.name} ({stage.width}x{stage.height} px, {stage.samples:,})" for stage in recipe.stages
    )
    say(f"{recipe.name}: {recipe.samples:,} pairs in stages {stages}")
    if (processes := this_process().num_processes) > 1:
        say(f"{processes} processes, which share each batch")
    stands = (folder / CHECKPOINT).exists()
    if resume and stands and this_process().is_main_process:
        warn_of_other_versions(folder / CHECKPOINT)
    if resume and not stands:
        say(f"no checkpoint in {folder} to resume: the run begins")
    if not stands and (start := start_of(recipe, folder.parent, shipped)) is not None:
        say(f"goes on from {start.origin}")
        if left := start.left_behind(recipe):
            keys = "looks, thorough_last_look and residual_blocks"
            say(f"left behind: {', '.join(left)}; with its {keys} {recipe.name} has no place for them")
    say(f"run folder: {folder}; curves: tensorboard --logdir {folder / 'tensorboard'}")


def warn_of_other_versions(checkpoint: Path) -> None:
    """A run goes on exactly by what it was begun with."""
    from flightdepth.training.checkpoint import read_progress, versions

    before = read_progress(checkpoint)
    others = [
        f"{name} {kept}, here {now}"
        for name, now in versions().items()
        if (kept := getattr(before, name)) not in (None, now)
    ]
    if others:
        warn(f"{checkpoint} is by {'; by '.join(others)}: what it goes on to may be other bytes")


class Display:
    """Draws reports on a bar."""

    def __init__(self, bar: ToldProgress) -> None:
        self._bar = bar
        self._begun = False

    def __call__(self, report: Report) -> None:
        """Show one step."""
        if not self._begun:
            self._begun = True
            self._bar.begin_at(report.seen, report.total)
        text = f"stage {report.stage}, loss {report.loss_m:.3f} m"
        if report.test_l1_m is not None:
            text += f", test {report.test_l1_m:.3f} m"
        self._bar.reach(report.seen, text)


def conclude(recipe: Recipe, folder: Path) -> None:
    """Say how far the run came, and what to do next."""
    from flightdepth.training.run_folder import CHECKPOINT, read_trained

    progress = read_trained(folder).progress
    say(f"{folder / CHECKPOINT}: {progress.seen:,} pairs, loss {progress.loss_m:.3f} m")
    if progress.stage < len(recipe.stages):
        say("stopped; the same command with --resume goes on from here")
        raise typer.Exit(130)
    say(f"next: flightdepth export {folder}")
