"""The attitude of a level camera (a gimbal keeps its horizon) from the direction in which it is seen to move.

With no roll, world_from_camera = Rz(yaw) Ry(pitch) NED_FROM_CAMERA. The log tells the motion in the world, w; the
pictures tell it in the camera's axes, here as b = (forward, right, down). Pitch must bring b to w's height,

    down cos(pitch) - forward sin(pitch) = w_down,

and yaw then turns it into w's course. Where the camera moves along its right axis pitch changes nothing: such frames
weigh nothing in it, and pitch is a running mean, since a gimbal's pitch moves slowly.
"""

from __future__ import annotations

import math

import numpy as np

from flightdepth.motion import NED_FROM_CAMERA, Vector, rotation_from_euler

PITCH_MEMORY_S = 2.0
YAW_MEMORY_S = 0.5
LEAST_WEIGHT = 0.05  # a frame of motion 13 degrees off the right axis; less has not told the pitch yet
HOLDS_S = 0.5  # how long the attitude holds for frames that do not tell one
STEEPEST_RAD = math.radians(100)  # gimbals look down to -90 degrees, some a little farther


class LevelCamera:
    """Running estimate of pitch and yaw; `add` motions in time order, then ask `at`."""

    def __init__(self) -> None:
        self._last_ns: int | None = None
        self._pitch_sum = self._weight = 0.0
        self._yaw_sum = 0j  # a mean of angles is the angle of the mean arrow

    def add(self, stamp_ns: int, moved_camera: Vector, moved_ned: Vector) -> None:
        """One motion, (3,) each, in the camera's axes (right, down, forward) and in the world's (NED)."""
        seen, flown = np.linalg.norm(moved_camera), np.linalg.norm(moved_ned)
        if not (seen > 0 and flown > 0):
            return
        body, world = NED_FROM_CAMERA @ moved_camera / seen, moved_ned / flown
        self._forget(stamp_ns)
        known_rad = self._pitch_sum / self._weight if self._weight > 0 else 0.0
        weight = float(body[0] ** 2 + body[2] ** 2)
        pitch_rad = pitch_that_lifts(body, float(world[2]), near_rad=known_rad)
        self._pitch_sum += weight * pitch_rad
        self._weight += weight
        self._yaw_sum += self._arrow(body, world)

    def at(self, stamp_ns: int) -> Vector | None:
        """world_from_camera (3, 3) at the last motion's time or soon after; None where nothing tells it."""
        if self._last_ns is None or self._weight < LEAST_WEIGHT:
            return None
        if (stamp_ns - self._last_ns) * 1e-9 > HOLDS_S:
            return None
        yaw_rad = math.atan2(self._yaw_sum.imag, self._yaw_sum.real)
        return np.asarray(rotation_from_euler(0.0, self._pitch_sum / self._weight, yaw_rad) @ NED_FROM_CAMERA)

    def _forget(self, stamp_ns: int) -> None:
        elapsed_s = 0.0 if self._last_ns is None else (stamp_ns - self._last_ns) * 1e-9
        self._last_ns = stamp_ns
        fading = math.exp(-elapsed_s / PITCH_MEMORY_S)
        self._pitch_sum, self._weight = self._pitch_sum * fading, self._weight * fading
        self._yaw_sum *= math.exp(-elapsed_s / YAW_MEMORY_S)

    def _arrow(self, body: Vector, world: Vector) -> complex:
        """The camera's yaw as an arrow, shorter the steeper the motion, which tells no course."""
        pitch_rad = self._pitch_sum / self._weight if self._weight > 0 else 0.0
        ahead = complex(body[0] * math.cos(pitch_rad) + body[2] * math.sin(pitch_rad), body[1])
        return complex(world[0], world[1]) * ahead.conjugate()


def pitch_that_lifts(body: Vector, down: float, *, near_rad: float) -> float:
    """Pitch, radians, for which Ry(pitch) gives `body` the height `down`; of the two the one nearer to `near_rad`.

    Where none does (noise), the pitch that comes nearest.
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
