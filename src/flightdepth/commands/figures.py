"""`--json`, of the commands that measure."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from flightdepth.commands.terminal import say
from flightdepth.files import write_json

JsonOption = Annotated[Path | None, typer.Option(metavar="FILE", help="Write every figure there.")]


def write_figures(path: Path | None, figures: dict[str, Any]) -> None:
    """Write what was measured, if asked for, and say where it lies."""
    if path is not None:
        write_json(path, figures)
        say(f"figures: {path}")
