"""Frames of a flight, each paired with the earlier ones from which the camera flew some given distances."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum

import cv2
import numpy as np

from flightdepth.camera import Camera
from flightdepth.evaluation.tracked_points import PathLength
from flightdepth.flight import Flight, Frame, Steadiness, VelocitySample
from flightdepth.flight.records import give
from flightdepth.flight.steadiness import TurnRate
from flightdepth.levels import AnyImage
from flightdepth.motion import Vector
from flightdepth.ranges.direction import estimate_direction
from flightdepth.ranges.displacement import Trajectory
from flightdepth.ranges.pairs import Baselines, FrameBuffer, baselines, same_way
from flightdepth.ranges.pairs import Frame as Prepared
from flightdepth.ranges.turning import homography, is_visible, turned
from flightdepth.runtimes.arrays import Flags
from flightdepth.runtimes.grid import NetworkGrid

NEAR_ENOUGH = 0.2  # of the wanted distance
SPAN_S = 4.0  # how long ago an earlier frame may be, as in the estimator


class Witness(Enum):
    """What told the direction of a displacement in the camera's axes."""

    LOG = "the log"
    PICTURES = "its two pictures"
    LONGER = "a longer pair of the same frame"


@dataclass(frozen=True, eq=False)
class BaselinePair:
    """An earlier frame for the current one, both on the network's grid.

    wanted_m      the distance that was asked for; the one flown is within NEAR_ENOUGH of it
    previous      RGB [H, W, 3], in the current orientation
    known         bool [H, W]: the pixel of `previous` shows the scene
    displacement  metres (3,), in the current camera's frame
    witness       what told its direction
    """

    wanted_m: float
    previous: AnyImage
    known: Flags
    displacement: Vector
    witness: Witness


@dataclass(frozen=True, eq=False)
class Moment:
    """A frame on the network's grid, its pairs (none where it was left out or not sampled), metres flown so far.

    flown_m is None where the log does not reach, and of a frame whose camera is not the flight's.
    """

    index: int
    current: AnyImage
    pairs: tuple[BaselinePair, ...]
    flown_m: float | None


class BaselinePairs:
    """Walks through a flight. `left_out` counts the sampled frames and pairs that could not be had, by cause."""

    def __init__(
        self, flight: Flight, grid: NetworkGrid, baselines_m: Sequence[float], *, every: int
    ) -> None:
        self._flight, self._grid, self._every = flight, grid, every
        self._baselines_m = tuple(baselines_m)
        self.left_out: Counter[str] = Counter()
        self._trajectory, self._path = Trajectory(), PathLength()
        self._buffer = FrameBuffer(SPAN_S)
        self._max_turn_rad = math.radians(flight.camera.horizontal_fov_deg) / 4
        # The map's cells are as many pixels wide as high.
        cell = grid.camera.width // grid.valid.shape[1]
        self.known = grid.valid.repeat(cell, axis=0).repeat(cell, axis=1)

    def __iter__(self) -> Iterator[Moment]:
        """Every frame, in the order of the flight; of every `every`-th the pairs."""
        steadiness = Steadiness(self._flight.camera, self._flight.gyroscope)
        for event in self._flight:
            match event:
                case Frame():
                    yield self._moment(event, steadiness.add(event.stamp_ns, event.image))
                case sample:
                    give(sample, self._trajectory)
                    if isinstance(sample, VelocitySample):
                        self._path.add(sample.stamp_ns, float(np.linalg.norm(sample.velocity)))

    def _moment(self, frame: Frame, turn: TurnRate) -> Moment:
        prepared = self._grid.image(frame.image)
        current = Prepared(
            frame.index, frame.stamp_ns, prepared.copy() if prepared is frame.image else prepared
        )
        sampled = frame.index % self._every == 0
        if frame.after_damage:
            self._buffer.clear()  # as in the estimator: some of them may be damaged
        if frame.camera not in (None, self._flight.camera):  # the grid is the first one's
            self.left_out["frame zoomed or cropped otherwise than the first"] += sampled
            return Moment(frame.index, current.image, (), None)
        pairs = self._pairs(current, turn) if sampled else ()
        if turn.usable:
            self._buffer.add(current)
        elif not self._trajectory.knows_attitude:
            self._buffer.clear()  # as in the estimator: a pair across the turn would be a wrong one
        return Moment(frame.index, current.image, pairs, self._path.at(frame.stamp_ns))

    def _pairs(self, current: Prepared, turn: TurnRate) -> tuple[BaselinePair, ...]:
        if not turn.usable:
            self.left_out["frame in a fast turn"] += 1
            return ()
        before_ns = current.stamp_ns - round(SPAN_S * 1e9)
        self._buffer.expire(before_ns)
        self._trajectory.forget(before_ns)
        lines = baselines(self._trajectory, self._buffer.frames, current.stamp_ns, self._max_turn_rad)
        if lines.reason is not None:
            self.left_out[f"frame: {lines.reason.split(':')[0]}"] += 1
            return ()
        pairs: list[BaselinePair] = []
        directions = _Directions(self._grid.camera)
        for wanted_m in sorted(self._baselines_m, reverse=True):
            pairs += self._pair(lines, current, wanted_m, directions)
        return tuple(reversed(pairs))

    def _pair(
        self, lines: Baselines, current: Prepared, wanted_m: float, directions: _Directions
    ) -> list[BaselinePair]:
        usable = np.flatnonzero(lines.usable)[::-1]
        nearest = int(usable[np.argmin(np.abs(lines.length_m[usable] - wanted_m))])
        if abs(lines.length_m[nearest] / wanted_m - 1) > NEAR_ENOUGH:
            self.left_out[f"pair: no earlier frame within {NEAR_ENOUGH:.0%} of {wanted_m:g} m"] += 1
            return []
        previous, known = self._turned(lines, nearest)
        displacement, witness = lines.displacement_m[nearest], Witness.LOG
        if not lines.directed[nearest]:
            told = directions.see(previous, current.image, displacement)
            if told is None:
                self.left_out[f"pair: no direction to be seen over {wanted_m:g} m"] += 1
                return []
            displacement, witness = told
        return [BaselinePair(wanted_m, previous, known, displacement, witness)]

    def _turned(self, lines: Baselines, k: int) -> tuple[AnyImage, Flags]:
        """The earlier picture in the current orientation, and which of its pixels show the scene."""
        camera, image = self._grid.camera, self._buffer.frames[k].image
        if not is_visible(float(lines.turn_rad[k]), camera):
            return image, self.known
        turn = lines.current_from_previous[k]
        size = (camera.width, camera.height)
        known = cv2.warpPerspective(self.known.astype(np.float32), homography(turn, camera), size)
        return turned(image, turn, camera), known > 0.999


class _Directions:
    """Directions of motion that one frame's pairs show, the longest pair first.

    Over a short baseline too little moves; if the log says that the drone flew the same way as over a longer
    one, what that one showed holds.
    """

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self._seen: tuple[Vector, Vector] | None = None

    def see(self, previous: AnyImage, current: AnyImage, world: Vector) -> tuple[Vector, Witness] | None:
        """The displacement (3,) in camera axes that is `world` (3,) in the log's; None where nothing tells it."""
        length_m = float(np.linalg.norm(world))
        found = estimate_direction(previous, current, self._camera)
        if found is not None:
            self._seen = world / length_m, found.unit
            return found.unit * length_m, Witness.PICTURES
        if self._seen is None or not same_way(self._seen[0][None], world)[0]:
            return None
        return self._seen[1] * length_m, Witness.LONGER
