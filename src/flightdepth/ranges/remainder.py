"""The small rotation that is left in a pair, and the direction's error, from tracked corners.

A static point on the rays x1 (now) and x2 (before) obeys d . (x1 x R x2) = 0 with d the displacement and R the
rotation that no log reported (Hartley and Zisserman, 9.6). For a small one, R x2 = x2 + w x x2, this is linear:
d . (x1 x x2) + w . (d (x1 . x2) - x1 (d . x2)) = 0. Least squares with Cauchy weights, made linear anew where they
lead far, give w and two angles of d together; near them Geman and McClure's weights, which leave wrong tracks nothing
to say but would hold a wrong start. Where the points say little about one of them (flying sideways past things of one
depth looks like turning), a prior of small errors holds it near zero; turns may be large (Cauchy).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from flightdepth.epipolar import aside, lines, quick_median
from flightdepth.motion import Vector

FEWEST_POINTS = 12
ROTATION_SIGMA_RAD = np.radians(0.3)  # what a gimbal and a log's attitude leave in a pair
LOG_SIGMA_RAD = np.radians(4)  # of a direction that a log and a camera's mount tell
SEEN_SIGMA_RAD = np.radians(10)  # of one seen in pictures that were taken not to turn
MOST_STEPS = 15
STRAIGHT_RAD = np.radians(0.2)  # what is linear at the start stays so that far
CLOSE, CLOSE_ENOUGH = 1.0, 0.01  # squares of a deviation, and of a tenth of one
CAUCHY = 2.0  # a point this many deviations off has half the weight
MCCLURE = 3.0  # near the solution one this many off has a quarter, and a wrong track next to none
LEAST_NOISE_PX = 0.05
# Neighbouring tracks err together: measured errors are this many times those of independent points.
TOGETHER = 2.5
# Errors of depth in rooms agree with this share of the deviations so told, wherever in the picture (docs/log.md).
SHARE = 0.5
# Beyond these nothing small is left to mend: the log or the tracks are of something else.
MOST_SIGMAS, MOST_RAD = 4.0, np.radians(5)
# Squared deviations (chi^2 of 3 and of 2 parameters, 95 %) from which on an error is taken out.
CLEAR_ROTATION, CLEAR_DIRECTION = 7.8, 6.0
# Corners off their lines: right motions leave 0.1 to 0.25 px on average, wrong ones 0.3 to 1.
MOST_OFF_PX = 1.0  # a corner counts for, at most
LEFT_SHARE = 0.6  # a motion is the better one where it leaves less than this share of what another does


@dataclass(frozen=True, eq=False)
class Remainder:
    """What the reported motion of a pair leaves unexplained.

    rotation    (3,) radians: exp(rotation) turns rays of the earlier picture into the current orientation
    unit        (3,) direction of the displacement, mended
    covariance  (5, 5) of rotation and of two angles of `unit`, radians^2
    off         (2,) those angles, from the direction given
    """

    rotation: Vector
    unit: Vector
    covariance: Vector
    off: Vector

    @property
    def turns(self) -> bool:
        """Whether the rotation stands out from its noise."""
        return _squares(self.rotation, self.covariance[:3, :3]) > CLEAR_ROTATION

    @property
    def heads_elsewhere(self) -> bool:
        """Whether the direction's error does."""
        return _squares(self.off, self.covariance[3:, 3:]) > CLEAR_DIRECTION

    def left_open(self, *, turned_back: bool, redirected: bool) -> Vector:
        """Covariance (6, 6) of what stays off in rotation (3,) and direction (3,), a unit vector.

        What was found and not taken out is off by itself, beside what tracks can't tell.
        """
        kept = np.concatenate([(not turned_back) * self.rotation, (not redirected) * self.off])
        both = np.zeros((6, 5))
        both[:3, :3], both[3:, 3:] = np.eye(3), aside(self.unit)
        return np.asarray(both @ (SHARE**2 * self.covariance + np.outer(kept, kept)) @ both.T)

    def is_small(self, direction_sigma_rad: float) -> bool:
        """Whether it can be what a log and a gimbal leave."""
        near = float(np.linalg.norm(self.off)) < MOST_SIGMAS * direction_sigma_rad
        return near and float(np.linalg.norm(self.rotation)) < MOST_RAD

    def left_px(self, now: Vector, before: Vector, focal_px: float) -> float:
        """How far corners stay off their lines, on average, with this taken out; rays [N, 3] as for `remainder`."""
        turned = before @ cv2.Rodrigues(self.rotation)[0].T
        return off_lines_px(now, turned / turned[:, 2:], self.unit, focal_px)


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
    around = aside(given)
    usual = np.array([ROTATION_SIGMA_RAD] * 3 + [direction_sigma_rad] * 2)
    # The rotation vector and the direction's two angles: where they were made linear, and the step from there.
    state: Vector = np.zeros(5)
    step: Vector = np.zeros(5)
    settled, near = True, False
    for _ in range(MOST_STEPS):
        if settled:
            state, step = state + step, np.zeros(5)
            seen = cv2.Rodrigues(state[:3])[0] @ before.T
            lines_px = focal_px * lines(now.T, seen / seen[2], _tilted(given, around, state[3:]), around)
        information, pull = _normal_equations(lines_px, step, near=near)
        prior = _prior(state + step, usual)
        information.flat[::6] += prior
        last, step = step, np.asarray(np.linalg.solve(information, -pull - prior * state), dtype=np.float64)
        change, straight = step - last, np.abs(step).max() < STRAIGHT_RAD
        settled = bool(change @ information @ change < (CLOSE_ENOUGH if straight else CLOSE))
        if settled and straight:
            if near:
                break
            near = True
    state = state + step
    covariance: Vector = np.linalg.inv(information).astype(np.float64)
    unit = _tilted(given, around, state[3:])
    return Remainder(state[:3], unit, covariance, state[3:])


