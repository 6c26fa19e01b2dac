"""The rotation between two pictures, told apart from the flow that flying past near things causes.

Small motion (Longuet-Higgins and Prazdny 1980): a point at normalised (x, y) and depth Z moves by
flow = A(x, y) t / Z + B(x, y) w, with t the translation and w the rotation (rad, right-down-forward axes).
Perpendicular to A t nothing is left of the depth: n . flow = n . B w, linear in w for a given direction of t.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flightdepth.motion import Vector

COARSE_DIRECTIONS = 32
FINE_DIRECTIONS = 12
REFINEMENTS = (0.2, 0.06)  # radians around the best direction so far
ROUNDS = 3
STEADY_ROUNDS = 6
AS_GOOD = 1.2  # costs up to this ratio of the best one's explain the pictures as well


@dataclass(frozen=True, eq=False)
class Flow:
    """Motion of n points: where they are midway, normalised (x, y), and how far they moved, both [n, 2]."""

    points: Vector
    motions: Vector

    @classmethod
    def between(cls, before: Vector, after: Vector) -> Flow:
        """Flow of points at normalised coordinates `before` [n, 2] that are later at `after` [n, 2]."""
        return cls((before + after) / 2, after - before)


def smallest_rotation(flow: Flow, noise: float) -> Vector:
    """Rotation vector w (rad, [3]): the smallest of those that explain the flow as well as the best one does.

    `noise` is the tracking noise in normalised units. The smallest, because a narrow view can hardly tell
    turning from flying sideways, and a steady picture must not be called turning.
    """
    steady = steady_direction(flow, noise)
    directions = np.concatenate([_hemisphere(COARSE_DIRECTIONS), steady[None]])
    rotations, costs = _rotations(flow, directions, noise)
    for radius in REFINEMENTS:
        fine = _around(directions[int(np.argmin(costs))], radius)
        fine_rotations, fine_costs = _rotations(flow, fine, noise)
        directions = np.concatenate([directions, fine])
        rotations = np.concatenate([rotations, fine_rotations])
        costs = np.concatenate([costs, fine_costs])
    rotations = np.concatenate([rotations, np.zeros((1, 3))])
    costs = np.append(costs, steady_cost(flow, steady, noise))
    good = rotations[costs <= AS_GOOD * costs.min() + 0.02]
    smallest: Vector = good[int(np.argmin(np.linalg.norm(good, axis=1)))]
    return smallest


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


def steady_cost(flow: Flow, direction: Vector, noise: float) -> float:
    """Robust mean cost of the flow where nothing turns and t has this direction."""
    normal_x, normal_y = _normals(flow.points, direction[None])
    left = normal_x * flow.motions[:, 0] + normal_y * flow.motions[:, 1]
    return float(np.log1p((left / noise) ** 2).mean())


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


def _normals(points: Vector, directions: Vector) -> tuple[Vector, Vector]:
    """Unit vectors perpendicular to A t for m directions and n points: x and y parts, each [m, n]."""
    tx, ty, tz = (part[:, None] for part in directions.T)
    move_x, move_y = points[:, 0] * tz - tx, points[:, 1] * tz - ty
    length = np.maximum(np.sqrt(move_x * move_x + move_y * move_y), 1e-3)  # hypot takes five times as long
    return -move_y / length, move_x / length


def _hemisphere(count: int) -> Vector:
    """Directions spread evenly over the half with z > 0 (t and -t give the same equations)."""
    step = np.arange(count) + 0.5
    z = step / count
    angle = step * np.pi * (3 - np.sqrt(5))
    ring = np.sqrt(1 - z * z)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)


def _around(direction: Vector, radius: float) -> NDArray[np.float64]:
    """Directions within about `radius` radians of one, in two rings."""
    helper = np.eye(3)[int(np.argmin(np.abs(direction)))]
    side = _cross(direction, helper)
    side /= np.linalg.norm(side)
    up = _cross(direction, side)
    angle = np.arange(FINE_DIRECTIONS) * 2 * np.pi / FINE_DIRECTIONS
    reach = radius * np.where(np.arange(FINE_DIRECTIONS) % 2, 1.0, 0.5)[:, None]
    near = direction + reach * (np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * up)
    return np.asarray(near / np.linalg.norm(near, axis=1, keepdims=True))


def _cross(a: Vector, b: Vector) -> Vector:
    """`np.cross` of two vectors (3,) takes ten times as long."""
    (ax, ay, az), (bx, by, bz) = a, b
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
