"""The options of `flightdepth run` that hold for each of its flights."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

from flightdepth.commands.network_options import NetworkPrecision
from flightdepth.commands.recorded_options import Recorded, recorded, refuse_names


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

    def __post_init__(self) -> None:
        refuse_names(self.telemetry, self.camera)

    def anywhere(self) -> RunSettings:
        """The same, with paths that hold from any folder."""
        found: dict[str, Any] = {}
        for option in ("telemetry", "mask"):
            given = getattr(self, option)
            if given is not None and given.exists():
                found[option] = given.absolute()
        for option in ("camera", "network", "fallback"):
            given = getattr(self, option)
            # A folder may bear the name of a network or a lens: that of `--out motion`.
            if given is not None and Path(given).is_file():
                found[option] = type(given)(Path(given).absolute())
        return replace(self, **found)

    @property
    def for_record(self) -> Recorded:
        """As they stand in flight.json."""
        return recorded(asdict(self))
