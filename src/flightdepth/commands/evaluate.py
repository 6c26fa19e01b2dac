"""`flightdepth evaluate`: how good a network is."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flightdepth.commands.baselines import baselines
from flightdepth.commands.extras import extra_packages
from flightdepth.commands.figures import JsonOption, check_figures, write_figures
from flightdepth.commands.flight_truth import flight_truth
from flightdepth.commands.noise import noise
from flightdepth.commands.ranges import ranges
from flightdepth.commands.renderers import renderer
from flightdepth.commands.table import paper_table
from flightdepth.commands.terminal import counted, say, show_table
from flightdepth.commands.tracks import tracks
from flightdepth.errors import BadInput
from flightdepth.files import make_folder

if TYPE_CHECKING:
    from flightdepth.evaluation.fixed_set import AnySet
    from flightdepth.runtimes.network import Network

SCENES = 300  # of a fixed test set
PICTURES = 16  # sheets that --pictures writes
SHOWN = 3  # on the page of --report

evaluate = typer.Typer(no_args_is_help=True, help="Measure a network, depth on a flight, or the renderer.")


evaluate.command("flight")(flight_truth)
evaluate.command("tracks")(tracks)
evaluate.command("renderer")(renderer)
evaluate.command("noise")(noise)
evaluate.command("baselines")(baselines)
evaluate.command("ranges")(ranges)
evaluate.command("table")(paper_table)


@evaluate.command("network")
def evaluate_network_command(
    network: Annotated[str, typer.Argument(metavar="NETWORK", help="A shipped name, or an ONNX file.")],
    *,
    scenes: Annotated[
        int | None, typer.Option(metavar="N", help="Scenes of the test set. Default: 300, or all of --set.")
    ] = None,
    json: JsonOption = None,
    pictures: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help=f"Write the first {PICTURES} results there as pictures."),
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Write the network's page there: NAME.md and its pictures."),
    ] = None,
    textures: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Photos to dress the scenes in: a set of your own.")
    ] = None,
    outdoor: Annotated[
        bool, typer.Option("--outdoor", help="Drone flights under a sky instead of rooms.")
    ] = False,
    stored: Annotated[
        Path | None,
        typer.Option("--set", metavar="DIR", help="A set on the disk, as `render` writes it, instead."),
    ] = None,
    held_out: Annotated[
        bool,
        typer.Option("--held-out", help="Of --set only the fifth that `train --set` does not learn from."),
    ] = False,
    fov: Annotated[
        float,
        typer.Option(
            metavar="DEG",
            help="Horizontal field of view in degrees; another lens for networks that know any.",
        ),
    ] = 90.0,
    flight_size: Annotated[
        bool,
        typer.Option(
            "--flight-size", help="Pictures as large as flights are seen, of networks that know any lens."
        ),
    ] = False,
) -> None:
    """Errors on the fixed test set, beside the best constant depth and the classical peer.

    The rooms that the figures on a network's card are of:

      flightdepth evaluate network depthnet-256 --json depthnet-256.json

    Where no network was trained, and through another lens:

      flightdepth evaluate network motion --outdoor

      flightdepth evaluate network motion --fov 60

    In pictures as large as flights are seen, with more around each point:

      flightdepth evaluate network motion --flight-size

    Scenes that another renderer made, Blender or the authors' own:

      flightdepth render 256 --renderer blender --samples 32 --scenes 40 \\
        --out blender-256

      flightdepth evaluate network motion --set blender-256

    A network that learnt from a set, on the scenes that were held back:

      flightdepth evaluate network mine.onnx --set stillbox/256 --held-out
    """
    with extra_packages("flightdepth evaluate", "train"):
        from flightdepth.evaluation.fixed_set import fixed_set, outdoor_set, stored_set
        from flightdepth.scenes import textures_from_folder
    from flightdepth.runtimes.network import load_network

    check_figures(json)
    if held_out and stored is None:
        raise BadInput("--held-out", expected="--set beside it", got="it alone")
    _refuse_other_sets(outdoor=outdoor, stored=stored, textures=textures, fov=fov, flight_size=flight_size)
    for option, target in (("--pictures", pictures), ("--report", report)):
        if target is not None:
            make_folder(option, target)
    opened = load_network(network, "openvino", precision="f32")
    own = None if textures is None else textures_from_folder(textures)
    count = SCENES if scenes is None else scenes
    pairs: AnySet
    if stored is not None:
        pairs = stored_set(opened.card, stored, scenes=scenes, held_out=held_out)
    elif outdoor:
        pairs = outdoor_set(opened.card, scenes=count, flight_size=flight_size)
    else:
        pairs = fixed_set(
            opened.card,
            scenes=count,
            textures=own,
            horizontal_fov_deg=fov,
            flight_size=flight_size,
        )
    result = evaluated(opened, pairs)
    show(result)
    keep(result, opened, pairs, json, pictures)
    if report is not None:
        options: dict[str, Path | float | None] = {
            "--set": stored,
            "--held-out": held_out,
            "--outdoor": outdoor,
            "--textures": textures,
            "--fov": fov if fov != 90 else None,
            "--flight-size": flight_size,
            "--scenes": scenes,
        }
        write_report(report, result, opened, pairs, as_given(options))


def as_given(options: Mapping[str, Path | float | None]) -> str:
    """Options of the command line as a page repeats them, folders without their names."""
    words = []
    for name, value in options.items():
        if isinstance(value, Path):
            words.append(f"{name} DIR")
        elif value is True:
            words.append(name)
        elif value:
            words.append(f"{name} {value:g}")
    return " ".join(words)


def _refuse_other_sets(
    *, outdoor: bool, stored: Path | None, textures: Path | None, fov: float, flight_size: bool
) -> None:
    """Refuse what would say two things of which set to take."""
    given = {
        "--set": stored is not None,
        "--outdoor": outdoor,
        "--textures": textures is not None,
        "--fov": fov != 90,
        "--flight-size": flight_size and stored is not None,
    }
    asked = [option for option, is_given in given.items() if is_given]
    if asked[:1] in (["--set"], ["--outdoor"]) and len(asked) > 1:
        alone, *others = asked
        raise BadInput(alone, expected="no other option of the scenes beside it", got=", ".join(others))


def evaluated(network: Network, pairs: AnySet) -> dict[str, Any]:
    """All figures, with a progress bar."""
    from flightdepth.evaluation.fixed_set import set_name
    from flightdepth.evaluation.network import evaluate_network

    shown = counted(pairs, network.card.name, "scenes")
    return evaluate_network(network, shown, set_name=set_name(pairs), seed=pairs.seed)


def show(result: dict[str, Any]) -> None:
    """Print the tables."""
    from flightdepth.evaluation.network_tables import tables
    from flightdepth.evaluation.provenance import origin

    for table in tables(result):
        show_table(table)
    say(origin(result))


def keep(
    result: dict[str, Any],
    network: Network,
    pairs: AnySet,
    json: Path | None,
    pictures: Path | None,
) -> None:
    """Write what was asked for."""
    from flightdepth.evaluation.pictures import write_sheets

    write_figures(json, result)
    if pictures is not None:
        first = map(pairs.pair, range(min(PICTURES, len(pairs))))
        say(f"pictures: {len(write_sheets(network, first, pictures))} in {pictures}")


def write_report(folder: Path, result: dict[str, Any], network: Network, pairs: AnySet, given: str) -> None:
    """Write the network's page; `given`: the options that say which pairs were measured."""
    from flightdepth.evaluation.page import write_page

    first = map(pairs.pair, range(min(SHOWN, len(pairs))))
    page, *_ = write_page(folder, network, result, first, given)
    say(f"page: {page}")
