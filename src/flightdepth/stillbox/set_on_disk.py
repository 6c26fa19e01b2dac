"""A set on the disk: which settings it was begun with, and how it is taken up where it stands."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import Any

from flightdepth.errors import BadInput
from flightdepth.files import names_in, write_json
from flightdepth.stillbox.original_layout import OriginalLayout
from flightdepth.stillbox.shards import Shards, forget_short_shard

RECORD = "stillbox.json"


class Layout(StrEnum):
    """How a set lies on the disk."""

    FOLDER = "folder"
    SHARDS = "shards"


def open_set(
    folder: Path, layout: Layout, name: str, arguments: dict[str, Any], scenes: int
) -> OriginalLayout | Shards:
    """Begin a set of `scenes` scenes, or go on with one that was begun with the same settings, or with fewer scenes.

    Raises:
        BadInput: the folder holds something else, or a set with other settings.
    """
    wanted = {"set": name, "format": str(layout), "scenes": scenes, "args": arguments}
    refuse_other_things(folder)
    found = _record(folder)
    if found is None:
        folder.mkdir(parents=True, exist_ok=True)
    else:
        _refuse_other_settings(folder, found, wanted)
        if found["scenes"] < scenes:
            forget_short_shard(folder, name, found["scenes"])
    if wanted != found:
        write_json(folder / RECORD, wanted)
    if layout is Layout.SHARDS:
        return Shards(folder, name, arguments, scenes)
    return OriginalLayout(folder, arguments)


def _record(folder: Path) -> dict[str, Any] | None:
    path = folder / RECORD
    if not path.exists():
        return None
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        {**found["args"], "set": found["set"], "format": found["format"], "scenes": int(found["scenes"])}
    except (ValueError, KeyError, TypeError) as error:
        raise BadInput(
            f"record of a set {path}", expected="what render wrote there", got=str(error)
        ) from error
    return dict(found)


def refuse_other_things(folder: Path) -> None:
    """Refuse a folder that holds something, but no set."""
    for left in folder.glob(f".{RECORD}.*"):  # of a process that was killed
        left.unlink()
    if (folder / RECORD).exists():
        return
    if folder.exists() and (not folder.is_dir() or names_in(folder)):
        raise BadInput("--out", expected=f"a new or empty folder, or one with {RECORD}", got=str(folder))


def _refuse_other_settings(folder: Path, found: dict[str, Any], wanted: dict[str, Any]) -> None:
    before, now = ({"set": r["set"], "format": r["format"]} | r["args"] for r in (found, wanted))
    for key in before | now:
        if before.get(key) != now.get(key):
            raise BadInput(
                f"set {folder}, {key}",
                expected=f"{before.get(key)} as it was begun",
                got=str(now.get(key)),
                mend="Give the same settings, or another --out.",
            )
    if found["scenes"] > wanted["scenes"]:
        raise BadInput(
            f"set {folder}, scenes", expected=f"at least {found['scenes']}", got=str(wanted["scenes"])
        )
