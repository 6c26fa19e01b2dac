"""Where points of a rigid scene leave their epipolar lines when a motion is a little off.

A static point on the rays x1 (now) and x2 (before) obeys d . (x1 x x2) = 0 with d the displacement, for a camera that
did not turn (Hartley and Zisserman, 9.6).
"""

from __future__ import annotations

import numpy as np

from flightdepth.motion import Vector

# Closer to the focus of expansion than this, on the plane z = 1, a line has no direction.
LEAST_REACH = 0.1


def lines(now: Vector, before: Vector, unit: Vector, around: Vector) -> Vector:
    """Points' distances from their epipolar lines, then how far along them they moved, on the plane z = 1 (6, 2 N).

    The rows: what three turns and two angles of the direction add to the distance, and the distance.
    `now` and `before` (3, N) with z = 1, `unit` (3,), `around` (3, 2) as `aside` gives it.
    """
    (x1, y1, _), (x2, y2, _) = now, before
    # The line d x x1, whose length on the plane is the reach: d . (x1 x x2) = x2 . (d x x1).
    along_x, along_y = unit[0] - x1 * unit[2], unit[1] - y1 * unit[2]
    reach = np.maximum(np.sqrt(along_x * along_x + along_y * along_y), LEAST_REACH)
    along_x /= reach
    along_y /= reach
    across = (unit[0] * y1 - unit[1] * x1) / reach
    right, down = x2 - x1, y2 - y1
    rows = np.zeros((6, 2, len(x1)))
    off, along = rows[:, 0], rows[:, 1]
    # A turn w adds (w x x2) . (d x x1) = w . (x2 x (d x x1)).
    toward = x2 * along_x + y2 * along_y
    off[0], off[1], off[2] = y2 * across + along_x, along_y - x2 * across, -toward
    off[3:] = np.vstack([around.T, unit]) @ (np.array([-down, right, x1 * y2 - y1 * x2]) / reach)
    # What it adds to x and to y of a ray with z = 1: (w x ray) brought back to z = 1.
    along[0], along[1], along[2] = -y2 * toward - along_y, x2 * toward + along_x, x2 * along_y - y2 * along_x
    along[5] = right * along_x + down * along_y
    return rows.reshape(6, -1)


def quick_median(values: Vector) -> float:
    """The upper one of an even number; `np.median` takes ten times as long."""
    middle = len(values) // 2
    return float(np.partition(values, middle)[middle])


def aside(unit: Vector) -> Vector:
    """Two unit vectors perpendicular to one and to each other, columns (3, 2)."""
    # d x e_k for each axis; the one farthest from d is used.
    x, y, z = unit
    first = np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])[int(np.argmin(np.abs(unit)))]
    first = first / np.linalg.norm(first)
    (a, b, c) = first
    return np.array([first, [y * c - z * b, z * a - x * c, x * b - y * a]]).T
