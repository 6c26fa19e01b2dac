"""The small rotation that is left in a pair, and the direction's error, from tracked corners.

A static point on the rays x1 (now) and x2 (before) obeys d . (x1 x R x2) = 0 with d the displacement and R the
rotation that no log reported (Hartley and Zisserman, 9.6). For a small one, R x2 = x2 + w x x2, this is linear:
d . (x1 x x2) + w . (d (x1 . x2) - x1 (d . x2)) = 0. Least squares with Cauchy weights, made linear anew where they
lead far, give w and two angles of d together; near them Geman and McClure's weights, which leave wrong tracks nothing
to say but would hold a wrong start. Where the points say little about one of them (flying sideways past things of one
depth looks like turning), a prior of small errors holds it near zero; turns may be large (Cauchy). Where what is left
tells of one, the bend of a rolling shutter (`rolling_shutter`) is found with them.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from flightdepth.camera import Camera
from flightdepth.epipolar import aside, lines, quick_median
from flightdepth.motion import Vector, rotation_angle_rad
from flightdepth.ranges.rolling_shutter import bent, rays_times

FEWEST_POINTS = 12
ROTATION_SIGMA_RAD = np.radians(0.3)  # what a gimbal and a log's attitude leave in a pair
LOG_SIGMA_RAD = np.radians(4)  # of a direction that a log and a camera's mount tell
SEEN_SIGMA_RAD = np.radians(10)  # of one seen in pictures that were taken not to turn
BEND_SIGMA_RAD = 0.01  # rows read within 20 ms, and a turn that changes by 30 degrees/s
MOST_STEPS = 15
STRAIGHT_RAD = np.radians(0.2)  # what is linear at the start stays so that far
CLOSE, CLOSE_ENOUGH = 1.0, 0.01  # squares of a deviation, and in the end of a tenth of one
CAUCHY = 2.0  # a point this many deviations off has half the weight
MCCLURE = 3.0, 2.0  # then, near the solution, one this many off has a quarter, and a wrong track next to none
LEAST_NOISE_PX = 0.05
# Neighbouring tracks err together: measured errors are this many times those of independent points.
TOGETHER = 2.3
# Errors of depth in rooms agree with this share of the deviations so told, wherever in the picture (docs/log.md).
SHARE = 0.5
# Beyond these nothing small is left to mend: the log or the tracks are of something else.
MOST_SIGMAS, MOST_RAD = 4.0, np.radians(5)
# Squared deviations (chi^2 of 3 and of 2 parameters, 95 %) from which on an error is taken out.
CLEAR_ROTATION, CLEAR_DIRECTION = 7.8, 6.0
# Of a bend so much: tracks of one row to the next err together less than TOGETHER. Smaller ones are what tracks through
# a long lens err by. Of 705 pairs without a bend 1 in 100 seems to have one (docs/log.md). What bends pictures turns
# them too: small ones of a camera that hardly turns are of what moves by itself, as waves do.
CLEAR_BEND, LEAST_BEND_RAD = 1.8, 0.0015
LEAST_TURNED_RAD = 0.006  # turn and bend together
NOT_TURNED = np.eye(3)
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
    bend        (3,) radians by which the rotation grows from the first row to the last; None where none is clear
    """

    rotation: Vector
    unit: Vector
    covariance: Vector
    off: Vector
    bend: Vector | None = None

    @property
    def turns(self) -> bool:
        """Whether the rotation stands out from its noise, of the middle row or of others."""
        return self.bend is not None or _squares(self.rotation, self.covariance[:3, :3]) > CLEAR_ROTATION

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

    def left_px(self, now: Vector, before: Vector, camera: Camera) -> float:
        """How far corners stay off their lines, on average, with this taken out; rays [N, 3] as for `remainder`."""
        turned = before @ cv2.Rodrigues(self.rotation)[0].T
        if self.bend is not None:
            turned = bent(turned, self.bend, rays_times(now, camera))
        return off_lines_px(now, turned / turned[:, 2:], self.unit, camera.fx)


def remainder(
    now: Vector,
    before: Vector,
    direction: Vector,
    camera: Camera,
    *,
    direction_sigma_rad: float = LOG_SIGMA_RAD,
    turn: Vector = NOT_TURNED,
    turned_rad: float = 0.0,
    bends: bool = True,
) -> Remainder | None:
    """From rays [N, 3] (z = 1) of an ideal pinhole's corners and the displacement's direction (3,), any length.

    `turn` (3, 3) is the known rotation that `before` was turned by already, `turned_rad` by how much the camera turned
    a moment ago, `bends` whether it may have a bend. None where points are few.
    """
    if len(now) < FEWEST_POINTS:
        return None
    corners = _Corners(now, before, direction / np.linalg.norm(direction), camera)
    sigmas = np.array([ROTATION_SIGMA_RAD] * 3 + [direction_sigma_rad] * 2 + [BEND_SIGMA_RAD] * 3)
    state, covariance = _fitted(corners, np.zeros(5), sigmas[:5])
    here_rad = rotation_angle_rad(cv2.Rodrigues(state[:3])[0] @ turn)
    least_rad = max(LEAST_BEND_RAD, LEAST_TURNED_RAD - max(here_rad, turned_rad))
    bend = None
    if bends and _bends(corners, straight := np.append(state, np.zeros(3)), sigmas, least_rad):
        state, covariance = _fitted(corners, straight, sigmas)
        bend = state[5:]
    return Remainder(state[:3], corners.direction(state), covariance[:5, :5], state[3:5], bend)