def off_lines_px(now: Vector, before: Vector, unit: Vector, focal_px: float) -> float:
    """How far corners are off their lines, or moved against the parallax, on average; rays [N, 3] (z = 1)."""
    off, along = lines(now.T, before.T, unit, aside(unit))[5].reshape(2, -1)
    off_px = focal_px * np.hypot(off, np.minimum(along, 0))
    return float(np.minimum(off_px, MOST_OFF_PX).mean())


def _normal_equations(lines_px: Vector, step: Vector, *, near: bool) -> tuple[Vector, Vector]:
    """Matrix (5, 5) and right side (5,) of `lines` in pixels (6, 2 N), weighted by what a step leaves.

    A point that moved against the parallax has no depth at all, and counts by how far it did. A wrong track goes wrong
    both ways: one that is far off its line has as little to say of the parallax.
    """
    left_px = (lines_px[5] + step @ lines_px[:5]).reshape(2, -1)
    noise_px = max(1.4826 * quick_median(np.abs(left_px[0])), LEAST_NOISE_PX)
    against = left_px[1] < 0
    left_px[1] *= against
    weights = _weights((left_px**2).sum(axis=0) / noise_px**2, near=near) / (TOGETHER * noise_px) ** 2
    weights = np.concatenate([weights, weights * against])
    products = (lines_px[:5] * weights) @ lines_px.T
    return np.ascontiguousarray(products[:, :5]), products[:, 5]


def _weights(squares: Vector, *, near: bool) -> Vector:
    """Weights of points by their squared deviations: Cauchy's, near the solution Geman and McClure's."""
    return np.asarray((1 + squares / MCCLURE**2) ** -2 if near else 1 / (1 + squares / CAUCHY**2))


def _prior(state: Vector, usual: Vector) -> Vector:
    """Weights (5,) of zero for a state whose deviations are `usual`; less for a turn beyond them (Cauchy)."""
    far = state[:3] / usual[:3]
    return np.asarray(usual**-2.0 / np.repeat([1 + far @ far, 1], [3, 2]))


def _tilted(unit: Vector, around: Vector, angles: Vector) -> Vector:
    tilted = unit + around @ angles
    return np.asarray(tilted / np.linalg.norm(tilted))


def _squares(values: Vector, covariance: Vector) -> float:
    return float(values @ np.linalg.solve(covariance, values))
