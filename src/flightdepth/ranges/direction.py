"""The direction of motion from two pictures whose turn is known, or none, where no log tells it, or a wrong one.

A static point seen on the rays x1 (now) and x2 (before) moved in the plane that holds both rays and the
displacement d: d . (x1 x x2) = 0 (the essential constraint without rotation; Hartley and Zisserman, 9.6).
Two points give d, more give it better; the points must have moved away from where d points, which tells its sign.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flightdepth.camera import Camera
from flightdepth.motion import Vector
from flightdepth.ranges.network import Image
from flightdepth.ranges.pairs import Frame, Pair, Served, same_way
from flightdepth.ranges.tracks import Tracker, tracked_rays

FEWEST_INLIERS = 12
# A quarter of the points moved as far as this; less is within what tracking and gimbal get wrong.
LEAST_MOTION_PX = 1.0
LEAST_MOVED = 0.25
LEAST_AGREE = 0.6  # of those that moved; where the camera turned, half agree with a wrong direction
INLIER_PX = 0.75  # between a point and its epipolar line
TRIALS = 120
REFINEMENTS = 3
WORST_SIGMA_RAD = np.radians(15)
# How long a direction holds for pictures that do not tell one, if the log says the same way.
HOLDS_NS = 500_000_000


@dataclass(frozen=True)
class Direction:
    """unit (3,): of the displacement, in the cameras' axes; sigma_rad: its standard deviation, any way; inliers."""

    unit: Vector
    sigma_rad: float
    inliers: int


class SeenDirections:
    """Directions of pairs whose log does not tell them to the camera, from the pictures; a flight's memory of them."""

    def __init__(self, camera: Camera, tracker: Tracker) -> None:
        self._focal_px, self._tracker = camera.fx, tracker
        self._last: tuple[int, Vector, Vector] | None = None  # stamp, world displacement, unit in camera axes

    def of(self, served: Sequence[Served], current: Frame) -> tuple[Pair, ...]:
        """The pairs whose direction is seen, or was a moment ago; shortest shift first. No log directs them."""
        found: list[Pair] = []
        for through, pairs in served:
            unit = self._seen(through, pairs[0].displacement_m, current)
            if unit is not None:
                found += [
                    replace(pair, displacement_m=unit * pair.length_m, directed=False) for pair in pairs
                ]
        return tuple(sorted(found, key=lambda pair: pair.shift))

    def _seen(self, through: Sequence[Pair], world_m: Vector, current: Frame) -> Vector | None:
        tries = (self._direction(pair, current) for pair in through)
        found = next((each for each in tries if each is not None), None)
        if found is not None:
            self._last = current.stamp_ns, world_m, found.unit
            return found.unit
        if self._last is None or current.stamp_ns - self._last[0] > HOLDS_NS:
            return None
        return self._last[2] if same_way(self._last[1][None], world_m)[0] else None

    def _direction(self, pair: Pair, current: Frame) -> Direction | None:
        now, before = rays_of(pair, current, self._tracker)
        return direction_of(now, before, self._focal_px)


def rays_of(pair: Pair, current: Frame, tracker: Tracker) -> tuple[Vector, Vector]:
    """Rays [N, 3] of corners now, and before in the current orientation as far as that is known."""
    image, turn = pair.previous.image, pair.current_from_previous
    return tracker.rays_turned(image, current.image, turn, pair.turn_rad)


def estimate_direction(previous: Image, current: Image, camera: Camera) -> Direction | None:
    """Direction of (position at `current`) - (position at `previous`); uint8 RGB [H, W, 3] of an ideal pinhole.

    None where too few points moved, or their motion says too little.
    """
    now, before = tracked_rays(previous, current, camera)
    return direction_of(now, before, camera.fx)


def direction_of(now: Vector, before: Vector, focal_px: float) -> Direction | None:
    """From rays [N, 3] to the direction: RANSAC over pairs of points, then weighted least squares."""
    normals = np.cross(now, before)
    moved = np.linalg.norm(before - now, axis=1) * focal_px >= LEAST_MOTION_PX
    if len(now) < FEWEST_INLIERS or np.mean(moved) < LEAST_MOVED:
        return None
    d = _consensus(normals, now, focal_px)
    for _ in range(REFINEMENTS):
        inside = np.abs(_off_line(d, normals, now)) * focal_px < INLIER_PX
        if np.count_nonzero(inside) < FEWEST_INLIERS:
            return None
        d, sigma_rad = _least_squares(normals[inside], now[inside], d)
    if sigma_rad > WORST_SIGMA_RAD or np.mean(inside[moved]) < LEAST_AGREE:
        return None
    return Direction(d * _sign(d, now[inside], before[inside]), sigma_rad, int(np.count_nonzero(inside)))


def _consensus(normals: Vector, now: Vector, focal_px: float) -> Vector:
    """The direction, of TRIALS drawn from two points each, that most points agree with."""
    rng = np.random.default_rng(0)  # the same pictures, the same answer
    pairs = rng.integers(len(normals), size=(TRIALS, 2))
    trials = np.cross(normals[pairs[:, 0]], normals[pairs[:, 1]])
    trials /= np.maximum(np.linalg.norm(trials, axis=1, keepdims=True), 1e-12)
    off_px = np.abs(_off_line(trials, normals, now)) * focal_px
    return np.asarray(trials[np.minimum(off_px, INLIER_PX).sum(axis=1).argmin()])


def _off_line(d: Vector, normals: Vector, now: Vector) -> Vector:
    """Distances [..., N] of earlier points from their epipolar lines d x now, on the plane z = 1; d is [..., 3]."""
    return np.asarray(d @ normals.T / np.maximum(_reach(d, now), 1e-6))


def _reach(d: Vector, now: Vector) -> Vector:
    """Length of the line's normal: |(d_y - y d_z, d_x - x d_z)|, 0 at the focus of expansion."""
    x, y = (d[..., axis, None] - d[..., 2, None] * now[:, axis] for axis in (0, 1))
    return np.asarray(np.sqrt(x * x + y * y))  # hypot takes five times as long


def _least_squares(normals: Vector, now: Vector, d: Vector) -> tuple[Vector, float]:
    """The unit vector with the least sum of squared distances, and its standard deviation, radians.

    The spread of a smallest eigenvector is the noise over the root of the next eigenvalue.
    """
    rows = normals / np.maximum(_reach(d, now), 1e-3)[:, None]
    values, vectors = np.linalg.eigh(rows.T @ rows)
    noise = np.sqrt(max(values[0], 0.0) / max(len(rows) - 2, 1))
    return vectors[:, 0], float(noise / np.sqrt(max(values[1], 1e-18)))


def _sign(d: Vector, now: Vector, before: Vector) -> float:
    """+1 where the points came from the side that a displacement along d says, else -1."""
    towards = d[:2] - now[:, :2] * d[2]
    return 1.0 if ((before - now)[:, :2] * towards).sum() >= 0 else -1.0
