"""The small rotation that is left in a pair, and the direction's error, from tracked corners; and taking them out.

A static point on the rays x1 (now) and x2 (before) obeys d . (x1 x R x2) = 0 with d the displacement and R the
rotation that no log reported (Hartley and Zisserman, 9.6). For a small one, R x2 = x2 + w x x2, this is linear:
d . (x1 x x2) + w . (d (x1 . x2) - x1 (d . x2)) = 0. Least squares with Cauchy weights, made linear anew where they
lead far, give w and two angles of d together. Where the points say little about one of them (flying sideways past
things of one depth looks like turning), a prior of small errors holds it near zero.
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
from flightdepth.ranges.tracks import Tracker, in_grey, tracked_rays
from flightdepth.ranges.turning import is_visible, turned

Vector = NDArray[np.float64]

FEWEST_POINTS = 12
ROTATION_SIGMA_RAD = np.radians(0.3)  # what a gimbal and a log's attitude leave in a pair
LOG_SIGMA_RAD = np.radians(4)  # of a direction that a log and a camera's mount tell
SEEN_SIGMA_RAD = np.radians(10)  # of one seen in pictures that were taken not to turn
MOST_LINEARISATIONS, MOST_WEIGHINGS = 5, 10
STRAIGHT_RAD = np.radians(0.2)  # what is linear at the start stays so that far
CLOSE_ENOUGH = 0.01  # the square of a tenth of a deviation
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
# The matrix of e_k x ... for each axis, (3, 3, 3).
CROSS = np.stack([np.cross(axis, np.eye(3)).T for axis in np.eye(3)])


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
            return self._tracker.rays(turned(in_grey(image), turn, self._camera), current.image)
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
    for _ in range(MOST_LINEARISATIONS):
        seen = np.asarray(cv2.Rodrigues(state[:3])[0] @ before.T)
        lines_px = focal_px * _lines(now.T, seen / seen[2], _tilted(given, aside, state[3:]), aside)
        step, information = _least_squares(lines_px, prior, state)
        state = state + step
        if np.abs(step).max() < STRAIGHT_RAD:
            break
    covariance: Vector = np.linalg.inv(information).astype(np.float64)
    unit = _tilted(given, aside, state[3:])
    return Remainder(state[:3], unit, covariance * TOGETHER**2, state[3:], len(now))


def _least_squares(lines_px: Vector, prior: Vector, state: Vector) -> tuple[Vector, Vector]:
    """The step (5,) from a state (5,), and its information matrix (5, 5), of `_lines` in pixels (6, 2 N).

    A point that moved against the parallax has no depth at all, and counts by how far it did.
    """
    columns, off_px, points = lines_px[:5], lines_px[5], lines_px.shape[1] // 2
    left_px, step = off_px, np.zeros(5)
    for _ in range(MOST_WEIGHINGS):
        noise_px = max(1.4826 * _median(np.abs(left_px[:points])), LEAST_NOISE_PX)
        weights = 1 / (noise_px**2 + (left_px / CAUCHY) ** 2)
        weights[points:] *= left_px[points:] < 0
        weighted = columns * weights
        information = weighted @ columns.T + np.diag(prior)
        last, step = step, np.linalg.solve(information, -weighted @ off_px - prior * state)
        if (step - last) @ information @ (step - last) < CLOSE_ENOUGH:
            break
        left_px = off_px + step @ columns
    return step, information


def _lines(now: Vector, before: Vector, unit: Vector, aside: Vector) -> Vector:
    """Points' distances from their epipolar lines, then how far along them they moved, on the plane z = 1 (6, 2 N).

    The rows: what three turns and two angles of the direction add to the distance, and the distance.
    """
    towards = unit[:2, None] - now[:2] * unit[2]
    reach = np.maximum(np.hypot(*towards), NEAREST_TO_FOCUS)
    products = (before[:, None] * now).reshape(9, -1)
    return np.hstack([_forms(unit, aside) @ products / reach, _along(now, before, towards / reach)])


def _forms(unit: Vector, aside: Vector) -> Vector:
    """Matrices M, flat (6, 9): before . M now is a point's row of `_lines`, but for the reach.

    M = [d]x for the distance, [e_k]x^T [d]x for a turn about axis k.
    """
    across = (np.vstack([aside.T, unit]) @ CROSS.reshape(3, 9)).reshape(3, 3, 3)
    return np.concatenate([-CROSS @ across[2], across]).reshape(6, 9)


def _along(now: Vector, before: Vector, along: Vector) -> Vector:
    """How far points moved along their lines the way that a depth allows, and what turns add to it (6, N)."""
    (x, y), (along_x, along_y) = before[:2], along
    moved = (x - now[0]) * along_x + (y - now[1]) * along_y
    # What a rotation adds to x and to y of a ray with z = 1: (w x ray) brought back to z = 1.
    about_x = -x * y * along_x - (1 + y * y) * along_y
    about_y = (1 + x * x) * along_x + x * y * along_y
    about_z = x * along_y - y * along_x
    nothing = np.zeros_like(x)
    return np.stack([about_x, about_y, about_z, nothing, nothing, moved])


def _median(values: Vector) -> float:
    """The upper one of an even number; `np.median` takes ten times as long."""
    middle = len(values) // 2
    return float(np.partition(values, middle)[middle])


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
