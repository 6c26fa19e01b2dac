"""The rotation between two pictures, told apart from the flow that flying past near things causes.

Small motion (Longuet-Higgins and Prazdny 1980): a point at normalised (x, y) and depth Z moves by
flow = A(x, y) t / Z + B(x, y) w, with t the translation and w the rotation (rad, right-down-forward axes).
Perpendicular to A t nothing is left of the depth: n . flow = n . B w, linear in w for a given direction of t; along
A t a point with a depth moves forward only. Directions spread over the sphere tell where to start; from the best of
them w and the direction are found together, by least squares with the weights of Geman and McClure (1987), since
beside near things a direction that is off by two degrees leaves as much as a turn of half a degree does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from flightdepth.camera import Camera
from flightdepth.epipolar import LEAST_REACH, aside
from flightdepth.motion import Vector
from flightdepth.runtimes.lens import undistort

COARSE_DIRECTIONS = 32
ROUNDS = 2
STEADY_ROUNDS = 6
STARTS = 3  # of these directions, beside the one in which nothing turns
STEPS = 8
LONGEST_STEP_RAD = 0.5  # of the direction
# A turn within a pair that is as likely as not; larger ones are rarer, not ruled out (Cauchy). A narrow view can
# hardly tell turning from flying sideways, and a steady picture must not be called turning.
USUAL_TURN_RAD = 0.005
TOGETHER = 1.5  # neighbouring points err together, by so many times as much as as many independent ones
OUTLIER = 2.0  # noises; points farther off than some of them count alike, so that what moves by itself has little say
ANY_DIRECTION = 1e-3  # weight that holds a direction of which points tell nothing, 1 / radians^2


@dataclass(frozen=True, eq=False)
class Flow:
    """Motion of n points: where they are midway, normalised (x, y), and how far they moved, both [n, 2]."""

    points: Vector
    motions: Vector

    @classmethod
    def between(cls, before: Vector, after: Vector, camera: Camera) -> Flow:
        """Flow of points at pixels `before` [n, 2] of a camera that are later at `after` [n, 2]."""
        start, end = undistort(before, camera), undistort(after, camera)
        return cls((start + end) / 2, end - start)


class _Motion(NamedTuple):
    """m motions that might explain a flow: rotation vectors [m, 3] (rad) and unit directions of t [m, 3]."""

    turns: Vector
    directions: Vector


def likeliest_rotation(flow: Flow, noise: float) -> Vector:
    """Rotation vector w (rad, [3]) that explains the flow best, together with some direction of t.

    `noise` is the tracking noise in normalised units. Where turning and flying explain the flow alike it is small.
    """
    return likeliest_motion(flow, noise)[0]


def likeliest_motion(flow: Flow, noise: float) -> tuple[Vector, Vector]:
    """That rotation vector and the direction of t, a unit vector [3], forward along what moves."""
    steady = steady_direction(flow, noise)
    directions = np.concatenate([_hemisphere(COARSE_DIRECTIONS), steady[None]])
    turns, costs = _rotations(flow, directions, noise)
    best = np.argsort(costs)[:STARTS]
    turns = np.concatenate([turns[best], np.zeros((1, 3))])
    motion = _forward(flow, _Motion(turns, np.concatenate([directions[best], steady[None]])))
    for _ in range(STEPS):
        motion = _improved(flow, motion, noise)
    likeliest = int(np.argmin(_costs(flow, motion, noise)))
    return motion.turns[likeliest], motion.directions[likeliest]


def steady_direction(flow: Flow, noise: float) -> Vector:
    """The direction of t [3] that explains the flow best without rotation: t . (ray x flow) = 0 everywhere.

    Each point's equation is divided by how much of t it can see, so that the residual is in normalised units.
    """
    (x, y), (move_x, move_y) = flow.points.T, flow.motions.T
    planes = np.stack([-move_y, move_x, x * move_y - y * move_x], axis=1)  # ray x flow
    scale: Vector = np.ones(len(planes))
    for _ in range(STEADY_ROUNDS):
        scaled = planes * scale[:, None]
        direction = np.asarray(np.linalg.eigh(scaled.T @ scaled)[1][:, 0], dtype=np.float64)
        normal_x, normal_y = _normals(flow.points, direction[None])
        left = (normal_x * flow.motions[:, 0] + normal_y * flow.motions[:, 1])[0]
        sight = np.linalg.norm(flow.points * direction[2] - direction[:2], axis=1)
        scale = 1 / (np.maximum(sight, 1e-2) * np.sqrt(1 + (left / noise) ** 2))
    return direction


def rotation_flow(points: Vector) -> tuple[Vector, Vector]:
    """Rows of B for points [n, 2]: what w adds to the x and to the y of their flow, each [n, 3]."""
    x, y = points.T
    along_x = np.stack([x * y, -(1 + x * x), y], axis=1)
    along_y = np.stack([1 + y * y, -x * y, -x], axis=1)
    return along_x, along_y


def _rotations(flow: Flow, directions: Vector, noise: float) -> tuple[Vector, Vector]:
    """For directions of t [m, 3]: best w [m, 3] and its robust (Cauchy) mean cost [m]."""
    along_x, along_y = rotation_flow(flow.points)
    normal_x, normal_y = _normals(flow.points, directions)
    seen = normal_x * flow.motions[:, 0] + normal_y * flow.motions[:, 1]
    # What w adds along each point's normal, [m, 3, n].
    rows = normal_x[:, None] * along_x.T + normal_y[:, None] * along_y.T
    weights: Vector = np.ones_like(seen)
    for _ in range(ROUNDS):
        weighted = rows * weights[:, None]
        # The ridge keeps w at 0 where the points say nothing about it.
        regular = weighted @ rows.transpose(0, 2, 1) + 1e-9 * np.eye(3)
        rotations = np.asarray(np.linalg.solve(regular, weighted @ seen[..., None]), dtype=np.float64)
        left = seen - (rotations.transpose(0, 2, 1) @ rows)[:, 0]
        squares = np.square(left / noise)
        weights = 1 / (1 + squares)
    return rotations[..., 0], np.log1p(squares).mean(axis=1)


def _forward(flow: Flow, motion: _Motion) -> _Motion:
    """The same with each direction's sign such that most of what moves along it does so forward."""
    _, along, _ = _left(flow, motion)
    back = along.sum(axis=1, keepdims=True) < 0
    return motion._replace(directions=np.where(back, -motion.directions, motion.directions))


