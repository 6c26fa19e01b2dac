"""What the live engine tells: one result a frame for the sinks, and its own state at any time.

Every `stamp_ns` is on the live clock: `time.monotonic_ns()` of this process. A sink is a plain callable
`sink(result)`. Each has a thread and a slot of its own that holds only the newest result, so a sink that is
slow or fails never stops the estimator: what it missed and how often it failed is counted.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.flight.turn_verdict import TurnVerdict
from flightdepth.live.motion_store import MotionAt
from flightdepth.ranges.result import RangedDepth

# Whose clock an age counts from: the sender's at capture, or ours when the first bytes of it were received.
AgeFrom = Literal["sender", "reception"]


class State(StrEnum):
    """How far the results can be used."""

    OK = "ok"
    DEGRADED = "degraded"  # results come, with less or no depth in them: the reason says why
    LOST = "lost"  # no results: nothing after the last one is known


@dataclass(frozen=True)
class Health:
    """A state and, unless it is OK, the reason in words; `since_ns`: when this state and reason began."""

    state: State
    reason: str | None
    since_ns: int

    def __post_init__(self) -> None:
        if (self.state is State.OK) != (self.reason is None):
            raise ValueError(f"expected a reason unless all is well, got {self.state}: {self.reason}")

    @property
    def kind(self) -> tuple[State, str]:
        """The state and what its reason is about, without the figures behind its colon."""
        return self.state, (self.reason or "").split(":", maxsplit=1)[0]


@dataclass(frozen=True)
class FrameCounts:
    """Pictures since the start: received from the stream, used by the estimator, dropped by reason."""

    received: int = 0
    used: int = 0
    dropped: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class SinkCounts:
    """Results that one sink took, missed because it was busy, and failed on: each is one of these."""

    taken: int = 0
    missed: int = 0
    failed: int = 0


@dataclass(frozen=True)
class LiveStatus:
    """The engine at one time.

    stamp_ns          when this was written, live clock
    health            OK, DEGRADED or LOST, with the reason
    age_ms            capture of the last result's picture to its result; None where the last minute had none
    age_from          whose clock `age_ms` counts from
    distrusted        why it is not the sender's wall clock, though that was asked for
    age_p95_ms        95 % of the last minute's results were younger; None where there were none
    frames            received, used, dropped by reason
    ranges            n in use now, 1..4: fewer when the machine cannot keep up
    shifts            [n] frames between current and previous, of the last result
    displacements_m   [n] lengths flown between them
    fps_in            pictures received a second, over the last seconds
    fps               results a second, over the last seconds
    telemetry_hz      velocities a second, over the last seconds
    telemetry_age_ms  since the newest velocity was received; None before the first
    uptime_s          since the engine began
    reconnects        times that the video stream was opened again
    sinks             by name: results taken, missed, failed on
    telemetry_dropped samples and MAVLink messages left out or not sent, and jumps of the autopilot's clock, by reason
    lens              what the camera's turns say of its focal length; None before they were judged
    """

    stamp_ns: int
    health: Health
    age_ms: float | None = None
    age_from: AgeFrom = "reception"
    distrusted: str | None = None
    age_p95_ms: float | None = None
    frames: FrameCounts = field(default_factory=FrameCounts)
    ranges: int = 1
    shifts: tuple[int, ...] = ()
    displacements_m: tuple[float, ...] = ()
    fps_in: float = 0.0
    fps: float = 0.0
    telemetry_hz: float = 0.0
    telemetry_age_ms: float | None = None
    uptime_s: float = 0.0
    reconnects: int = 0
    sinks: Mapping[str, SinkCounts] = field(default_factory=dict)
    telemetry_dropped: Mapping[str, int] = field(default_factory=dict)
    lens: TurnVerdict | None = None


@dataclass(frozen=True, eq=False)
class LiveResult:
    """Depth of one picture, with all that a sink needs to use it.

    depth                     depth maps at the picture's size, or the reason why there is none
    image                     [H, W, 3] uint8 RGB; read only
    camera                    of the picture
    stamp_ns                  when the picture was taken, live clock; now - stamp_ns is its age
    ready_ns                  when the result was ready, live clock
    boot_ns                   `stamp_ns` on the autopilot's clock (since its power-up), None where unknown
    motion                    the drone's and the camera's at `stamp_ns`
    status                    the engine just after this result
    """

    depth: RangedDepth
    image: NDArray[np.uint8]
    camera: Camera
    stamp_ns: int
    ready_ns: int
    boot_ns: int | None
    motion: MotionAt
    status: LiveStatus

    def __post_init__(self) -> None:
        size = (self.camera.height, self.camera.width)
        if self.image.shape != (*size, 3) or self.depth.depth_m.shape != size:
            raise ValueError(f"expected a picture and depth of {size}, got {self.image.shape}")

    @property
    def age_ms(self) -> float:
        """Age of the picture when its result was ready."""
        return (self.ready_ns - self.stamp_ns) / 1e6


Sink = Callable[[LiveResult], None]
# Sinks hear nothing while nothing is received; who shows or sends the state of the engine asks for it.
StatusSource = Callable[[], LiveStatus]
