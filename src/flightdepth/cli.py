"""The command line: its commands, and how an error ends it.

Exit codes: 0 done, 2 bad input, 3 could not run, 130 stopped by Ctrl-C.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import typer

from flightdepth import __version__
from flightdepth.commands.cameras import cameras
from flightdepth.commands.convert import convert
from flightdepth.commands.demo import demo
from flightdepth.commands.evaluate import evaluate
from flightdepth.commands.export import export
from flightdepth.commands.live import live
from flightdepth.commands.networks import networks
from flightdepth.commands.render import render
from flightdepth.commands.run import run
from flightdepth.commands.terminal import print_any_name, report, say
from flightdepth.commands.train import train
from flightdepth.commands.view import view
from flightdepth.errors import FlightDepthError

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)


def show_version(wanted: bool) -> None:
    """Print the version and stop."""
    if wanted:
        say(f"flightdepth {__version__}")
        raise typer.Exit


@app.callback()
def flightdepth(
    version: Annotated[
        bool, typer.Option("--version", callback=show_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Metric depth from a drone's stabilised video and its velocity.

    Start with the sample flight, then with one of yours:

      flightdepth demo

      flightdepth run VIDEO

    The velocity comes from the video itself (GoPro), from --telemetry LOG or
    a log of the video's name beside it, or from --speed M_S; the lens from the
    video where it tells, else from --camera or --hfov.
    `flightdepth COMMAND --help` shows examples.
    """


app.command()(demo)
app.command()(run)
app.command()(live)
app.command()(view)
app.command()(convert)
app.command()(networks)
app.command()(cameras)
app.command()(train)
app.command()(export)
app.add_typer(evaluate, name="evaluate")
app.command()(render)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; the exit code. Errors that a user can meet are one line on stderr."""
    print_any_name()
    try:
        app(None if arguments is None else list(arguments), prog_name="flightdepth")
    except SystemExit as end:  # typer ends each command so
        return end.code if isinstance(end.code, int) else 0
    except FlightDepthError as error:
        report(error)
        return error.exit_code
    except OSError as error:  # a full disk, a folder without permission
        report(error)
        return FlightDepthError.exit_code
    return 0
