"""What a flight consists of: pictures, velocities, positions, attitudes and turn rates, each with its time.

Every `stamp_ns` is int nanoseconds since the first picture of the video.
"""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.flight.places import PlaceTrack
from flightdepth.flight.universal_time import UniversalTime
from flightdepth.motion import Stamps, Vector, unit_quaternion

VelocityFrame = Literal["world", "camera"]
NS_PER_S = 1_000_000_000
LATEST_NS = 1 << 62  # 146 years: beyond it, times less others leave 64 bits
# Between two samples farther apart nothing is interpolated. GPS-class logs come at 1 Hz with some jitter.
MAX_GAP_S = 1.5
# Past the last sample its value is held this long: two periods of a 4 Hz log. A drone that brakes with
# 2 m/s^2 meanwhile puts the position 0.25 m off.
HOLD_S = 0.5
FASTEST_M_S = 150.0  # no drone flies faster: a velocity beyond it is damage


def northwards(speed_m_s: float) -> Vector:
    """A velocity of which only the length is known: northwards, since some way it must be."""
    return np.array([speed_m_s, 0.0, 0.0])


def seconds(stamp_ns: int) -> str:
    """A time as people read it, to the millisecond: 1.234 s."""
    return f"{stamp_ns / NS_PER_S:.3f} s"


@dataclass(frozen=True, eq=False)
class Frame:
    """One picture: uint8 RGB [H, W, 3]. `index` counts the delivered pictures from 0.

    `after_damage`: pictures between this one and the one before were damaged, and perhaps the one before too.
    `camera` is this picture's own where the lens zooms or the crop changes; None means the flight's.
    `picture` is the name of its file, where it has one of its own.
    """

    index: int
    stamp_ns: int
    image: NDArray[np.uint8]
    after_damage: bool = False
    camera: Camera | None = None
    picture: str = ""

    def __post_init__(self) -> None:
        if self.image.dtype != np.uint8 or self.image.ndim != 3 or self.image.shape[2] != 3:
            got = f"{self.image.dtype} {list(self.image.shape)}"
            raise BadInput(f"frame {self.index}", expected="uint8 RGB [H, W, 3]", got=got)


@dataclass(frozen=True, eq=False)
class VelocitySample:
    """Velocity of the camera, m/s, shape (3,): north-east-down ("world") or right-down-forward ("camera").

    `sigma` is the standard deviation of each component, m/s, or None where nobody tells.
    """

    stamp_ns: int
    velocity: Vector
    frame: VelocityFrame = "world"
    sigma: float | None = None

    def __post_init__(self) -> None:
        velocity = np.asarray(self.velocity, dtype=np.float64)
        if velocity.shape != (3,) or not all(map(math.isfinite, velocity.tolist())):
            got = str(velocity.tolist())
            raise BadInput(f"velocity at {seconds(self.stamp_ns)}", expected="three finite m/s", got=got)
        if self.frame not in ("world", "camera"):
            raise BadInput("velocity frame", expected="world or camera", got=repr(self.frame))
        if self.sigma is not None and not (np.isfinite(self.sigma) and self.sigma >= 0):
            expected = "a finite number of m/s, 0 or more"
            raise BadInput(f"sigma at {seconds(self.stamp_ns)}", expected=expected, got=str(self.sigma))
        object.__setattr__(self, "velocity", velocity)


@dataclass(frozen=True, eq=False)
class PositionSample:
    """Position of the camera, metres north, east, down of any origin, shape (3,): good to centimetres.

    A log that has them tells velocities too, for who takes no positions.
    """

    stamp_ns: int
    position_ned: Vector

    def __post_init__(self) -> None:
        position = np.asarray(self.position_ned, dtype=np.float64)
        if position.shape != (3,) or not np.isfinite(position).all():
            got = str(position.tolist())
            raise BadInput(f"position at {seconds(self.stamp_ns)}", expected="three finite metres", got=got)
        object.__setattr__(self, "position_ned", position)


@dataclass(frozen=True, eq=False)
class AttitudeSample:
    """Attitude of the camera: unit quaternion (w, x, y, z), world (NED) from camera (x right, y down)."""

    stamp_ns: int
    world_from_camera: Vector

    def __post_init__(self) -> None:
        object.__setattr__(self, "world_from_camera", unit_quaternion(self.world_from_camera))


@dataclass(frozen=True, eq=False)
class BodyAttitudeSample:
    """Attitude of the drone: unit quaternion (w, x, y, z), world (NED) from body (x forward, y right)."""

    stamp_ns: int
    world_from_body: Vector

    def __post_init__(self) -> None:
        object.__setattr__(self, "world_from_body", unit_quaternion(self.world_from_body))


