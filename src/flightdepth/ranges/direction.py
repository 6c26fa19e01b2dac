"""The direction of motion from two pictures, or none, where no log tells it, or a wrong one.

A static point seen on the rays x1 (now) and x2 (before) moved in the plane that holds both rays and the
displacement d: d . (x1 x x2) = 0 (the essential constraint without rotation; Hartley and Zisserman, 9.6).
Two points give d, more give it better; the points must have moved away from where d points, which tells its sign.
Where the camera also turned that fits no direction well, and direction and rotation are sought together (`remainder`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.levels import AnyImage
from flightdepth.motion import Vector
from flightdepth.ranges.pairs import Frame, Pair, Served, same_way
from flightdepth.ranges.remainder import LEFT_SHARE, MOST_OFF_PX, Remainder, off_lines_px, remainder
from flightdepth.ranges.seen_turns import SeenTurns
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
LEAST_SPREAD = 1e-9  # of rays, squared: those of one place have none
ELSEWHERE_RAD = np.radians([-60, -30, -15, 15, 30, 60, 90])
CLEARLY_WORSE = 9.0  # squared deviations, beyond those of the best direction
# Corners off their lines, on average. Without a turn they are 0.1 to 0.25 px off, with one of 0.2 degrees that is left
# out 0.2 to 0.4: from CLEAN_PX on a turn is looked for. One that leaves more than MOST_LEFT_PX is of things that move.
CLEAN_PX, MOST_LEFT_PX = 0.2, 0.35
ANY_SIGMA_RAD = np.radians(60)  # of each of STARTS: together they reach every direction
STARTS = np.array(
    [
        *((0, 0, 1), (0, 0, -1), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)),
        *((1, 0, 1), (-1, 0, 1), (1, 0, -1), (-1, 0, -1)),
    ],
    dtype=np.float64,
)
# How long a direction holds for pictures that do not tell one, if the log says the same way.
HOLDS_NS = 500_000_000


@dataclass(frozen=True)
class Direction:
    """unit (3,): of the displacement, in the cameras' axes; sigma_rad: its standard deviation, any way."""

    unit: Vector
    sigma_rad: float


class SeenDirections:
    """Directions of pairs whose log does not tell them to the camera, from the pictures; a flight's memory of them."""

    def __init__(self, camera: Camera, tracker: Tracker, turns: SeenTurns) -> None:
        self._camera, self._tracker, self._turns = camera, tracker, turns
        self._last: tuple[int, Vector, Vector] | None = None  # stamp, world displacement, unit in camera axes

    def of(self, served: Sequence[Served], current: Frame) -> tuple[Pair, ...]:
        """The pairs, shortest shift first, `seen` where the direction is, or was a moment ago; no log directs them."""
        found: list[Pair] = []
        for through, pairs in served:
            unit = self._seen(through, pairs[0].displacement_m, current)
            for pair in pairs:
                moved_m = pair.displacement_m if unit is None else unit * pair.length_m
                found.append(replace(pair, displacement_m=moved_m, directed=False, seen=unit is not None))
        return tuple(sorted(found, key=lambda pair: pair.previous.index, reverse=True))

    def _seen(self, through: Sequence[Pair], world_m: Vector, current: Frame) -> Vector | None:
        tries = (direction_seen(*rays_of(pair, current, self._tracker), self._camera) for pair in through)
        found = next((each for each in tries if each is not None), None)
        if found is not None:
            self._last = current.stamp_ns, world_m, found
            return found
        if self._last is None or current.stamp_ns - self._last[0] > HOLDS_NS:
            return None
        turns, _ = self._turns.since(np.array([self._last[0]]), current.stamp_ns)
        return np.asarray(turns[0] @ self._last[2]) if same_way(self._last[1][None], world_m)[0] else None


def rays_of(pair: Pair, current: Frame, tracker: Tracker) -> tuple[Vector, Vector]:
    """Rays [N, 3] of corners now, and before in the current orientation as far as that is known."""
    image, turn = pair.previous.image, pair.current_from_previous
    return tracker.rays_turned(image, current.image, turn, pair.turn_rad)


def estimate_direction(previous: AnyImage, current: AnyImage, camera: Camera) -> Direction | None:
    """Direction of (position at `current`) - (position at `previous`); RGB [H, W, 3], 0 to 255, of an ideal pinhole.

    None where too few points moved, or their motion says too little.
    """
    now, before = tracked_rays(previous, current, camera)
    return direction_of(now, before, camera.fx)


def direction_seen(now: Vector, before: Vector, camera: Camera) -> Vector | None:
    """From rays [N, 3] of a camera that may have turned by a few degrees to the unit vector (3,), or None.

    Without a turn (`direction_of`), unless that leaves much, a turn shows, and it explains what was left.
    """
    focal_px = camera.fx
    still = direction_of(now, before, focal_px)
    unit = None if still is None else still.unit
    left_px = MOST_OFF_PX if unit is None else off_lines_px(now, before, unit, focal_px)
    if left_px < CLEAN_PX or not _tells(_moved(now, before, focal_px)):
        return unit
    if unit is not None:  # most tracks that leave as much are poor ones of a camera that did not turn
        near = remainder(now, before, unit, camera, direction_sigma_rad=ANY_SIGMA_RAD)
        if near is None or not near.turns:
            return unit
    turning = _turning(now, before, camera, STARTS if unit is None else np.vstack([unit, STARTS]))
    if turning is None or turning[1] > min(MOST_LEFT_PX, LEFT_SHARE * left_px):
        return unit
    sigma_rad = np.sqrt(np.linalg.eigvalsh(turning[0].covariance[3:, 3:])[-1])
    return turning[0].unit if sigma_rad <= WORST_SIGMA_RAD else unit


