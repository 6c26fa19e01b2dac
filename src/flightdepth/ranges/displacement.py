"""Where the camera was: positions from integrated velocities, or from poses that replace them."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flightdepth.errors import BadInput
from flightdepth.flight.records import FASTEST_M_S, MAX_GAP_S, VelocityFrame
from flightdepth.motion import Vector, quaternion_from_rotation, unit_quaternion
from flightdepth.ranges.attitude import TURNED_OVER_NS, neighbours, orientations
from flightdepth.ranges.pose_jumps import MAX_ACCELERATION_M_S2, PoseJumps
from flightdepth.ranges.timeline import Rows, Stamps, Timeline, checked_stamp
from flightdepth.runtimes.arrays import Flags

SPEED_NOISE_M_S = 1.0
# Between velocities as far apart as SELDOM_S nobody knows when they changed: of the change so much is left open
# half-way, along each axis. Six logs thinned out to one a second and two: .05 to .18 (root mean square, docs/log.md).
SELDOM_S, LEFT_OPEN = 0.3, 0.1


@dataclass(frozen=True)
class States:
    """The camera at k times.

    position_m         [k, 3]     world frame, comparable only within one segment
    sigma_m            [k]        standard deviation that velocities added up to; 0 for measured positions
    segment            [k]        int; -1 where the position is unknown
    world_from_camera  [k, 3, 3]  the identity where the attitude is unknown
    oriented           [k]        whether the attitude is known
    """

    position_m: Vector
    sigma_m: Vector
    segment: NDArray[np.int64]
    world_from_camera: Vector
    oriented: Flags


def integrate(stamps_ns: Stamps, velocity: Rows, at_ns: Stamps) -> tuple[Vector, NDArray[np.int64]]:
    """Positions [k, c] (m) and segments [k] at `at_ns`, from velocities [m, c] (m/s).

    Velocity runs straight from sample to sample, so the trapezoid rule is exact between samples as well.
    A gap longer than MAX_GAP_S starts a new segment; past a segment's end its last velocity holds for HOLD_S.
    """
    step_s = np.diff(stamps_ns) * 1e-9
    gap = step_s > MAX_GAP_S
    steps = np.where(gap, 0.0, step_s)[:, None] * (velocity[1:] + velocity[:-1]) / 2
    position = np.concatenate([np.zeros((1, velocity.shape[1])), np.cumsum(steps, axis=0)])
    segment = np.concatenate([[0], np.cumsum(gap)])
    before, elapsed_s, share, known = neighbours(stamps_ns, at_ns)
    after = np.minimum(before + 1, len(velocity) - 1)
    reached = velocity[before] + share[:, None] * (velocity[after] - velocity[before])
    at = position[before] + elapsed_s[:, None] * (velocity[before] + reached) / 2
    return at, np.where(known, segment[before], -1)


def left_open(stamps_ns: Stamps, velocity: Rows) -> Vector:
    """Standard deviation, m/s, that velocities [m, 3] which come seldom leave open around each, [m]."""
    step_s, change = np.diff(stamps_ns) * 1e-9, np.linalg.norm(np.diff(velocity, axis=0), axis=1)
    beside = np.concatenate([[0.0], np.where(step_s >= SELDOM_S, LEFT_OPEN * change, 0.0), [0.0]])
    return np.asarray(np.maximum(beside[:-1], beside[1:]))


def interpolate(
    stamps_ns: Stamps, position: Rows, segment: NDArray[np.int64], at_ns: Stamps
) -> tuple[Vector, NDArray[np.int64]]:
    """Positions [k, 3] and segments [k] at `at_ns`, straight between measured positions [m, 3] (m) of segments [m].

    Poses share one world until they jump: between two segments nothing is known. Past the last, and past one that a
    gap follows, the last speed holds for HOLD_S; the mean speed over the gap where no other is known.
    """
    before, elapsed_s, _, known = neighbours(stamps_ns, at_ns)
    step_s = np.diff(stamps_ns)[:, None] * 1e-9
    speeds = np.diff(position, axis=0) / step_s
    for gap in np.flatnonzero(step_s[1:, 0] > MAX_GAP_S) + 1:
        speeds[gap] = speeds[gap - 1]
    speeds = np.concatenate([speeds, speeds[-1:] if len(speeds) else np.zeros((1, 3))])
    jumps = np.append(np.diff(segment) != 0, [False])[before] & (elapsed_s > 0)
    at = position[before] + elapsed_s[:, None] * speeds[before]
    return at, np.where(known & ~jumps, segment[before], -1)


class Trajectory:
    """Collects velocities, attitudes and poses; answers where the camera was at given times.

    Samples may come ahead of the frames; each must come after the one before of its kind, or it is dropped
    and counted in `dropped`, as are the oldest where more are given than a `Timeline` keeps. A velocity that
    jumps away by more than MAX_ACCELERATION_M_S2 waits for the next one: agreed with, both count; alone, it
    is dropped (the first of all is not asked). So does a pose that jumps (see `PoseJumps`); agreed with, it begins a
    new segment.
    """

    def __init__(self) -> None:
        self.dropped: Counter[str] = Counter()
        self.frame: VelocityFrame | None = None
        self._velocities = Timeline(4)  # and standard deviation
        self._attitudes = Timeline(4)
        self._poses = Timeline(8)  # position, quaternion, segment
        self._poses_turn = False  # whether their quaternions are told
        self._jumps = PoseJumps(self.dropped)
        self._suspect: tuple[int, Rows] | None = None

    @property
    def from_poses(self) -> bool:
        """Whether positions are measured, not integrated."""
        return len(self._poses) > 0

    @property
    def non_rotating(self) -> bool:
        """Whether camera-frame velocities are summed as if the camera never turned, for want of attitudes."""
        return self.frame == "camera" and not self.knows_attitude

    @property
    def knows_attitude(self) -> bool:
        """Whether any attitude or pose was given."""
        return len(self._attitudes) > 0 or self._poses_turn

    def knows_attitude_at(self, stamp_ns: int) -> bool:
        """Whether attitudes or poses tell that of this time."""
        return bool(self._orientations(stamp_ns, stamp_ns, np.array([stamp_ns]))[1][0])

    def add_velocity(
        self, stamp_ns: int, velocity: ArrayLike, *, frame: VelocityFrame, sigma: float | None
    ) -> None:
        """Velocity (m/s, shape (3,)) in `frame`, with its standard deviation per axis (m/s)."""
        stamp_ns, v = checked_stamp(stamp_ns), np.asarray(velocity, dtype=np.float64)
        if v.shape != (3,) or not np.isfinite(v).all():
            raise BadInput("velocity", expected="three finite numbers in m/s", got=str(v.tolist()))
        if frame not in ("world", "camera"):
            raise BadInput("velocity frame", expected="world or camera", got=repr(frame))
        if self.frame not in (None, frame):
            raise BadInput("velocity frame", expected=f"{self.frame}, as before", got=frame)
        if sigma is not None and not (np.isfinite(sigma) and sigma >= 0):
            raise BadInput("velocity sigma", expected="0 or more m/s", got=str(sigma))
        if np.linalg.norm(v) > FASTEST_M_S:
            self.dropped["velocity faster than any drone"] += 1
            return
        self.frame = frame
        if not self.from_poses:  # which replace velocities
            self._take_velocity(stamp_ns, np.append(v, sigma or 0.0))

    def add_attitude(self, stamp_ns: int, quaternion: ArrayLike) -> None:
        """`world_from_camera` as a quaternion (w, x, y, z)."""
        self._add(self._attitudes, "attitude", stamp_ns, unit_quaternion(quaternion))

    def add_pose(self, stamp_ns: int, world_from_camera: ArrayLike) -> None:
        """`world_from_camera` as a 4x4 matrix: position and attitude, in place of integration."""
        pose = np.asarray(world_from_camera, dtype=np.float64)
        rigid = pose.shape == (4, 4) and bool(np.isfinite(pose).all())
        if rigid:
            turn = pose[:3, :3]
            rigid = bool(np.allclose(turn @ turn.T, np.eye(3), atol=1e-3) and np.linalg.det(turn) > 0)
        if not rigid or not np.allclose(pose[3], [0, 0, 0, 1]):
            raise BadInput("pose", expected="a rigid 4x4 matrix world_from_camera", got=str(pose.tolist()))
        self._take_pose(stamp_ns, np.concatenate([pose[:3, 3], quaternion_from_rotation(pose[:3, :3])]))

    def add_position(self, stamp_ns: int, position: ArrayLike) -> None:
        """Position (m, shape (3,)) in the world frame, in place of integration; attitudes come by `add_attitude`."""
        told = np.asarray(position, dtype=np.float64)
        if told.shape != (3,) or not np.isfinite(told).all():
            raise BadInput("position", expected="three finite numbers in metres", got=str(told.tolist()))
        self._take_pose(stamp_ns, np.concatenate([told, np.full(4, np.nan)]))

    def _take_pose(self, stamp_ns: int, row: Rows) -> None:
        stamp_ns, turns = checked_stamp(stamp_ns), bool(np.isfinite(row[3]))
        if turns != self._poses_turn and self.from_poses:
            expected = "poses throughout, or positions throughout"
            raise BadInput("pose" if turns else "position", expected=expected, got="one after the other")
        self._poses_turn = turns
        newest_ns = self._jumps.newest_ns
        if newest_ns is not None and stamp_ns <= newest_ns:
            self._too_late("pose")
            return
        for kept_ns, kept in self._jumps.take(stamp_ns, row):
            self._add(self._poses, "pose", kept_ns, kept)

    def at(self, at_ns: Stamps) -> States:
        """The camera at the rising times `at_ns`, shape (k,), k >= 1."""
        first, last = int(at_ns[0]), int(at_ns[-1])
        position, sigma, segment = self._positions(first, last, at_ns)
        return States(position, sigma, segment, *self._orientations(first, last, at_ns))

    def forget(self, before_ns: int) -> None:
        """Drop what times from `before_ns` on do not need."""
        self._velocities.forget(before_ns)
        self._poses.forget(before_ns, spare=1)
        # A velocity of the camera's frame is turned by the attitude of its own time.
        oldest, _ = self._velocities.between(before_ns, before_ns)
        self._attitudes.forget(min([before_ns, *oldest[:1].tolist()]))

    def _positions(self, first: int, last: int, at_ns: Stamps) -> tuple[Vector, Vector, NDArray[np.int64]]:
        if self.from_poses:
            stamps, rows = self._poses.between(first, last, spare=1)  # tells the speed past the last
            position, segment = interpolate(stamps, rows[:, :3], rows[:, 7].astype(np.int64), at_ns)
            return position, np.zeros(len(at_ns)), segment
        stamps, rows = self._velocities.between(first, last)
        if self.frame == "camera" and not self.non_rotating:
            turns, known = self._orientations(int(stamps[0]), int(stamps[-1]), stamps)
            stamps, rows = stamps[known], rows[known]
            rows[:, :3] = np.einsum("kij,kj->ki", turns[known], rows[:, :3])
        if not len(stamps):
            return np.zeros((len(at_ns), 3)), np.zeros(len(at_ns)), np.full(len(at_ns), -1)
        sigma = np.hypot(rows[:, 3], left_open(stamps, rows[:, :3]))
        flown, segment = integrate(stamps, np.c_[rows[:, :3], sigma], at_ns)
        return flown[:, :3], flown[:, 3], segment

    def _orientations(self, first: int, last: int, at_ns: Stamps) -> tuple[Vector, Flags]:
        first = min(first, last - TURNED_OVER_NS)  # tells how it turns on past the last sample
        if self._poses_turn:
            stamps, rows = self._poses.between(first, last)
            return orientations(stamps, rows[:, 3:7], at_ns)
        return orientations(*self._attitudes.between(first, last), at_ns)

    def _take_velocity(self, stamp_ns: int, velocity: Rows) -> None:
        newest = self._suspect[0] if self._suspect else self._velocities.newest_ns
        if newest is None or stamp_ns <= newest:
            if newest is None:
                self._add(self._velocities, "velocity", stamp_ns, velocity)
            else:
                self._too_late("velocity")
            return
        if self._suspect and _plausible(*self._suspect, stamp_ns, velocity):
            self._add(self._velocities, "velocity", *self._suspect)
        elif self._suspect:
            self.dropped["velocity glitch"] += 1
        self._suspect = None
        if _plausible(*self._velocities.newest, stamp_ns, velocity):
            self._add(self._velocities, "velocity", stamp_ns, velocity)
        else:
            self._suspect = stamp_ns, velocity

    def _add(self, timeline: Timeline, kind: str, stamp_ns: int, row: ArrayLike) -> None:
        full = timeline.is_full
        if not timeline.add(stamp_ns, row):
            self._too_late(kind)
        elif full:
            self.dropped[f"{kind} followed by more than are kept"] += 1

    def _too_late(self, kind: str) -> None:
        self.dropped[f"{kind} not after the one before"] += 1


def _plausible(from_ns: int, start: Rows, to_ns: int, end: Rows) -> bool:
    """Whether a drone can change its velocity, the first three of a row, from `start` to `end` in that time."""
    allowed = SPEED_NOISE_M_S + MAX_ACCELERATION_M_S2 * (to_ns - from_ns) * 1e-9
    return float(np.linalg.norm((end - start)[:3])) <= allowed
