"""`--json`, of the commands that measure."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from flightdepth.commands.terminal import say
from flightdepth.files import check_parent, refuse_to_replace, write_json

JsonOption = Annotated[Path | None, typer.Option(metavar="FILE", help="Write every figure there.")]


def check_figures(path: Path | None) -> None:
    """Refuse, before the work, a file that cannot be written, or that stands and is no JSON."""
    check_parent("--json", path)
    if path is not None:
        refuse_to_replace("--json", path, is_own=lambda head: head.startswith(b"{"))


def write_figures(path: Path | None, figures: dict[str, Any]) -> None:
    """Write what was measured, if asked for, and say where it lies."""
    if path is not None:
        write_json(path, figures)
        say(f"figures: {path}")
