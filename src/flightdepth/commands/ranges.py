"""`flightdepth evaluate ranges`: the paper's multi-range figure, with peers, as a page to look at."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flightdepth.commands.extras import extra_packages
from flightdepth.commands.terminal import counted, say, show_table, warn

if TYPE_CHECKING:
    from rich.table import Table

FIGURES, PAGE = "ranges.json", "ranges.html"
SCENES, FRAMES = 12, 300
QUICK_SCENES, QUICK_FRAMES = 6, 64


class Sweep(StrEnum):
    """What is varied, and everything at once; an enum, since typer takes no list of literals."""

    SHIFT = "shift"
    NOISE = "noise"
    SPEED = "speed"
    TELEMETRY = "telemetry"
    FUSION = "fusion"
    RANGES = "ranges"
    ALL = "all"


def ranges(
    *,
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Figures, page and what was done so far.")
    ] = Path("ranges"),
    sweep: Annotated[
        list[Sweep] | None,
        typer.Option(
            metavar="WHAT",
            help="What to vary beside the paper's figure; may be given several times. shift: how pairs are chosen; "
            "noise: of the orientation; speed: its noise and bias; telemetry: its rate; fusion; ranges: their number; "
            "all.",
        ),
    ] = None,
    network: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="One more network: a shipped one, or an ONNX file with its card; may be given several times.",
        ),
    ] = None,
    scenes: Annotated[
        int | None, typer.Option(metavar="N", help=f"Sequences; {SCENES}, or {QUICK_SCENES} with --quick.")
    ] = None,
    frames: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help=f"Frames of a sequence, 0.033 m apart; {FRAMES}, or {QUICK_FRAMES} with --quick.",
        ),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer and shorter sequences, and fewer settings of each sweep.")
    ] = False,
) -> None:
    """Depth from several ranges on long flights through noisy scenes, beside peers without a network.

    Repeats the paper's last figure (error against time, orientation noise 0.001)
    and, with --sweep, varies what it leaves as it is. The estimator runs as in
    flight. Writes ranges.json and ranges.html into DIR, and keeps the rendered
    pictures there. Stopped, it goes on where it was; with more sweeps or scenes
    only what is new is done.

      flightdepth evaluate ranges --quick --sweep noise

      flightdepth evaluate ranges --quick --network networks/mine.onnx
    """
    with extra_packages("flightdepth evaluate ranges", "train"):
        from flightdepth.evaluation.ranges_sequences import Sequences
        from flightdepth.evaluation.ranges_study import Study
    with extra_packages("flightdepth evaluate ranges", "report"):
        from flightdepth.evaluation.report import page
    from flightdepth.evaluation.ranges_result import result
    from flightdepth.evaluation.ranges_trials import all_trials
    from flightdepth.files import make_folder, write_atomic, write_json
    from flightdepth.weights.store import find_network

    own = tuple(str(Path(name)) for name in network or ())  # one name for `mine.onnx` and `./mine.onnx`
    for name in own:
        find_network(name)  # it is there
    make_folder("--out", out)
    scenes = (QUICK_SCENES if quick else SCENES) if scenes is None else scenes
    frames = (QUICK_FRAMES if quick else FRAMES) if frames is None else frames
    asked = dict.fromkeys(sweep or ())
    named = [each.value for each in (Sweep if Sweep.ALL in asked else asked) if each is not Sweep.ALL]
    study = Study(out, scenes, Sequences(frames), trials=all_trials(named, quick=quick, networks=own))
    for name in study.missing:
        warn(f"{name} is no network of this build: its rows are left out")
    flights, renders = study.left()
    if flights:
        say(f"flights of {frames} frames: {flights}; sequences to render: {renders}")
    for _ in counted(study, "ranges", "flights"):
        pass
    found = result(study)
    write_json(out / FIGURES, found)
    write_atomic(out / PAGE, page(found).encode())
    show(found)
    say(f"figures: {out / FIGURES}; open {out / PAGE} in a browser")


def show(found: dict[str, Any]) -> None:
    """Print the figure as a table, and the verdicts."""
    from flightdepth.evaluation.report_text import points, versus

    show_table(table(found))
    for claim in found["claims"]:
        ends = claim["difference"]
        say(
            f"{claim['verdict']:>13}: {versus(claim, 'over')}: "
            f"error {_times(claim['ratio'])}, difference {points(ends['low'])} to {points(ends['high'])}"
        )


def table(found: dict[str, Any]) -> Table:
    """The paper's figure: error and processor time of each method under the paper's noise."""
    from flightdepth.evaluation.network_tables import laid_out, number
    from flightdepth.evaluation.ranges_trials import NOISE_RAD, as_run, side_by_side, trial_of

    told, spans = {trial_of(row["trial"]): row for row in found["trials"]}, ("all", "near", "middle", "far")
    compared = side_by_side(told)
    flown = (as_run(method=method) for method in dict.fromkeys(trial.method for trial in compared))
    rows = []
    for row in (told[trial] for trial in (*compared, *flown) if trial in told):
        errors = [row["errors"][span]["abs_rel"]["mean"] for span in spans]
        cells = ["-" if error is None else f"{100 * error:.1f}" for error in errors]
        rows.append([row["label"], *cells, number(row["predict_ms"], 1)])
    return laid_out(f"relative error, %, N0 = {NOISE_RAD:g}", ("", *spans, "ms"), rows)


def _times(ratio: float | None) -> str:
    return "-" if ratio is None else f"x {ratio:.2f}"
