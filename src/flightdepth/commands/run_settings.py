"""The options of `flightdepth run` that hold for each of its flights."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

from flightdepth.commands.network_options import NetworkPrecision
from flightdepth.errors import BadInput


@dataclass(frozen=True)
class RunSettings:
    """As the options, in their units: `hfov` and `mount_pitch` in degrees, `speed` in m/s, `start` and `end` in s,
    `rate` in Hz.
    """

    telemetry: Path | None = None
    camera: Path | None = None
    hfov: float | None = None
    mask: Path | None = None
    network: str | None = None
    ranges: int = 2
    speed: float | None = None
    start: float | None = None
    end: float | None = None
    rate: float | None = None
    depth_format: Literal["png", "npz"] = "png"
    preview_ranges: bool = False
    fusion: Literal["saturation", "paper"] = "saturation"
    telemetry_offset: float | Literal["auto"] = 0.0
    mount_pitch: float | None = None
    derotate: bool = True
    align: bool = True
    fallback: str | None = None
    precision: NetworkPrecision = "auto"
    detail: float = 1.0

    def anywhere(self) -> RunSettings:
        """The same, with paths that hold from any folder."""
        found: dict[str, Any] = {
            key: value.absolute()
            for key, value in asdict(self).items()
            if isinstance(value, Path) and value.exists()
        }
        for name in ("network", "fallback"):
            given = getattr(self, name)
            # A folder may bear a network's name: that of `--out motion`.
            if given is not None and Path(given).is_file():
                found[name] = str(Path(given).absolute())
        return replace(self, **found)

    @property
    def for_record(self) -> dict[str, bool | int | float | str | None]:
        """As they stand in flight.json."""
        return {key: str(value) if isinstance(value, Path) else value for key, value in asdict(self).items()}


def offset_of(text: str) -> float | Literal["auto"]:
    """Seconds, or "auto", of --telemetry-offset."""
    if text == "auto":
        return "auto"
    try:
        return float(text)
    except ValueError:
        raise BadInput(
            "--telemetry-offset", expected="a number of seconds, or auto", got=repr(text)
        ) from None
