"""Options as `flight.json` has them, which is UTF-8: on Linux a name may be any bytes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

from flightdepth.errors import BadInput

Recorded: TypeAlias = dict[str, bool | int | float | str | None]


def recorded(options: Mapping[str, Any]) -> Recorded:
    """Paths as text; bytes that are no UTF-8 come out as escapes."""
    return {key: _text(value) if isinstance(value, str | Path) else value for key, value in options.items()}


def _text(value: str | Path) -> str:
    return str(value).encode(errors="backslashreplace").decode()


def refuse_name(what: str, name: str) -> None:
    """Refuse a name that what is told of a flight, its log or its lens could not hold, before the flight is flown."""
    try:
        name.encode()
    except UnicodeEncodeError as error:
        raise BadInput(
            f"{what} {name!r}", expected="a name in UTF-8", got="another", mend="Rename it."
        ) from error


def refuse_names(telemetry: Path | None, camera: Path | None) -> None:
    """Those of --telemetry and --camera, which stand in what is told of the log and of the lens."""
    for option, path in (("--telemetry", telemetry), ("--camera", camera)):
        if path is not None:
            refuse_name(option, path.name)
