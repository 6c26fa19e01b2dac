"""The options of `flightdepth live`, checked before anything is opened."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal, TypeAlias

from flightdepth.commands.network_options import NetworkPrecision
from flightdepth.commands.recorded_options import Recorded, recorded, refuse_name, refuse_names
from flightdepth.errors import BadInput
from flightdepth.files import check_parent, refuse_to_replace

Mount: TypeAlias = Literal["gimbal", "fixed"]  # what holds the camera


@dataclass(frozen=True)
class LiveSettings:
    """The options of `flightdepth live`."""

    video: str
    mavlink: str | None
    vehicle: int | None
    telemetry: Path | None
    telemetry_offset: float
    camera: Path | None
    hfov: float | None
    mask: Path | None
    mount: Mount
    mount_pitch: float | None
    camera_delay_ms: float
    sender_clock: bool
    network: str | None
    precision: NetworkPrecision
    align: bool
    ranges: int
    out: Path | None
    serve: str | None
    obstacles: bool
    dry_run: Path | None
    duration: float | None

    def __post_init__(self) -> None:
        self._check_addresses()
        if self.hfov is not None:
            from flightdepth.flight.camera_evidence import check_hfov

            check_hfov(self.hfov)
        if self.out is not None:
            from flightdepth.live.video_address import without_secrets

            refuse_name("--video", without_secrets(self.video))
            refuse_names(self.telemetry, self.camera)
        if self.mavlink is not None and self.telemetry is not None:
            raise BadInput(
                "--mavlink and --telemetry", expected="one of them, for the drone's velocity", got="both"
            )
        if self.vehicle is not None and self.mavlink is None:
            raise BadInput("--vehicle", expected="--mavlink, on which it is", got="none")
        if not (math.isfinite(self.camera_delay_ms) and 0 <= self.camera_delay_ms < 10_000):
            raise BadInput(
                "--camera-delay-ms", expected="0 to less than 10000", got=str(self.camera_delay_ms)
            )
        if self.telemetry_offset and self.mavlink is not None:
            mend = "MAVLink has a clock of its own."
            raise BadInput("--telemetry-offset", expected="a log to move", got="--mavlink", mend=mend)
        if self.mount_pitch is not None:
            if not -90 <= self.mount_pitch <= 90:
                raise BadInput("--mount-pitch", expected="-90 to 90 degrees", got=str(self.mount_pitch))
            if self.mount != "fixed":
                raise BadInput(
                    "--mount-pitch", expected="--mount fixed beside it", got=f"--mount {self.mount}"
                )
        if self.duration is not None and not (math.isfinite(self.duration) and self.duration > 0):
            raise BadInput("--duration", expected="more than 0 seconds", got=str(self.duration))
        if self.obstacles and (self.mavlink, self.dry_run, self.serve) == (None, None, None):
            expected = "--mavlink to send over, --dry-run TLOG, or --serve to look at them"
            raise BadInput("--obstacles", expected=expected, got="none of them")
        if self.dry_run is not None:
            from flightdepth.live.obstacle_messages import is_own_log

            check_parent("--dry-run", self.dry_run)
            refuse_to_replace("--dry-run", self.dry_run, is_own_log)

    def _check_addresses(self) -> None:
        """Refuse those that nobody can open, before a network is loaded, which takes seconds on a small computer."""
        if self.mavlink is not None:
            from flightdepth.live.mavlink_link import check_address

            check_address(self.mavlink)
        if self.serve is not None:
            from flightdepth.live.page.server import parsed

            parsed(self.serve)

    @property
    def seeks_obstacles(self) -> bool:
        """For the autopilot, a log, or the page alone."""
        return self.obstacles or self.dry_run is not None

    @property
    def for_record(self) -> Recorded:
        """As they stand in flight.json."""
        return recorded(asdict(self))
