"""Frames of a flight, each paired with the earlier ones from which the camera flew some given distances."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.evaluation.tracked_points import PathLength
from flightdepth.flight import AttitudeSample, Flight, Frame, Steadiness, VelocitySample
from flightdepth.flight.steadiness import TurnRate
from flightdepth.ranges.direction import estimate_direction
from flightdepth.ranges.displacement import Trajectory
from flightdepth.ranges.network import FrameGrid
from flightdepth.ranges.pairs import Baselines, FrameBuffer, baselines
from flightdepth.ranges.pairs import Frame as Prepared
from flightdepth.ranges.turning import homography, is_visible, turned

Image = NDArray[np.uint8]
Flags = NDArray[np.bool_]
Vector = NDArray[np.float64]

NEAR_ENOUGH = 0.2  # of the wanted distance
SPAN_S = 4.0  # how long ago an earlier frame may be, as in the estimator


@dataclass(frozen=True, eq=False)
class BaselinePair:
    """An earlier frame for the current one, both on the network's grid.

    wanted_m      the distance that was asked for; the one flown is within NEAR_ENOUGH of it
    previous      uint8 RGB [H, W, 3], in the current orientation
    known         bool [H, W]: the pixel of `previous` shows the scene
    displacement  metres (3,), in the current camera's frame
    from_log      whether its direction is the log's; else it was seen in the two pictures
    """

    wanted_m: float
    previous: Image
    known: Flags
    displacement: Vector
    from_log: bool


@dataclass(frozen=True, eq=False)
class Moment:
    """A frame on the network's grid, its pairs (none where it was left out or not sampled), metres flown so far.

    flown_m is None where the log does not reach.
    """

    index: int
    current: Image
    pairs: tuple[BaselinePair, ...]
    flown_m: float | None


class BaselinePairs:
    """Walks through a flight. `left_out` counts the sampled frames and pairs that could not be had, by cause."""

    def __init__(self, flight: Flight, grid: FrameGrid, baselines_m: Sequence[float], *, every: int) -> None:
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
                case VelocitySample(stamp_ns=at, velocity=velocity):
                    self._trajectory.add_velocity(at, velocity, frame=event.frame, sigma=event.sigma)
                    self._path.add(at, float(np.linalg.norm(velocity)))
                case AttitudeSample():
                    self._trajectory.add_attitude(event.stamp_ns, event.world_from_camera)
                case Frame():
                    yield self._moment(event, steadiness.add(event.stamp_ns, event.image))

    def _moment(self, frame: Frame, turn: TurnRate) -> Moment:
        prepared = self._grid.image(frame.image)
        current = Prepared(
            frame.index, frame.stamp_ns, prepared.copy() if prepared is frame.image else prepared
        )
        sampled = frame.index % self._every == 0
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
        found = (self._pair(lines, current, wanted_m) for wanted_m in self._baselines_m)
        return tuple(pair for pair in found if pair is not None)

    def _pair(self, lines: Baselines, current: Prepared, wanted_m: float) -> BaselinePair | None:
        usable = np.flatnonzero(lines.usable)[::-1]
        nearest = int(usable[np.argmin(np.abs(lines.length_m[usable] - wanted_m))])
        if abs(lines.length_m[nearest] / wanted_m - 1) > NEAR_ENOUGH:
            self.left_out[f"pair: no earlier frame within {NEAR_ENOUGH:.0%} of {wanted_m:g} m"] += 1
            return None
        previous, known = self._turned(lines, nearest)
        displacement, directed = lines.displacement_m[nearest], bool(lines.directed[nearest])
        if not directed:
            seen = estimate_direction(previous, current.image, self._grid.camera)
            if seen is None:
                self.left_out[f"pair: no direction to be seen over {wanted_m:g} m"] += 1
                return None
            displacement = seen.unit * lines.length_m[nearest]
        return BaselinePair(wanted_m, previous, known, displacement, directed)

    def _turned(self, lines: Baselines, k: int) -> tuple[Image, Flags]:
        """The earlier picture in the current orientation, and which of its pixels show the scene."""
        camera, image = self._grid.camera, self._buffer.frames[k].image
        if not is_visible(float(lines.turn_rad[k]), camera):
            return image, self.known
        turn = lines.current_from_previous[k]
        size = (camera.width, camera.height)
        known = cv2.warpPerspective(self.known.astype(np.float32), homography(turn, camera), size)
        return turned(image, turn, camera), known > 0.999
