"""`flightdepth evaluate ranges`: the paper's multi-range figure, with peers, as a page to look at."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flightdepth.commands.extras import extra_packages
from flightdepth.commands.terminal import counted, say, warn
from flightdepth.errors import BadInput

if TYPE_CHECKING:
    from rich.table import Table

FIGURES, PAGE = "ranges.json", "ranges.html"


def ranges(
    *,
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Figures, page and what was done so far.")
    ] = Path("ranges"),
    scenes: Annotated[int, typer.Option(metavar="N", help="Sequences.")] = 12,
    frames: Annotated[int, typer.Option(metavar="N", help="Frames of each, 0.033 m apart.")] = 300,
    quick: Annotated[
        bool, typer.Option("--quick", help="The paper's figure and the peers only, no sweeps.")
    ] = False,
) -> None:
    """Depth from several ranges on long flights through noisy scenes, beside peers without a network.

    Repeats the paper's last figure (error against time, orientation noise 0.001)
    and sweeps what it leaves out: the noise, the telemetry, how pairs are chosen.
    The estimator runs as in flight. Writes ranges.json and ranges.html into DIR.
    Stopped, it goes on where it was; with more scenes only the new ones are done.

      flightdepth evaluate ranges --quick --scenes 4 --frames 120
    """
    with extra_packages("flightdepth evaluate ranges", "train"):
        from flightdepth.evaluation.ranges_sequences import Sequences
        from flightdepth.evaluation.ranges_study import Study
    with extra_packages("flightdepth evaluate ranges", "report"):
        from flightdepth.evaluation.report import page
    from flightdepth.evaluation.ranges_result import result
    from flightdepth.evaluation.ranges_trials import all_trials
    from flightdepth.files import write_atomic, write_json

    if out.exists() and not out.is_dir():
        raise BadInput("--out", expected="a folder", got=str(out))
    study = Study(out, scenes, Sequences(frames), trials=all_trials(quick=quick))
    for name in study.missing:
        warn(f"{name} is no network of this build: its rows are left out")
    for _ in counted(study, "ranges", "flights"):
        pass
    found = result(study, machine=machine())
    write_json(out / FIGURES, found)
    write_atomic(out / PAGE, page(found).encode())
    show(found)
    say(f"figures: {out / FIGURES}; open {out / PAGE} in a browser")


def machine() -> str:
    """The processor's name."""
    import platform

    info = Path("/proc/cpuinfo")
    lines = info.read_text("utf-8").splitlines() if info.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def show(found: dict[str, Any]) -> None:
    """Print the figure as a table, and the verdicts."""
    from rich.console import Console

    Console().print(table(found))
    for claim in found["claims"]:
        ends = claim["difference"]
        span = "" if claim["span"] == "all" else f", {claim['span']} depths"
        noise = "" if claim["noise_rad"] == 0.001 else f", N0 = {claim['noise_rad']:g}"
        say(
            f"{claim['verdict']:>13}: {claim['better']} over {claim['worse']}{span}{noise}: "
            f"error {_times(claim['ratio'])}, difference {_points(ends['low'])} to {_points(ends['high'])}"
        )


def table(found: dict[str, Any]) -> Table:
    """The paper's figure: error and processor time of each method under the paper's noise."""
    from rich.table import Table

    from flightdepth.evaluation.ranges_trials import figure, peers, trial_of

    wanted, spans = {*figure(), *peers()}, ("all", "near", "middle", "far")
    grid = Table(title="relative error, %, N0 = 0.001", box=None, pad_edge=False)
    grid.add_column("", no_wrap=True)
    for heading in (*spans, "ms"):
        grid.add_column(heading, justify="right")
    for row in found["trials"]:
        if trial_of(row["trial"]) in wanted:
            errors = [row["errors"][span]["abs_rel"]["mean"] for span in spans]
            cells = ["-" if error is None else f"{100 * error:.1f}" for error in errors]
            grid.add_row(row["label"], *cells, f"{row['predict_ms']:.1f}")
    return grid


def _points(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.1f} %"


def _times(ratio: float | None) -> str:
    return "-" if ratio is None else f"x {ratio:.2f}"