class _Corners:
    """A pair's corners, and where a state leaves them: a rotation vector, two angles of the direction, maybe a bend."""

    def __init__(self, now: Vector, before: Vector, given: Vector, camera: Camera) -> None:
        """Rays [N, 3] and the unit vector (3,) that the angles count from."""
        self._now, self._before, self._given = now, before, given
        self._around, self._focal_px, self._times = aside(given), camera.fx, rays_times(now, camera)

    def direction(self, state: Vector) -> Vector:
        """The unit vector (3,) that a state stands for."""
        tilted = self._given + self._around @ state[3:5]
        return np.asarray(tilted / np.linalg.norm(tilted))

    def lines_px(self, state: Vector) -> Vector:
        """`lines` in pixels for a state (5,); for one (8,) with three rows more before the last (9, 2 N)."""
        seen, bends = self._before @ cv2.Rodrigues(state[:3])[0].T, len(state) > 5
        if bends:
            seen = bent(seen, state[5:], self._times)
        rows = lines(self._now.T, seen.T / seen[:, 2], self.direction(state), self._around)
        if bends:
            rows = np.vstack([rows[:5], rows[:3] * np.tile(self._times, 2), rows[5:]])
        return self._focal_px * rows


def _fitted(corners: _Corners, state: Vector, sigmas: Vector) -> tuple[Vector, Vector]:
    """The state (n,) that explains the corners best, from another one on, and its covariance (n, n)."""
    step = np.zeros_like(state)  # from where the lines were made linear
    settled, widths = True, [None, *MCCLURE]
    for _ in range(MOST_STEPS):
        if settled:
            state, step = state + step, np.zeros_like(state)
            lines_px = corners.lines_px(state)
        information, pull = _held(lines_px, state, step, sigmas, widths[0])
        last, step = step, np.asarray(np.linalg.solve(information, -pull), dtype=np.float64)
        change, straight, near = step - last, np.abs(step).max() < STRAIGHT_RAD, len(widths) == 1
        settled = bool(change @ information @ change < (CLOSE_ENOUGH if straight and near else CLOSE))
        if settled and straight:
            if near:
                break
            widths.pop(0)
    return state + step, np.linalg.inv(information).astype(np.float64)


def _bends(corners: _Corners, state: Vector, sigmas: Vector, least_rad: float) -> bool:
    """Whether a bend beside a state (8,) that has none would be clear: by the step that leads to it (score test)."""
    information, pull = _held(corners.lines_px(state), state, np.zeros(8), sigmas, MCCLURE[0])
    covariance = np.linalg.inv(information).astype(np.float64)
    bend = -covariance[5:] @ pull
    large = bool(np.linalg.norm(bend) > least_rad)
    return large and _squares(bend, covariance[5:, 5:]) > CLEAR_BEND


def off_lines_px(now: Vector, before: Vector, unit: Vector, focal_px: float) -> float:
    """How far corners are off their lines, or moved against the parallax, on average; rays [N, 3] (z = 1)."""
    off, along = lines(now.T, before.T, unit, aside(unit))[5].reshape(2, -1)
    off_px = focal_px * np.hypot(off, np.minimum(along, 0))
    return float(np.minimum(off_px, MOST_OFF_PX).mean())


def _held(
    lines_px: Vector, state: Vector, step: Vector, sigmas: Vector, width: float | None
) -> tuple[Vector, Vector]:
    """`_normal_equations` at a step from a state (n,), with the prior."""
    information, pull = _normal_equations(lines_px, step, width)
    prior = _prior(state + step, sigmas)
    information.flat[:: len(state) + 1] += prior
    return information, pull + prior * state


def _normal_equations(lines_px: Vector, step: Vector, width: float | None) -> tuple[Vector, Vector]:
    """Matrix (n, n) and right side (n,) of `lines_px` (n + 1, 2 N), weighted by what a step (n,) leaves.

    A point that moved against the parallax has no depth at all, and counts by how far it did. A wrong track goes wrong
    both ways: one that is far off its line has as little to say of the parallax.
    """
    left_px = (lines_px[-1] + step @ lines_px[:-1]).reshape(2, -1)
    noise_px = max(1.4826 * quick_median(np.abs(left_px[0])), LEAST_NOISE_PX)
    against = left_px[1] < 0
    left_px[1] *= against
    weights = _weights((left_px**2).sum(axis=0) / noise_px**2, width) / (TOGETHER * noise_px) ** 2
    weights = np.concatenate([weights, weights * against])
    products = (lines_px[:-1] * weights) @ lines_px.T
    return np.ascontiguousarray(products[:, :-1]), products[:, -1]


def _weights(squares: Vector, width: float | None) -> Vector:
    """Weights of points by their squared deviations: Geman and McClure's of a width, without one Cauchy's."""
    return np.asarray(1 / (1 + squares / CAUCHY**2) if width is None else (1 + squares / width**2) ** -2)


def _prior(state: Vector, sigmas: Vector) -> Vector:
    """Weights (n,) of zero for a state of such deviations; less for a turn beyond them (Cauchy)."""
    far, weights = state[:3] / sigmas[:3], sigmas**-2.0
    weights[:3] /= 1 + far @ far
    return weights


def _squares(values: Vector, covariance: Vector) -> float:
    return float(values @ np.linalg.solve(covariance, values))
