"""`--json`, of the commands that measure."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

import flightdepth
from flightdepth.commands.terminal import say
from flightdepth.files import check_parent, refuse_to_replace, write_json

JsonOption = Annotated[Path | None, typer.Option(metavar="FILE", help="Write every figure there.")]


def check_figures(path: Path | None) -> None:
    """Refuse, before the work, a file that cannot be written, or that stands and holds no figures."""
    check_parent("--json", path)
    if path is not None:
        refuse_to_replace("--json", path)


def write_figures(path: Path | None, figures: dict[str, Any]) -> None:
    """Write what was measured, if asked for, and say where it lies."""
    if path is not None:
        write_json(path, {"flightdepth": flightdepth.__version__} | figures)
        say(f"figures: {path}")
