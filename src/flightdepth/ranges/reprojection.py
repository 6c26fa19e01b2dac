"""Where an earlier frame saw the points of a depth map, as the motion since then tells."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from flightdepth.camera import Camera
from flightdepth.motion import Vector
from flightdepth.ranges.displacement import Trajectory
from flightdepth.ranges.network import Map

NOT_TURNED = np.eye(3)


@dataclass(frozen=True)
class Step:
    """How the camera moved since an earlier frame.

    displacement_m         (3,) in the current camera's axes
    current_from_previous  (3, 3)
    """

    displacement_m: Vector
    current_from_previous: Vector


def step_between(
    trajectory: Trajectory,
    stamps_ns: tuple[int, int],
    seen_unit: Vector | None,
    seen_turn: Vector = NOT_TURNED,
) -> Step | None:
    """The step from the first time to the second; None where the log does not tell it.

    `seen_unit` (3,): direction in the current camera's axes that the pictures show, for a log without, or a wrong one;
    `seen_turn` (3, 3) is the turn that they show, for a log without.
    """
    states = trajectory.at(np.array(stamps_ns, dtype=np.int64))
    if states.segment[0] < 0 or states.segment[0] != states.segment[1]:
        return None
    world_m = states.position_m[1] - states.position_m[0]
    current, turn = states.world_from_camera[1], seen_turn
    if states.oriented.all():
        turn = current.T @ states.world_from_camera[0]
    if seen_unit is not None:
        return Step(seen_unit * np.linalg.norm(world_m), turn)
    if states.oriented.all():
        return Step(world_m @ current, turn)
    return Step(world_m, turn) if trajectory.non_rotating else None


class Reprojection:
    """Brings points of the network's output grid to where an earlier frame saw them."""

    def __init__(self, camera: Camera, shape: tuple[int, int]) -> None:
        """`camera` of the network's pictures, `shape` (h, w) of its maps."""
        height, width = shape
        small = camera.resized(width, height)
        self._matrix = small.matrix
        self._rays = small.rays().reshape(-1, 3).T.astype(np.float32)  # (3, h w)

    def seen_before(self, depth_m: Map, step: Step) -> tuple[Map, Map, Map]:
        """Where the earlier frame saw each point: pixels x and y, and its depth there, metres [h, w]."""
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


def looked_up(map_hw: Map, x: Map, y: Map) -> Map:
    """The nearest pixels of a map, NaN beside it; between two of them lies an edge as often as not."""
    outside = float("nan")
    found = cv2.remap(map_hw, x, y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=outside)
    return np.asarray(found, dtype=np.float32)
