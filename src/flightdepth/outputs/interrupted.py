"""What is left of a recording or a run that did not come to its end: it gets a name and stays."""

from __future__ import annotations

import re
import shutil
from contextlib import suppress
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
    pattern = re.compile(rf"\.{re.escape(target.name)}\.{RECORDING}-[a-z0-9_]{{8}}")
    left = [path for path in target.parent.glob(".*") if pattern.fullmatch(path.name)]
    kept = []
    for folder in sorted(left, key=lambda path: path.stat().st_mtime_ns):
        with suppress(BadInput, PermissionError), held(folder, "recording", "work", "give another --out"):
            place = folder.rename(interrupted_name(target))
            if any(place.glob("depth/[0-9]*")):
                kept.append(place)
            else:
                shutil.rmtree(place)
    return kept
