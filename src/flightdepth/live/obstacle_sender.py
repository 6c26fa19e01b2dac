"""Sends the newest sectors to the autopilot at a steady rate, whatever the estimator and the link do."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import TracebackType

import numpy as np

from flightdepth.flight.records import NS_PER_S
from flightdepth.live.motion_store import MotionAt
from flightdepth.live.obstacle_memory import ObstacleMap
from flightdepth.live.obstacle_messages import ObstaclePacker
from flightdepth.live.obstacles import Sectors, heading_rad
from flightdepth.live.status import LiveResult
from flightdepth.motion import NED_FROM_CAMERA, rotation_from_quaternion

RATE_HZ = 15.0  # PX4 was tested with 10 Hz at 4 m/s; both autopilots give up after half a second
HEARTBEAT_NS, EVERY_NS = NS_PER_S, round(NS_PER_S / RATE_HZ)
AHEAD_S = 0.05  # a picture's time is right to less: one from farther ahead is not known to be new
BLIND = "obstacles are unknown"
FIXED_HEADING = " (a camera screwed to it: --mount fixed)"

Write = Callable[[bytes], object]


@dataclass(frozen=True, eq=False)
class SectorsAt:
    """The sectors to send, and when the newest picture that they rest on was taken (live clock, autopilot's clock)."""

    sectors: Sectors
    stamp_ns: int
    boot_ns: int | None


class ObstacleFeed:
    """Results in, the messages that are due out; the clock is the caller's, the live one or a recording's.

    `motion_at` tells the drone's motion at any time; without it its heading and velocity stay as the last result had
    them. `camera_ahead`: the camera is screwed to the drone and looks where its nose points, so that its own heading
    serves where nobody tells the drone's.

    settings  of the sectors and of the messages
    lacking   why all sectors of the last result are unknown, where that is not for want of depth
    """

    def __init__(
        self,
        obstacles: ObstacleMap,
        packer: ObstaclePacker,
        *,
        motion_at: Callable[[int], MotionAt] | None = None,
        camera_ahead: bool = False,
    ) -> None:
        self.settings = obstacles.settings
        self.lacking: str | None = None
        self._obstacles, self._packer = obstacles, packer
        self._motion_at, self._camera_ahead = motion_at, camera_ahead
        self._lock = threading.Lock()  # results come on one thread, and others ask
        self._newest: tuple[int, int | None] | None = (
            None  # when its picture was taken: live clock, autopilot's
        )
        self._distances_ns: int | None = None
        self._heartbeat_ns: int | None = None

    def take(self, result: LiveResult) -> None:
        """A sink: what a result says of the obstacles."""
        motion = result.motion
        heading = self._heading(motion)
        unknown = {"camera's attitude": motion.world_from_camera, "drone's heading": heading}
        wanting = " and the ".join(what for what, told in unknown.items() if told is None)
        mend = FIXED_HEADING if heading is None and motion.world_from_camera is not None else ""
        self.lacking = f"{BLIND}: nobody tells the {wanting}{mend}" if wanting else None
        with self._lock:
            self._obstacles.add(
                result.stamp_ns,
                result.depth,
                result.camera,
                world_from_camera=motion.world_from_camera,
                heading_rad=heading,
                velocity_ned=motion.velocity_ned,
                height_m=motion.height_above_ground_m,
            )
            self._newest = result.stamp_ns, result.boot_ns

    def fresh(self, now_ns: int) -> SectorsAt | None:
        """The sectors to the drone now, unless the newest picture is older than `stale_s`, or from the future."""
        motion = None if self._motion_at is None else self._motion_at(now_ns)
        heading, velocity = (None, None) if motion is None else (self._heading(motion), motion.velocity_ned)
        with self._lock:
            if self._newest is None or not self._is_fresh(now_ns):
                return None
            sectors = self._obstacles.at(now_ns, heading_rad=heading, velocity_ned=velocity)
            return SectorsAt(sectors, *self._newest)

    def due(self, now_ns: int) -> Iterator[bytes]:
        """The messages to send at `now_ns`: none twice within its interval, none about an old picture.

        One that cannot be made costs those after it, and none before.
        """
        usable = self._is_fresh(now_ns)
        if _elapsed(self._heartbeat_ns, now_ns, HEARTBEAT_NS):
            self._heartbeat_ns = now_ns
            yield self._packer.heartbeat(usable=usable)
        if not usable or not _elapsed(self._distances_ns, now_ns, EVERY_NS):
            return
        self._distances_ns = now_ns
        if (fresh := self.fresh(now_ns)) is not None:
            time_us = (fresh.stamp_ns if fresh.boot_ns is None else fresh.boot_ns) // 1000
            yield self._packer.distances(fresh.sectors, time_us)

    def _is_fresh(self, now_ns: int) -> bool:
        newest = self._newest
        return newest is not None and -AHEAD_S <= (now_ns - newest[0]) / NS_PER_S <= self.settings.stale_s

    def _heading(self, motion: MotionAt) -> float | None:
        if motion.world_from_body is not None:
            return heading_rad(motion.world_from_body)
        if self._camera_ahead and motion.world_from_camera is not None:
            axis = rotation_from_quaternion(motion.world_from_camera) @ NED_FROM_CAMERA.T @ (1.0, 0.0, 0.0)
            return float(np.arctan2(axis[1], axis[0]))
        return None


class ObstacleSender:
    """A thread that gives what is due to `write`, which may block or fail: neither spreads.

    Nothing is due before `heard` says that somebody is there to send to. `sent` and `failed` count messages; a failure
    to make those that are due counts as one.
    """

    def __init__(self, feed: ObstacleFeed, write: Write, *, heard: Callable[[], bool] = lambda: True) -> None:
        self.sent, self.failed = 0, 0
        self._feed, self._write, self._heard = feed, write, heard
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="obstacles", daemon=True)

    def __enter__(self) -> ObstacleSender:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join(timeout=2.0)

    def _run(self) -> None:
        while not self._stop.wait(0.01):
            if not self._heard():
                continue
            try:
                for message in self._feed.due(time.monotonic_ns()):
                    self._send(message)
            except Exception:  # a number that no message can hold: the next result's may be sound
                self.failed += 1

    def _send(self, message: bytes) -> None:
        try:
            self._write(message)
            self.sent += 1
        except Exception:  # a link of any kind: the next message is tried all the same
            self.failed += 1


def _elapsed(last_ns: int | None, now_ns: int, every_ns: int) -> bool:
    """Whether it is time again; a millisecond early is in time, or a rate that fits the frames' would halve."""
    return last_ns is None or not 0 <= now_ns - last_ns < every_ns - 1_000_000
