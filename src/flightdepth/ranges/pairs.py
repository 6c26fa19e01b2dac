"""The frame buffer, how far the camera flew since each buffered frame, and which frames to pair."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from flightdepth.levels import AnyImage, packed, unpacked
from flightdepth.motion import Vector
from flightdepth.ranges.attitude import turn_angles_rad, turns_until_last
from flightdepth.ranges.displacement import Trajectory
from flightdepth.ranges.remainder import LOG_SIGMA_RAD, SEEN_SIGMA_RAD
from flightdepth.runtimes.arrays import Flags

MAX_FRAMES = 128
# Less than this is no baseline: a stabiliser leaves a good part of it, and a flight controller drifts by it.
MIN_BASELINE_M = 0.05
# An integrated displacement must stand out from the velocity's own noise: 0.1 m/s where no sigma is given.
MIN_SPEED_M_S = 0.1
SPEED_OVER_SIGMA = 3.0
SOON_S = 0.2  # a drone that flies is off its first frame by then
LOOK_BACK = 3.0
SAME_WAY_RAD = np.radians(3)
TURNED_AWAY = "the camera turned away from all that earlier frames saw"


@dataclass(frozen=True)
class Frame:
    """A prepared image [h64, w64, 3] with its place in the sequence of frames given and its time."""

    index: int
    stamp_ns: int
    image: AnyImage


@dataclass(frozen=True)
class PackedFrame:
    """What is kept of a Frame: its image takes half the memory, and is unpacked each time that it is asked for."""

    index: int
    stamp_ns: int
    packed: AnyImage

    @property
    def image(self) -> AnyImage:
        """[h64, w64, 3], to within 1/512 of a level."""
        return unpacked(self.packed)


AnyFrame = Frame | PackedFrame


class Frames(Protocol):
    """Frames by their place."""

    def __getitem__(self, k: int, /) -> AnyFrame:
        """The one at place `k`."""


class FrameBuffer:
    """At most MAX_FRAMES frames of the last `span_s` seconds.

    One MAX_FRAMES-th of the span must lie between two kept frames (of faster video only every second, third,
    ... is kept), so long displacements stay within reach however fast the camera is.
    """

    def __init__(self, span_s: float) -> None:
        self._least_step_ns = span_s * 1e9 / MAX_FRAMES
        self._frames: deque[PackedFrame] = deque(maxlen=MAX_FRAMES)

    @property
    def frames(self) -> tuple[PackedFrame, ...]:
        """Oldest first."""
        return tuple(self._frames)

    def expire(self, before_ns: int) -> None:
        """Drop what is older than `before_ns`."""
        while self._frames and self._frames[0].stamp_ns < before_ns:
            self._frames.popleft()

    def add(self, frame: Frame) -> None:
        """Keep `frame` for later, unless it follows the last one too closely."""
        if not self._frames or frame.stamp_ns - self._frames[-1].stamp_ns >= self._least_step_ns:
            self._frames.append(PackedFrame(frame.index, frame.stamp_ns, packed(frame.image)))

    def clear(self) -> None:
        """Drop every frame: nothing before now can be paired with what comes."""
        self._frames.clear()


@dataclass(frozen=True)
class Baselines:
    """From each of k buffered frames to the current one.

    frames                 [k]        oldest first
    displacement_m         [k, 3]     current camera's orientation where `directed`, else world
    length_m               [k]
    length_sigma_m         [k]        its standard deviation, as the log tells it; 0 where it does not
    current_from_previous  [k, 3, 3]  the identity where an attitude is unknown
    turn_rad               [k]
    directed               [k]        whether the displacement's direction is known to the camera
    usable                 [k]        whether a depth can come from this pair
    reason                            why none is usable, None when one is
    """

    frames: Frames
    displacement_m: Vector
    length_m: Vector
    length_sigma_m: Vector
    current_from_previous: Vector
    turn_rad: Vector
    directed: Flags
    usable: Flags
    reason: str | None


def baselines(
    trajectory: Trajectory, frames: Sequence[AnyFrame], stamp_ns: int, max_turn_rad: float
) -> Baselines:
    """How far the camera flew and turned from each of `frames` (oldest first) until `stamp_ns`."""
    stamps = np.array([frame.stamp_ns for frame in frames] + [stamp_ns], dtype=np.int64)
    states = trajectory.at(stamps)
    world = states.position_m[-1] - states.position_m[:-1]
    turn, oriented = turns_until_last(states.world_from_camera, states.oriented)
    in_camera = world @ states.world_from_camera[-1]
    length: Vector = np.linalg.norm(world, axis=1)
    turn_rad = turn_angles_rad(turn)
    connected = (states.segment[:-1] == states.segment[-1]) & (states.segment[-1] >= 0)
    steady = turn_rad <= max_turn_rad
    seconds = np.asarray((stamp_ns - stamps[:-1]) * 1e-9, dtype=np.float64)
    drift_m = np.asarray(states.sigma_m[-1] - states.sigma_m[:-1])
    moved = length >= _least_baseline(drift_m, seconds, measured=trajectory.from_poses)
    current = stamp_ns, int(states.segment[-1])
    reason = _reason(frames, current, length, (connected, steady, moved))
    displacement = np.where(oriented[:, None], in_camera, world)
    directed = oriented | trajectory.non_rotating
    usable = connected & steady & moved
    return Baselines(frames, displacement, length, drift_m, turn, turn_rad, directed, usable, reason)


@dataclass(frozen=True)
class Pair:
    """An earlier frame chosen for the current one.

    displacement_m (3,) and directed as in Baselines, or seen, where the pictures tell its direction to the camera;
    length_m its length, depth_m the depth that asked for it, current_from_previous (3, 3), turn_rad
    its angle; covariance (6, 6) of what its rotation and direction may still be off (`Remainder.left_open`), None
    where the pictures were not asked; bend (3,), radians, of a rolling shutter (`rolling_shutter`), None where none is
    clear; length_sigma_m the length's standard deviation, as the log tells it, or depth that wavers (`Wavering`).
    """

    previous: AnyFrame
    displacement_m: Vector
    length_m: float
    depth_m: float
    current_from_previous: Vector
    turn_rad: float
    directed: bool = True
    seen: bool = False
    covariance: Vector | None = None
    bend: Vector | None = None
    length_sigma_m: float = 0.0

    @property
    def aside_rad(self) -> float:
        """Standard deviation of the displacement's direction, in the way in which log and pictures tell it least."""
        seen_rad = LOG_SIGMA_RAD if self.directed else SEEN_SIGMA_RAD
        if self.covariance is not None:
            seen_rad = float(np.sqrt(max(np.linalg.eigvalsh(self.covariance[3:, 3:])[-1], 0.0)))
        return float(np.hypot(seen_rad, self.length_sigma_m / self.length_m))


