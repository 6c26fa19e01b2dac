"""Depth that holds still: each frame's is averaged with the one before, moved by the known motion.

A network's errors change from frame to frame, though less than they would by chance, so an average flickers much
less and errs a little less. What does not agree (edges, things that move, a depth that was wrong) starts anew.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from flightdepth.camera import Camera
from flightdepth.motion import Vector
from flightdepth.ranges.displacement import Trajectory
from flightdepth.ranges.fusion import Fused, chance
from flightdepth.ranges.network import Map
from flightdepth.ranges.pairs import Pair

GAIN = 0.4  # weight of the new frame
AGREE_WITHIN = 1.25  # ratio of two depths of one point beyond which they are of different things


@dataclass(frozen=True)
class Step:
    """How the camera moved since the last frame.

    displacement_m         (3,) in the current camera's axes
    current_from_previous  (3, 3)
    """

    displacement_m: Vector
    current_from_previous: Vector


def step_between(trajectory: Trajectory, stamps_ns: tuple[int, int], seen_unit: Vector | None) -> Step | None:
    """The step from the first time to the second; None where the log does not tell it.

    `seen_unit` (3,): direction in the current camera's axes that the pictures show, for a log without, or a wrong one.
    """
    states = trajectory.at(np.array(stamps_ns, dtype=np.int64))
    if states.segment[0] < 0 or states.segment[0] != states.segment[1]:
        return None
    world_m = states.position_m[1] - states.position_m[0]
    current, turn = states.world_from_camera[1], np.eye(3)
    if states.oriented.all():
        turn = current.T @ states.world_from_camera[0]
    if seen_unit is not None:
        return Step(seen_unit * np.linalg.norm(world_m), turn)
    if states.oriented.all():
        return Step(world_m @ current, turn)
    return Step(world_m, turn) if trajectory.non_rotating else None


class HeldStill:
    """A flight's depth, averaged over its frames, each moved as its trajectory or else its own pictures tell."""

    def __init__(self, average: TemporalAverage, trajectory: Trajectory) -> None:
        self._average, self._trajectory = average, trajectory
        self._last_ns: int | None = None  # of the last depth that the average holds

    def forget(self) -> None:
        """Begin anew: the last depth may be of damaged pictures, or of another flight."""
        self._last_ns = None

    def add(self, stamp_ns: int, fused: Fused, pair: Pair, *, sees_direction: bool) -> Fused:
        """A frame's depth averaged with those before, as far as the motion since the last one is known.

        `pair` is one of the frame's; with `sees_direction` its displacement points the right way, whoever told it.
        """
        step = None
        if self._last_ns is not None and (pair.directed or sees_direction):
            unit = None if pair.directed else pair.displacement_m / pair.length_m
            step = step_between(self._trajectory, (self._last_ns, stamp_ns), unit)
        self._last_ns = stamp_ns
        return self._average.add(fused, step)


class TemporalAverage:
    """The running average over one flight of fused maps on the network's output grid."""

    def __init__(self, camera: Camera, shape: tuple[int, int]) -> None:
        """`camera` of the network's pictures, `shape` (h, w) of its maps."""
        height, width = shape
        small = camera.resized(width, height)
        self._matrix = small.matrix
        self._rays = small.rays().reshape(-1, 3).T.astype(np.float32)  # (3, h w)
        self._last: Fused | None = None

    def add(self, fused: Fused, step: Step | None) -> Fused:
        """The frame's maps averaged with those before; as they are where `step` is None or nothing agrees."""
        if self._last is not None and step is not None:
            fused = self._averaged(fused, self._last, step)
        self._last = fused
        return fused

    def _averaged(self, new: Fused, last: Fused, step: Step) -> Fused:
        """depth + (1 - GAIN) (last depth of the same point, moved - depth), where the two agree."""
        x, y, ahead_m = self._seen_before(new.depth_m, step)
        before_m = _looked_up(last.depth_m, x, y)
        with np.errstate(invalid="ignore", divide="ignore"):
            # Both depths of the earlier camera; their difference is that of the present one's for a small turn.
            off_m = before_m - ahead_m
            ratio = (new.depth_m + off_m) / new.depth_m
            agrees = (ratio < AGREE_WITHIN) & (ratio * AGREE_WITHIN > 1)
        share = np.where(agrees, np.float32(1 - GAIN), np.float32(0))
        depth_m = new.depth_m + share * np.where(agrees, off_m, np.float32(0))
        if new.sigma_m is None or last.sigma_m is None:
            confidence = _mixed(new.confidence, _looked_up(last.confidence, x, y), share)
            return replace(new, depth_m=depth_m, confidence=confidence)
        sigma_m = _mixed(new.sigma_m, _looked_up(last.sigma_m, x, y), share)
        return replace(new, depth_m=depth_m, confidence=chance(depth_m, sigma_m), sigma_m=sigma_m)

    def _seen_before(self, depth_m: Map, step: Step) -> tuple[Map, Map, Map]:
        """Where the last frame saw each point: pixels x and y, and its depth there, metres [h, w]."""
        # X_previous = R^T (X_current + displacement), R turning the earlier camera's axes into the present one's.
        seen = self._matrix @ step.current_from_previous.T
        moved = (seen @ step.displacement_m).astype(np.float32)
        points = seen.astype(np.float32) @ self._rays
        points *= depth_m.ravel()
        points += moved[:, None]
        ahead_m = points[2]
        with np.errstate(invalid="ignore", divide="ignore"):
            pixels = points[:2] / ahead_m
        # What lies behind goes beside the picture; cv2.remap does not take NaN.
        x, y = np.where(ahead_m > 0, pixels, np.float32(-1e6)).reshape(2, *depth_m.shape)
        return x, y, ahead_m.reshape(depth_m.shape)


def _looked_up(map_hw: Map, x: Map, y: Map) -> Map:
    """The nearest pixels of a map, NaN beside it; between two of them lies an edge as often as not."""
    outside = float("nan")
    found = cv2.remap(map_hw, x, y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=outside)
    return np.asarray(found, dtype=np.float32)


def _mixed(new: Map, last: Map, share: Map) -> Map:
    """Errors of consecutive frames go together, so their deviations are averaged, not reduced."""
    return np.where(share > 0, new + share * (last - new), new)
