"""The attitude of a level camera (a gimbal keeps its horizon) from how it is seen to move and to turn.

The log tells each motion in the world, w; the pictures tell it in the camera's axes, m, and how the camera turned
between two frames. So the turns are put together to orientations A, whatever the first frame's was, and the rotation G
is sought that turns A into the world: with the least sum of squares of

    G A m - w (units),  and of the height of G A r, where r is the camera's right axis, which is level,

weighted by how sure each direction is. Where the camera flies along its right axis neither tells its pitch; then it is
unknown until another motion has told it, and known afterwards, as long as the turns are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from flightdepth.motion import NED_FROM_CAMERA, Vector, rotation_from_euler
from flightdepth.ranges.seen_turns import SeenOrientation

MEMORY_S = 10.0  # turns put together drift, by some 0.03 degrees a pair
HOLDS_S = 0.2  # how long the attitude holds for frames whose pictures tell none
LEAST_SIGMA_RAD = math.radians(0.5)  # of a direction: neighbouring frames err together
WORST_SIGMA_RAD = math.radians(2)  # beyond it the attitude is not known
STEEPEST_RAD = math.radians(100)  # gimbals look down to -90 degrees, some a little farther
MOST_STEPS, LONGEST_STEP_RAD, LEAST_STEP_RAD = 20, 0.5, 1e-6  # of Newton's method, a frame


@dataclass(frozen=True, eq=False)
class SeenMotion:
    """How a camera was seen to move, and how to look.

    orientation   by turns in the pictures, at the end of the motion
    moved_camera  (3,) in its own axes then (right, down, forward), any unit
    moved_ned     (3,) the same north, east, down
    sigma_rad     standard deviation of the direction that these two tell
    """

    stamp_ns: int
    orientation: SeenOrientation
    moved_camera: Vector
    moved_ned: Vector
    sigma_rad: float


class LevelCamera:
    """Running estimate of a camera's attitude; `add` motions in time order, then ask `at`."""

    def __init__(self) -> None:
        self._last: SeenMotion | None = None
        self._world_from_first = NED_FROM_CAMERA  # G
        self._moved = self._right = np.zeros((3, 3))  # weighted sums of w (A m)^T and of (A r) (A r)^T

    def add(self, motion: SeenMotion) -> None:
        """Take the next motion; standing still tells nothing."""
        seen, flown = np.linalg.norm(motion.moved_camera), np.linalg.norm(motion.moved_ned)
        if not (seen > 0 and flown > 0):
            return
        body, world = motion.moved_camera / seen, motion.moved_ned / flown
        last, orientation = self._last, motion.orientation.rotation
        if last is None or last.orientation.begun_ns != motion.orientation.begun_ns:
            self._begin(orientation, body, world)
        else:
            self._fade((motion.stamp_ns - last.stamp_ns) * 1e-9)
        self._last = motion
        weight = 1 / (LEAST_SIGMA_RAD**2 + motion.sigma_rad**2)
        self._moved = self._moved + weight * np.outer(world, orientation @ body)
        self._right = self._right + weight * np.outer(orientation[:, 0], orientation[:, 0])
        for _ in range(MOST_STEPS):
            if self._step() < LEAST_STEP_RAD:
                break

    def at(self, stamp_ns: int) -> Vector | None:
        """world_from_camera (3, 3) at the last motion's time or soon after; None where nothing tells it."""
        if self._last is None or (stamp_ns - self._last.stamp_ns) * 1e-9 > HOLDS_S:
            return None
        if np.linalg.eigvalsh(self._equations()[0])[0] < WORST_SIGMA_RAD**-2:
            return None
        return np.asarray(self._world_from_first @ self._last.orientation.rotation)

    def _begin(self, orientation: Vector, body: Vector, world: Vector) -> None:
        """Anew, with a rotation for which one motion (unit vectors) fits, near the last motion's pitch."""
        near_rad = 0.0
        if self._last is not None:
            ahead = self._world_from_first @ self._last.orientation.rotation[:, 2]
            near_rad = -math.asin(min(1.0, max(-1.0, float(ahead[2]))))
        moved = NED_FROM_CAMERA @ body
        pitch_rad = pitch_that_lifts(moved, float(world[2]), near_rad=near_rad)
        lifted = rotation_from_euler(0.0, pitch_rad, 0.0) @ moved
        yaw_rad = math.atan2(world[1], world[0]) - math.atan2(lifted[1], lifted[0])
        world_from_camera = rotation_from_euler(0.0, pitch_rad, yaw_rad) @ NED_FROM_CAMERA
        self._world_from_first = np.asarray(world_from_camera @ orientation.T)
        self._moved = self._right = np.zeros((3, 3))

    def _fade(self, elapsed_s: float) -> None:
        kept = math.exp(-elapsed_s / MEMORY_S)
        self._moved, self._right = kept * self._moved, kept * self._right

    def _equations(self) -> tuple[Vector, Vector]:
        """Information (3, 3) on a rotation vector before G, and the pull (3,) that it feels.

        Of |G A m - w|^2 / 2 = 1 - w . G A m, summed, exactly; of the heights of right axes v, that a rotation
        vector (a, b, c) changes by a v_y - b v_x, as if these were small.
        """
        moved = self._moved @ self._world_from_first.T
        right = self._world_from_first @ self._right @ self._world_from_first.T
        information = np.trace(moved) * np.eye(3) - (moved + moved.T) / 2
        information[:2, :2] += [[right[1, 1], -right[0, 1]], [-right[0, 1], right[0, 0]]]
        turning = moved - moved.T
        pull = np.array([turning[2, 1] - right[1, 2], turning[0, 2] + right[0, 2], turning[1, 0]])
        return information, pull

    def _step(self) -> float:
        """One of Newton's, as far as that can be told, and not too far; radians."""
        information, pull = self._equations()
        values, axes = np.linalg.eigh(information)
        step = axes @ ((axes.T @ pull) / np.maximum(values, 1e-3 * values[-1]))
        long_rad = float(np.linalg.norm(step))
        step *= min(1.0, LONGEST_STEP_RAD / max(long_rad, LEAST_STEP_RAD))
        self._world_from_first = np.asarray(cv2.Rodrigues(step)[0] @ self._world_from_first)
        return long_rad


def pitch_that_lifts(body: Vector, down: float, *, near_rad: float) -> float:
    """Pitch, radians, for which Ry(pitch) gives `body` the height `down`; of the two the one nearer to `near_rad`.

    `body` is forward, right, down: down cos(pitch) - forward sin(pitch). Where no pitch does (noise), the one that
    comes nearest.
    """
    reach = math.hypot(body[0], body[2])
    if reach < 1e-6:
        return near_rad
    # down cos p - forward sin p = reach cos(p + phase)
    phase = math.atan2(body[0], body[2])
    half = math.acos(min(1.0, max(-1.0, down / reach)))
    both = [math.remainder(sign * half - phase, 2 * math.pi) for sign in (-1, 1)]
    best = min(both, key=lambda pitch: abs(math.remainder(pitch - near_rad, 2 * math.pi)))
    return min(STEEPEST_RAD, max(-STEEPEST_RAD, best))
