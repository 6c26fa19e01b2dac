"""The small rotation that is left in a pair, and the direction's error, from tracked corners; and taking them out.

A static point on the rays x1 (now) and x2 (before) obeys d . (x1 x R x2) = 0 with d the displacement and R the
rotation that no log reported (Hartley and Zisserman, 9.6). For a small one, R x2 = x2 + w x x2, this is linear:
d . (x1 x x2) + w . (d (x1 . x2) - x1 (d . x2)) = 0. A few Gauss-Newton steps with Cauchy weights give w and two
angles of d together. Where the points say little about one of them (flying sideways past things of one depth
looks like turning), a prior of small errors holds it near zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.motion import rotation_angle_rad
from flightdepth.ranges.direction import direction_of
from flightdepth.ranges.network import Image
from flightdepth.ranges.pairs import Frame, Pair
from flightdepth.ranges.tracks import Tracker, tracked_rays
from flightdepth.ranges.turning import is_visible, turned

Vector = NDArray[np.float64]

FEWEST_POINTS = 12
ROTATION_SIGMA_RAD = np.radians(0.3)  # what a gimbal and a log's attitude leave in a pair
LOG_SIGMA_RAD = np.radians(4)  # of a direction that a log and a camera's mount tell
SEEN_SIGMA_RAD = np.radians(10)  # of one seen in pictures that were taken not to turn
STEPS = 15  # 4 degrees need as many, a tenth of a degree needs 5
CLOSE_ENOUGH_RAD = 2e-5
CAUCHY = 2.0  # a point this many deviations off has half the weight
LEAST_NOISE_PX = 0.05
NEAREST_TO_FOCUS = (
    0.1  # closer to the focus of expansion than this, on the plane z = 1, a line has no direction
)
# Neighbouring tracks err together: measured errors are this many times those of independent points.
TOGETHER = 2.5
# Beyond these nothing small is left to mend: the log or the tracks are of something else.
MOST_SIGMAS, MOST_RAD = 4.0, np.radians(5)
# Squared deviations (chi^2 of 3 and of 2 parameters, 95 %) from which on an error is taken out.
CLEAR_ROTATION, CLEAR_DIRECTION = 7.8, 6.0


@dataclass(frozen=True, eq=False)
class Remainder:
    """What the reported motion of a pair leaves unexplained.

    rotation    (3,) radians: exp(rotation) turns rays of the earlier picture into the current orientation
    unit        (3,) direction of the displacement, mended
    covariance  (5, 5) of rotation and of two angles of `unit`, radians^2
    off         (2,) those angles, from the direction given
    points      tracked corners that it comes from
    """

    rotation: Vector
    unit: Vector
    covariance: Vector
    off: Vector
    points: int

    @property
    def turns(self) -> bool:
        """Whether the rotation stands out from its noise."""
        return _squares(self.rotation, self.covariance[:3, :3]) > CLEAR_ROTATION

    @property
    def heads_elsewhere(self) -> bool:
        """Whether the direction's error does."""
        return _squares(self.off, self.covariance[3:, 3:]) > CLEAR_DIRECTION

    def is_small(self, direction_sigma_rad: float) -> bool:
        """Whether it can be what a log and a gimbal leave."""
        near = float(np.linalg.norm(self.off)) < MOST_SIGMAS * direction_sigma_rad
        return near and float(np.linalg.norm(self.rotation)) < MOST_RAD


class Derotation:
    """Takes out of each pair what its two pictures show of unreported motion."""

    def __init__(self, camera: Camera, tracker: Tracker) -> None:
        self._camera, self._tracker = camera, tracker

    def of(self, pairs: Sequence[Pair], current: Frame, *, seen: bool) -> tuple[Pair, ...]:
        """The pairs with rotation and direction mended; `seen`: the pictures told the direction where no log did."""
        return tuple(self._without_remainder(pair, current, seen=seen) for pair in pairs)

    def _without_remainder(self, pair: Pair, current: Frame, *, seen: bool) -> Pair:
        now, before = self._rays(pair, current)
        known = pair.directed or seen
        direction = pair.displacement_m if known else self._direction(now, before)
        if direction is None:
            return pair
        sigma_rad = LOG_SIGMA_RAD if pair.directed else SEEN_SIGMA_RAD
        left = remainder(now, before, direction, self._camera.fx, direction_sigma_rad=sigma_rad)
        if left is None or not left.is_small(sigma_rad):
            return pair
        pair = turned_by(pair, left.rotation) if left.turns else pair
        wrong = known and left.heads_elsewhere
        return replace(pair, displacement_m=left.unit * pair.length_m) if wrong else pair

    def _direction(self, now: Vector, before: Vector) -> Vector | None:
        found = direction_of(now, before, self._camera.fx)
        return None if found is None else found.unit

    def _rays(self, pair: Pair, current: Frame) -> tuple[Vector, Vector]:
        """Rays [N, 3] of corners now, and before in the current orientation as far as that is reported."""
        turn, image = pair.current_from_previous, pair.previous.image
        if is_visible(pair.turn_rad, self._camera):
            return self._tracker.rays(turned(image, turn, self._camera), current.image)
        now, before = self._tracker.rays(image, current.image)
        return now, before @ turn.T


