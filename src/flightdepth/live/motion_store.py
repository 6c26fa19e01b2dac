"""What telemetry said lately, for two readers: the estimator takes what is new, results look up one time."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from flightdepth.flight.gimbal import screwed
from flightdepth.flight.records import (
    NS_PER_S,
    AttitudeSample,
    BodyAttitudeSample,
    PositionSample,
    Sample,
    VelocitySample,
)
from flightdepth.live.meters import Rate
from flightdepth.motion import (
    Vector,
    mixed_quaternions,
    rotation_angle_rad,
)
from flightdepth.ranges.attitude import neighbours, orientations
from flightdepth.ranges.timeline import Rows, Stamps, Timeline

KEPT_NS = 4 * NS_PER_S
HEIGHT_AGE_NS = NS_PER_S


@dataclass(frozen=True, eq=False)
class MotionAt:
    """The drone at one time; None where telemetry does not reach.

    world_from_camera      unit quaternion (w, x, y, z), NED from camera
    world_from_body        the drone's, NED from forward-right-down
    velocity_ned           [3] m/s
    height_above_ground_m  by a range finder or the autopilot's terrain estimate
    velocity_told_ns       stamp of the last velocity before, which `velocity_ned` rests on
    """

    world_from_camera: Vector | None
    world_from_body: Vector | None
    velocity_ned: Vector | None
    height_above_ground_m: float | None
    velocity_told_ns: int | None = None


class MotionStore:
    """Thread-safe; holds the last KEPT_NS. Stamps are on the live clock.

    With `body_from_camera` (rotation (3, 3)) the camera is screwed to the body, and the body's attitude tells
    the camera's; other reports of the camera's attitude then count only where there is none of the body.
    """

    def __init__(self, body_from_camera: Vector | None = None) -> None:
        self._lock = threading.Lock()
        self._body_from_camera = body_from_camera
        self._new: deque[Sample] = deque(maxlen=4096)
        self._velocities, self._cameras, self._bodies = Timeline(3), Timeline(4), Timeline(4)
        self._height: tuple[int, float] | None = None
        self._rate = Rate()
        self._received_ns: int | None = None

    def add(self, sample: Sample | BodyAttitudeSample, now_ns: int) -> None:
        """Take one sample, received at `now_ns`."""
        with self._lock:
            match sample:
                case VelocitySample():
                    if sample.frame == "world":
                        self._velocities.add(sample.stamp_ns, sample.velocity)
                    self._new.append(sample)
                    self._rate.add(now_ns)
                    self._received_ns = now_ns
                case PositionSample():
                    self._new.append(sample)
                case AttitudeSample():
                    if self._body_from_camera is None or not len(self._bodies):
                        self._add_camera(sample)
                case BodyAttitudeSample():
                    self._add_body(sample)
            for timeline in (self._velocities, self._cameras, self._bodies):
                timeline.forget(sample.stamp_ns - KEPT_NS)

    def add_height(self, stamp_ns: int, height_m: float) -> None:
        """Height above what lies below."""
        with self._lock:
            self._height = stamp_ns, height_m

    def take_new(self) -> list[Sample]:
        """The velocities, positions and camera attitudes since the last call, in the order of their coming."""
        with self._lock:
            taken = list(self._new)
            self._new.clear()
            return taken

    def cameras_after(self, stamp_ns: int) -> tuple[Stamps, Rows]:
        """Attitudes of the camera after a time, as far as they are held: stamps [n], quaternions [n, 4]."""
        with self._lock:
            stamps, rows = self._cameras.between(stamp_ns, self._cameras.newest_ns or stamp_ns)
            later = stamps > stamp_ns
            return stamps[later], rows[later]  # copies, by the mask

    def at(self, stamp_ns: int) -> MotionAt:
        """The drone at `stamp_ns`, between samples or just after the last."""
        with self._lock:
            told = _around(self._velocities, stamp_ns)
            return MotionAt(
                _quaternion_at(self._cameras, stamp_ns),
                _quaternion_at(self._bodies, stamp_ns),
                None if told is None else told.before + told.share * (told.after - told.before),
                self._height_at(stamp_ns),
                None if told is None else told.told_ns,
            )

    def turn_rad(self, stamp_ns: int, over_ns: int) -> float | None:
        """By how much the camera turned over the last `over_ns`, None where its attitude is unknown."""
        with self._lock:
            stamps, rows = self._cameras.between(stamp_ns - over_ns, stamp_ns)
            if not len(stamps):
                return None
            at_ns = np.array([stamp_ns - over_ns, stamp_ns])
            turns, known = orientations(stamps, rows, at_ns)
        if not known.all():
            return None
        return rotation_angle_rad(turns[0].T @ turns[1])

    def rate_hz(self, now_ns: int) -> float:
        """Velocities received a second."""
        with self._lock:
            return self._rate.hz(now_ns)

    def age_ms(self, now_ns: int) -> float | None:
        """Since the last velocity was received, None before the first."""
        with self._lock:
            return None if self._received_ns is None else (now_ns - self._received_ns) / 1e6

    def _add_camera(self, sample: AttitudeSample) -> None:
        self._cameras.add(sample.stamp_ns, sample.world_from_camera)
        self._new.append(sample)

    def _add_body(self, sample: BodyAttitudeSample) -> None:
        self._bodies.add(sample.stamp_ns, sample.world_from_body)
        if self._body_from_camera is not None:
            self._add_camera(screwed(sample, self._body_from_camera))

    def _height_at(self, stamp_ns: int) -> float | None:
        if self._height is None or abs(stamp_ns - self._height[0]) > HEIGHT_AGE_NS:
            return None
        return self._height[1]


class _Around(NamedTuple):
    """The rows before and after a time, how far it is from one to the other, 0..1, and the stamp of the first."""

    before: Vector
    after: Vector
    share: float
    told_ns: int


def _around(timeline: Timeline, stamp_ns: int) -> _Around | None:
    stamps, rows = timeline.between(stamp_ns, stamp_ns)
    if not len(stamps):
        return None
    before, _, share, known = neighbours(stamps, np.array([stamp_ns]))
    if not known[0]:
        return None
    first = int(before[0])
    return _Around(rows[first], rows[min(first + 1, len(rows) - 1)], float(share[0]), int(stamps[first]))


def _quaternion_at(timeline: Timeline, stamp_ns: int) -> Vector | None:
    around = _around(timeline, stamp_ns)
    return None if around is None else mixed_quaternions(around.before, around.after, around.share)