Sample = VelocitySample | PositionSample | AttitudeSample


def numbers_of(sample: Sample) -> Vector:
    """What a sample tells beside its time."""
    match sample:
        case VelocitySample():
            return sample.velocity
        case PositionSample():
            return sample.position_ned
        case AttitudeSample():
            return sample.world_from_camera


class MotionTaker(Protocol):
    """What samples are given to: the estimator, or a trajectory."""

    def add_velocity(
        self, stamp_ns: int, velocity: ArrayLike, *, frame: VelocityFrame, sigma: float | None
    ) -> None:
        """Velocity (3,) in `frame`, with its standard deviation per axis."""

    def add_position(self, stamp_ns: int, position: ArrayLike) -> None:
        """Position (3,), north, east, down."""

    def add_attitude(self, stamp_ns: int, world_from_camera: ArrayLike, /) -> None:
        """Quaternion (w, x, y, z)."""


def give(sample: Sample, taker: MotionTaker) -> None:
    """Give a sample to who takes its kind."""
    match sample:
        case VelocitySample():
            taker.add_velocity(sample.stamp_ns, sample.velocity, frame=sample.frame, sigma=sample.sigma)
        case PositionSample():
            taker.add_position(sample.stamp_ns, sample.position_ned)
        case AttitudeSample():
            taker.add_attitude(sample.stamp_ns, sample.world_from_camera)


def by_time(*kinds: Sequence[Sample]) -> tuple[Sample, ...]:
    """All samples in time order; of those at the same time the first kind comes first."""
    return tuple(sorted(chain(*kinds), key=lambda sample: sample.stamp_ns))


def none_of(counts: Counter[str]) -> str:
    """What a refusal got where all was left out: "none (3 rows without a time)"."""
    why = ", ".join(f"{count} {reason}" for reason, count in (+counts).items())
    return f"none ({why})" if why else "none"


def time_0_is(zero_ns: int) -> str:
    """What the name of a log ends with whose times count from where it begins."""
    return f"; its time 0 is {seconds(zero_ns)} of its clock"


@dataclass(frozen=True, eq=False)
class GyroscopeTrack:
    """Turn rates of the camera: stamps int64 [n], rising; rates rad/s [n, 3], axes in any fixed order."""

    stamps_ns: Stamps
    rates_rad_s: Vector

    def __post_init__(self) -> None:
        if self.rates_rad_s.shape != (len(self.stamps_ns), 3) or not np.isfinite(self.rates_rad_s).all():
            got = f"{len(self.stamps_ns)} stamps and rates {list(self.rates_rad_s.shape)}"
            raise BadInput("gyroscope", expected="a finite rate [3] for each stamp", got=got)

    def turn_rad(self, start_ns: int, end_ns: int) -> float | None:
        """Angle turned from `start_ns` to `end_ns` (small angles: the mean rate's length times the time)."""
        first, last = np.searchsorted(self.stamps_ns, [start_ns, end_ns])
        if first == last:
            return None
        mean_rate = self.rates_rad_s[first:last].mean(axis=0)
        return float(np.linalg.norm(mean_rate)) * (end_ns - start_ns) / NS_PER_S


@dataclass(frozen=True, eq=False)
class ViewTrack:
    """Horizontal field of view of the pictures: stamps int64 [n], rising; degrees [n].

    `nominal` where it is only the lens's 35 mm equivalent, so that a cropped video sees less.
    """

    stamps_ns: Stamps
    horizontal_deg: Vector
    nominal: bool = False

    def __post_init__(self) -> None:
        sound = self.horizontal_deg.shape == (len(self.stamps_ns),) and len(self.stamps_ns) > 0
        if not (sound and ((self.horizontal_deg > 0) & (self.horizontal_deg < 180)).all()):
            raise BadInput("fields of view", expected="0 to 180 degrees for each stamp", got="others")

    def between(self, start_ns: int, end_ns: int | None) -> Vector:
        """Degrees of the pictures from `start_ns` to `end_ns`, and of the one before."""
        first = max(0, int(np.searchsorted(self.stamps_ns, start_ns, "right")) - 1)
        last = len(self.stamps_ns) if end_ns is None else int(np.searchsorted(self.stamps_ns, end_ns))
        return self.horizontal_deg[first : max(last, first + 1)]

    def at(self, stamp_ns: int) -> float:
        """Degrees of the picture nearest to a time."""
        return float(self.horizontal_deg[int(np.abs(self.stamps_ns - stamp_ns).argmin())])