def _improved(flow: Flow, motion: _Motion, noise: float) -> _Motion:
    """A step of Gauss-Newton, whose normal equations are (5, 5): the turn, two angles of the direction."""
    off, along, (moved, ahead, reach) = _left(flow, motion)
    (x, y), (along_x, along_y) = flow.points.T, rotation_flow(flow.points)
    right, down = ahead[0] / reach, ahead[1] / reach
    around = np.stack([aside(each) for each in motion.directions])
    planes = np.stack([-moved[1], moved[0], x * moved[1] - y * moved[0]], axis=1) / reach[:, None]
    rows = np.zeros((len(off), 5, 2 * len(x)))
    rows[:, :3, : len(x)] = down[:, None] * along_x.T - right[:, None] * along_y.T
    rows[:, 3:, : len(x)] = around.transpose(0, 2, 1) @ planes
    rows[:, :3, len(x) :] = -right[:, None] * along_x.T - down[:, None] * along_y.T
    left = np.concatenate([off, np.minimum(along, 0)], axis=1)
    weights = 1 / (noise * (1 + np.square(left / (OUTLIER * noise)))) ** 2
    weights[:, len(x) :] *= along < 0
    weighted = rows * (weights / TOGETHER**2)[:, None]
    prior = 1 / (USUAL_TURN_RAD**2 + np.square(motion.turns).sum(axis=1, keepdims=True))
    information = weighted @ rows.transpose(0, 2, 1)
    information[:, range(3), range(3)] += prior
    information[:, range(3, 5), range(3, 5)] += ANY_DIRECTION
    pull = (weighted @ left[..., None])[..., 0]
    pull[:, :3] += prior * motion.turns
    step = -np.linalg.solve(information, pull[..., None])[..., 0]
    far = np.linalg.norm(step[:, 3:], axis=1, keepdims=True) / LONGEST_STEP_RAD
    step /= np.maximum(far, 1)
    tilted = motion.directions + (around @ step[:, 3:, None])[..., 0]
    return _Motion(motion.turns + step[:, :3], tilted / np.linalg.norm(tilted, axis=1, keepdims=True))


def _costs(flow: Flow, motion: _Motion, noise: float) -> Vector:
    """What `_improved` makes least of each motion, [m]: squared deviations of points, bounded, and of the turn."""
    off, along, _ = _left(flow, motion)
    squares = np.square(np.concatenate([off, np.minimum(along, 0)], axis=1) / (OUTLIER * noise))
    unusual = np.log1p(np.square(motion.turns / USUAL_TURN_RAD).sum(axis=1))
    return np.asarray((OUTLIER / TOGETHER) ** 2 * (squares / (1 + squares)).sum(axis=1) + unusual)


def _left(flow: Flow, motion: _Motion) -> tuple[Vector, Vector, tuple[Vector, Vector, Vector]]:
    """What m turns leave of the flow of n points across the lines of flight, and along them, forward, each [m, n].

    Then that flow itself [2, m, n], A t [2, m, n] and its length, at least LEAST_REACH, [m, n].
    """
    along_x, along_y = rotation_flow(flow.points)
    turned = np.stack([motion.turns @ along_x.T, motion.turns @ along_y.T])
    moved = flow.motions.T[:, None] - turned
    ahead, reach = _ahead(flow.points, motion.directions, LEAST_REACH)
    off = (ahead[0] * moved[1] - ahead[1] * moved[0]) / reach
    along = (ahead * moved).sum(axis=0) / reach
    return off, along, (moved, ahead, reach)


def _normals(points: Vector, directions: Vector) -> tuple[Vector, Vector]:
    """Unit vectors perpendicular to A t for m directions and n points: x and y parts, each [m, n]."""
    (move_x, move_y), length = _ahead(points, directions, 1e-3)
    return -move_y / length, move_x / length


def _ahead(points: Vector, directions: Vector, nearest: float) -> tuple[Vector, Vector]:
    """A t for m directions at n points, [2, m, n], and its length, at least `nearest`, [m, n]."""
    tx, ty, tz = directions.T[..., None]
    ahead = np.stack([points[:, 0] * tz - tx, points[:, 1] * tz - ty])
    squared = ahead[0] * ahead[0] + ahead[1] * ahead[1]
    return ahead, np.maximum(np.sqrt(squared), nearest)  # hypot takes five times as long


def _hemisphere(count: int) -> Vector:
    """Directions spread evenly over the half with z > 0 (t and -t give the same equations)."""
    step = np.arange(count) + 0.5
    z = step / count
    angle = step * np.pi * (3 - np.sqrt(5))
    ring = np.sqrt(1 - z * z)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)