def _turning(now: Vector, before: Vector, camera: Camera, starts: Vector) -> tuple[Remainder, float] | None:
    """Direction and rotation together, of those found from each start (3,) the one that leaves least, and how much."""
    found = [remainder(now, before, each, camera, direction_sigma_rad=ANY_SIGMA_RAD) for each in starts]
    left = [(each, each.left_px(now, before, camera)) for each in found if each is not None]
    return min(left, key=lambda pair: pair[1], default=None)


def _moved(now: Vector, before: Vector, focal_px: float) -> NDArray[np.bool_]:
    return np.asarray(np.linalg.norm(before - now, axis=1) * focal_px >= LEAST_MOTION_PX)


def _tells(moved: NDArray[np.bool_]) -> bool:
    """Whether enough points moved far enough."""
    return len(moved) >= FEWEST_INLIERS and bool(np.mean(moved) >= LEAST_MOVED)


def direction_of(now: Vector, before: Vector, focal_px: float) -> Direction | None:
    """From rays [N, 3] of a camera that did not turn: RANSAC over pairs of points, then weighted least squares."""
    normals = np.cross(now, before)
    moved = _moved(now, before, focal_px)
    if not _tells(moved):
        return None
    d = _consensus(normals, now, focal_px)
    for _ in range(REFINEMENTS):
        inside = np.abs(_off_line(d, normals, now)) * focal_px < INLIER_PX
        if np.count_nonzero(inside) < FEWEST_INLIERS:
            return None
        d, values, axes = _least_squares(normals[inside], now[inside], d)
    sigma_rad = _sigma_rad(d, values, axes, normals[inside], now[inside])
    if sigma_rad > WORST_SIGMA_RAD or np.mean(inside[moved]) < LEAST_AGREE:
        return None
    return Direction(d * _sign(d, now[inside], before[inside]), sigma_rad)


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


def _least_squares(normals: Vector, now: Vector, d: Vector) -> tuple[Vector, Vector, Vector]:
    """The unit vector (3,) with the least sum of squared distances; the eigenvalues [3] and axes [3, 3] that tell it.

    What tracks err by is in the normals too, along some axes more than along others: the plain smallest eigenvector
    leans to where it adds least, and of points in one row the next eigenvalue is such errors alone. So both are told
    against what errors add (renormalisation; Kanatani, Statistical Optimization for Geometric Computation, 9.4): the
    values are in squared errors, and one that is hardly more than the least holds nothing.
    """
    weights = 1 / np.maximum(_reach(d, now), 1e-3)[:, None]
    rows, rays = normals * weights, now * weights
    (xx, _, x), (_, yy, y), (_, _, one) = (rays.T @ rays).tolist()
    added = np.array([[one, 0, -x], [0, one, -y], [-x, -y, xx + yy + LEAST_SPREAD * one]])
    root = np.linalg.inv(np.linalg.cholesky(added))
    values, vectors = np.linalg.eigh(root @ (rows.T @ rows) @ root.T)
    axes = root.T @ vectors
    return axes[:, 0] / np.linalg.norm(axes[:, 0]), values, axes


def _sigma_rad(d: Vector, values: Vector, axes: Vector, normals: Vector, now: Vector) -> float:
    """Standard deviation of d the way in which it is least sure, by its covariance and by looking far that way.

    A covariance is of small errors. Where directions ELSEWHERE leave hardly more squared distances, the parabola
    through one of them tells what d is worth.
    """
    freedom = max(len(now) - 2, 1)
    squared_error = max(values[0], 1e-18) * len(now) / freedom
    variances = squared_error * values[1:] / np.maximum(values[1:] - values[0], 1e-18) ** 2
    across = axes[:, 1:] - np.outer(d, d @ axes[:, 1:])
    variances, ways = np.linalg.eigh(across * variances @ across.T)
    aside = np.sin(ELSEWHERE_RAD)
    there = np.outer(np.cos(ELSEWHERE_RAD), d) + np.outer(aside, ways[:, -1])
    least, left = ((_off_line(each, normals, now) ** 2).sum(axis=-1) for each in (d, there))
    worse = (left / max(least, 1e-18) - 1) * freedom
    sigmas = np.where(worse < CLEARLY_WORSE, np.abs(aside) / np.sqrt(np.maximum(worse, 1e-3)), 0.0)
    return float(max(np.sqrt(variances[-1]), sigmas.max()))


def _sign(d: Vector, now: Vector, before: Vector) -> float:
    """+1 where the points came from the side that a displacement along d says, else -1."""
    towards = d[:2] - now[:, :2] * d[2]
    return 1.0 if ((before - now)[:, :2] * towards).sum() >= 0 else -1.0
