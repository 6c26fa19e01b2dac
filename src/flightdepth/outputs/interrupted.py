"""What is left of a recording or a run that did not come to its end: it gets a name and stays."""

from __future__ import annotations

import re
import shutil
from contextlib import AbstractContextManager, suppress
from pathlib import Path

from flightdepth.errors import BadInput
from flightdepth.files import free_name, held

RECORDING = "recording"  # in the name of the folder while it is written


def interrupted_name(target: Path) -> Path:
    """NAME.interrupted-N beside `target`, with the first N that is free."""
    return free_name(target, "interrupted")


def keep_interrupted(target: Path) -> list[Path]:
    """Name what killed processes left that wrote into `target`, the oldest first; where each stands now.

    One that is still being written is left as it is, one without a frame is removed. Windows has no locks that tell
    which are, but moves no folder whose files are open.
    """
    target = target.resolve()
    kept = []
    for folder in sorted(_unfinished(target), key=lambda path: path.stat().st_mtime_ns):
        with suppress(BadInput, PermissionError), _held(folder):
            place = folder.rename(interrupted_name(target))
            if any(place.glob("depth/[0-9]*")):
                kept.append(place)
            else:
                shutil.rmtree(place)
    return kept


def check_alone(target: Path) -> None:
    """Refuse a `target` that another run or recording is writing at this time: whichever ends last would replace the
    other's result. Where the system has no locks nobody knows.
    """
    for folder in _unfinished(target.resolve()):
        try:
            with _held(folder):
                pass
        except BadInput as error:
            raise BadInput(
                f"output folder {target}",
                expected="no other run or recording that writes it",
                got="one that is running",
                mend="Wait for it, stop it, or give another --out.",
            ) from error


def _unfinished(target: Path) -> list[Path]:
    pattern = re.compile(rf"\.{re.escape(target.name)}\.{RECORDING}-[a-z0-9_]{{8}}")
    return [path for path in target.parent.glob(".*") if pattern.fullmatch(path.name)]


def _held(folder: Path) -> AbstractContextManager[None]:
    return held(folder, "recording", "work", "give another --out")