def derotated(previous: Image, current: Image, displacement: Vector, camera: Camera) -> tuple[Image, Vector]:
    """One pair of an ideal pinhole with the clear errors of its motion taken out: `previous` and displacement (3,)."""
    left = remainder(*tracked_rays(previous, current, camera), displacement, camera.fx)
    if left is None or not left.is_small(LOG_SIGMA_RAD):
        return previous, displacement
    if left.turns:
        previous = turned(previous, np.asarray(cv2.Rodrigues(left.rotation)[0]), camera)
    return previous, left.unit * np.linalg.norm(displacement) if left.heads_elsewhere else displacement


def turned_by(pair: Pair, rotation: Vector) -> Pair:
    """The pair with a rotation vector (3,) on top of the one that is known."""
    turn = np.asarray(cv2.Rodrigues(rotation)[0] @ pair.current_from_previous)
    return replace(pair, current_from_previous=turn, turn_rad=rotation_angle_rad(turn))


def remainder(
    now: Vector,
    before: Vector,
    direction: Vector,
    focal_px: float,
    *,
    direction_sigma_rad: float = LOG_SIGMA_RAD,
) -> Remainder | None:
    """From rays [N, 3] (z = 1) and the displacement's direction (3,), any length; None where points are few."""
    if len(now) < FEWEST_POINTS:
        return None
    given = direction / np.linalg.norm(direction)
    aside = _aside(given)
    prior = 1 / np.array([ROTATION_SIGMA_RAD] * 3 + [direction_sigma_rad] * 2) ** 2
    state = np.zeros(5)  # the rotation vector, and the direction's two angles
    for _ in range(STEPS):
        unit = _tilted(given, aside, state[3:])
        seen = before @ cv2.Rodrigues(state[:3])[0].T
        seen = seen / seen[:, 2:]
        matrix, side = _normal_equations(now, seen, unit, aside, focal_px)
        covariance: Vector = np.linalg.inv(matrix + np.diag(prior)).astype(np.float64)
        step = covariance @ (side - prior * state)
        state = state + step
        if np.abs(step).max() < CLOSE_ENOUGH_RAD:
            break
    unit = _tilted(given, aside, state[3:])
    return Remainder(state[:3], unit, covariance * TOGETHER**2, state[3:], len(now))


def _normal_equations(
    now: Vector, before: Vector, unit: Vector, aside: Vector, focal_px: float
) -> tuple[Vector, Vector]:
    """Information matrix (5, 5) and right side (5,) of the points' distances from their epipolar lines.

    A point that moved against the parallax has no depth at all, and counts by how far it did.
    """
    towards = unit[:2] - now[:, :2] * unit[2]
    reach = np.maximum(np.hypot(*towards.T), NEAREST_TO_FOCUS)
    planes = np.cross(now, before)
    off_px = planes @ unit / reach * focal_px
    turn_rows = unit * (now * before).sum(axis=1, keepdims=True) - now * (before @ unit)[:, None]
    rows = np.hstack([turn_rows, planes @ aside]) / reach[:, None] * focal_px
    noise_px = max(1.4826 * float(np.median(np.abs(off_px))), LEAST_NOISE_PX)
    against_px, against_rows = _against_parallax(now, before, towards / reach[:, None], focal_px)
    rows, off_px = np.vstack([rows, against_rows]), np.concatenate([off_px, against_px])
    weights = 1 / (1 + (off_px / (CAUCHY * noise_px)) ** 2) / noise_px**2
    weighted = rows * weights[:, None]
    return weighted.T @ rows, -weighted.T @ off_px


def _against_parallax(now: Vector, before: Vector, along: Vector, focal_px: float) -> tuple[Vector, Vector]:
    """How far points moved along their lines [M] the way that no depth allows, and the rows (M, 5) for it."""
    moved_px = ((before - now)[:, :2] * along).sum(axis=1) * focal_px
    wrong = moved_px < 0
    x, y = before[wrong, :2].T
    # What a rotation adds to x and to y of a ray with z = 1: (w x ray) brought back to z = 1.
    along_x = np.stack([-x * y, 1 + x * x, -y], axis=1)
    along_y = np.stack([-(1 + y * y), x * y, x], axis=1)
    turn_rows = (along_x * along[wrong, :1] + along_y * along[wrong, 1:]) * focal_px
    return moved_px[wrong], np.hstack([turn_rows, np.zeros((len(turn_rows), 2))])


def _aside(unit: Vector) -> Vector:
    """Two unit vectors perpendicular to one and to each other, columns (3, 2)."""
    first = np.cross(unit, np.eye(3)[int(np.argmin(np.abs(unit)))])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(unit, first)], axis=1)


def _tilted(unit: Vector, aside: Vector, angles: Vector) -> Vector:
    tilted = unit + aside @ angles
    return np.asarray(tilted / np.linalg.norm(tilted))


def _squares(values: Vector, covariance: Vector) -> float:
    return float(values @ np.linalg.solve(covariance, values))