@dataclass(frozen=True)
class Recording:
    """When a video was recorded, on the log's clock; from its first row, or to its last, where an end is not told."""

    start_ns: int
    end_ns: int
    start_told: bool = True
    end_told: bool = True

    def later_by(self, offset_ns: int) -> Recording:
        """The same recording with `offset_ns` added to its times."""
        return replace(self, start_ns=self.start_ns + offset_ns, end_ns=self.end_ns + offset_ns)


@dataclass(frozen=True, eq=False)
class Telemetry:
    """All that one log says about a flight, in time order, on the video's clock.

    `name` is a line for people; `counts` says how much of the log was dropped, and why. `body_attitudes` are
    the drone's own, in time order; they say nothing of a camera until somebody knows how it is mounted.
    `view` is the field of view of each picture, where the log tells it. `recordings` are the videos that the log
    says were recorded, in time order: recordings.py finds the one at hand. `any_direction`: of the velocities only
    the lengths are told. `places` is where on Earth the drone was, where the log tells it; `true_north` is False where
    the velocities' north may be any direction, as in a map of odometry. `time_0_told` is False where time 0 is where
    the log begins, whenever the video did. `utc` is the universal time of time 0, where the log tells it; `since_1970`
    is that by the clock that stamped the log, where its times counted from 1970.
    """

    name: str
    samples: tuple[Sample, ...]
    counts: dict[str, int] = field(default_factory=dict)
    gyroscope: GyroscopeTrack | None = None
    body_attitudes: tuple[BodyAttitudeSample, ...] = ()
    view: ViewTrack | None = None
    recordings: tuple[Recording, ...] = ()
    any_direction: bool = False
    places: PlaceTrack | None = None
    true_north: bool = True
    time_0_told: bool = True
    utc: UniversalTime | None = None
    since_1970: UniversalTime | None = None

    def __post_init__(self) -> None:
        stamps = [sample.stamp_ns for sample in self.samples]
        if stamps != sorted(stamps):
            raise BadInput(
                f"telemetry {self.name}", expected="samples in time order", got="an earlier one after a later"
            )
        if not self.velocities:
            raise BadInput(f"telemetry {self.name}", expected="at least one velocity", got="none")

    @cached_property
    def velocities(self) -> list[VelocitySample]:
        """Of the samples those that tell a velocity."""
        return [sample for sample in self.samples if isinstance(sample, VelocitySample)]

    @cached_property
    def attitudes(self) -> list[AttitudeSample]:
        """Of the samples those that tell how the camera is turned."""
        return [sample for sample in self.samples if isinstance(sample, AttitudeSample)]

    @property
    def digest(self) -> str:
        """Tells this log from another one: the first digits of SHA-256 over all that results come from."""
        told = hashlib.sha256()
        for sample in self.samples:
            told.update(np.int64(sample.stamp_ns).tobytes() + numbers_of(sample).tobytes())
        told.update(np.array([each.sigma for each in self.velocities], np.float64).tobytes())  # NaN for None
        if self.places is not None:
            told.update(self.places.stamps_ns.tobytes() + self.places.places.tobytes())
        if self.view is not None:
            told.update(self.view.stamps_ns.tobytes() + self.view.horizontal_deg.tobytes())
        return told.hexdigest()[:16]

    def later_by(self, offset_ns: int) -> Telemetry:
        """The same telemetry with `offset_ns` added to all its times."""
        if offset_ns == 0:
            return self
        track = self.gyroscope
        return replace(
            self,
            samples=tuple(replace(sample, stamp_ns=sample.stamp_ns + offset_ns) for sample in self.samples),
            gyroscope=None if track is None else replace(track, stamps_ns=track.stamps_ns + offset_ns),
            body_attitudes=tuple(
                replace(body, stamp_ns=body.stamp_ns + offset_ns) for body in self.body_attitudes
            ),
            view=None if self.view is None else replace(self.view, stamps_ns=self.view.stamps_ns + offset_ns),
            recordings=tuple(recording.later_by(offset_ns) for recording in self.recordings),
            places=None if self.places is None else self.places.later_by(offset_ns),
            utc=None if self.utc is None else self.utc.later_by(offset_ns),
            since_1970=None if self.since_1970 is None else self.since_1970.later_by(offset_ns),
        )

    def counted_from(self, zero_ns: int, utc: UniversalTime | None) -> Telemetry:
        """The same with time 0 where the log begins, at `utc` by its own times; its name says so."""
        moved, name = self.later_by(-zero_ns), f"{self.name}{time_0_is(zero_ns)}"
        return replace(moved, name=name, time_0_told=False, utc=moved.utc or utc, since_1970=utc)

    @property
    def span_ns(self) -> tuple[int, int]:
        """Stamps of the first and the last velocity."""
        velocities = self.velocities
        return velocities[0].stamp_ns, velocities[-1].stamp_ns