def pick(lines: Baselines, wanted_m: Vector, depths_m: Vector) -> tuple[Pair, ...]:
    """For each wanted displacement [m] the closest usable one; youngest frame first.

    `depths_m` [m] are the depths that ask for them. Equal frames are merged, the first to ask keeps it. Of
    two equally close the younger frame is taken, which shares more of the picture.
    """
    usable = np.flatnonzero(lines.usable)[::-1]
    chosen: dict[int, float] = {}
    for wanted, depth in zip(wanted_m, depths_m, strict=True):
        nearest = int(usable[np.argmin(np.abs(lines.length_m[usable] - wanted))])
        chosen.setdefault(nearest, float(depth))
    return tuple(_pair(lines, k, chosen[k]) for k in sorted(chosen, reverse=True))


def _pair(lines: Baselines, k: int, depth_m: float = np.nan) -> Pair:
    return Pair(
        previous=lines.frames[k],
        displacement_m=lines.displacement_m[k],
        length_m=float(lines.length_m[k]),
        depth_m=depth_m,
        current_from_previous=lines.current_from_previous[k],
        turn_rad=float(lines.turn_rad[k]),
        directed=bool(lines.directed[k]),
        length_sigma_m=float(lines.length_sigma_m[k]),
    )


Served = tuple[tuple[Pair, ...], tuple[Pair, ...]]  # pairs to look through, and those that they serve


def seen_from(lines: Baselines, pairs: Sequence[Pair]) -> list[Served]:
    """Pairs in which the direction of `pairs` can be seen, the best first, each with those that it serves.

    A direction is seen best over a baseline that moves pixels by several, and leaves most of them in view: the
    frame about LOOK_BACK times as far away as the shortest pair; else the longest pair's. Both of those that
    were flown from in the pair's direction within SAME_WAY_RAD.
    """
    found: list[Served] = []
    left = sorted(pairs, key=lambda pair: pair.length_m)
    while left:
        shortest = left[0]
        straight = lines.usable & same_way(lines.displacement_m, shortest.displacement_m)
        off_m = np.where(straight, np.abs(lines.length_m - LOOK_BACK * shortest.length_m), np.inf)
        near = same_way(np.array([pair.displacement_m for pair in left]), shortest.displacement_m)
        served = tuple(pair for pair, same in zip(left, near, strict=True) if same)
        found.append(((_pair(lines, int(off_m.argmin())), served[-1]), served))
        left = [pair for pair, same in zip(left, near, strict=True) if not same]
    return found


def same_way(displacements_m: Vector, one_m: Vector) -> Flags:
    """Whether each of some displacements [k, 3] points the way of one, (3,)."""
    lengths = np.linalg.norm(displacements_m, axis=1) * np.linalg.norm(one_m)
    return np.asarray(displacements_m @ one_m >= np.cos(SAME_WAY_RAD) * lengths)


def _least_baseline(drift_m: Vector, seconds: Vector, *, measured: bool) -> Vector:
    """Metres [k] that a displacement needs; a measured position has no drift that grows with time."""
    if measured:
        return np.full(len(seconds), MIN_BASELINE_M)
    hidden_m = np.maximum(MIN_SPEED_M_S * seconds, SPEED_OVER_SIGMA * drift_m)
    return np.asarray(hidden_m.clip(MIN_BASELINE_M), np.float64)


def _reason(
    frames: Sequence[AnyFrame],
    current: tuple[int, int],
    lengths_m: Vector,
    conditions: tuple[Flags, Flags, Flags],
) -> str | None:
    """Which condition (connected, steady, moved), each [k], leaves no frame; `current`: stamp and segment."""
    connected, steady, moved = conditions
    if current[1] < 0:
        return "no motion known: no velocity or pose near this frame's time"
    if not frames:
        return "first frame: no earlier one to pair it with"
    if not connected.any():
        return "gap in the motion: no earlier frame is connected to this one"
    if not (connected & steady).any():
        return TURNED_AWAY
    if (connected & steady & moved).any():
        return None
    span_s = (current[0] - frames[int(np.argmax(connected))].stamp_ns) * 1e-9
    farthest_m = float(lengths_m[connected & steady].max())
    kind = "hovering" if span_s > SOON_S else "first frames"
    hidden = farthest_m >= max(MIN_BASELINE_M, MIN_SPEED_M_S * span_s)
    why = "no more than the log's velocities may err" if hidden else "no baseline"
    return f"{kind}: flown {farthest_m:.2f} m in {span_s:.2f} s, {why}"
