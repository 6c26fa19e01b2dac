"""A rotation that grows from row to row: what a rolling shutter makes of a turn that begins or ends.

A camera that reads its rows within s seconds, and turns at w1 (rad/s) in one picture and at w2 in a later one, sees
the earlier one's row at t (-0.5 the first, 0.5 the last) turned by (R w1 - w2) s t beyond the rotation R between the
two pictures' middle rows: their bend times t. At an even rate both pictures are bent alike, and nothing is left. Rows
are those of the undistorted pictures that the network sees, which a wide lens's own follow but for some percent.
"""

from __future__ import annotations

import numpy as np

from flightdepth.camera import Camera
from flightdepth.motion import Vector


def row_times(rows: Vector, camera: Camera) -> Vector:
    """When rows [...] (pixels, the first one is 0) are read, in readouts: -0.5 at the picture's top, 0.5 below."""
    return np.asarray((rows + 0.5) / camera.height - 0.5)


def rays_times(rays: Vector, camera: Camera) -> Vector:
    """The same of the rows that rays [..., 3] (z = 1) go through."""
    return row_times(camera.fy * rays[..., 1] + camera.cy, camera)


def bent(rays: Vector, bend: Vector, times: Vector) -> Vector:
    """Rays [N, 3] turned by `bend` (3,), radians, times [N]; to first order, of any length."""
    return np.asarray(rays + times[:, None] * (rays @ _across(bend).T))


def straight_from_bent(bend: Vector, camera: Camera) -> Vector:
    """The matrices [H, 3, 3] that undo it, one a row of the picture."""
    times = row_times(np.arange(camera.height, dtype=np.float64), camera)
    return np.asarray(np.eye(3) - times[:, None, None] * _across(bend))


def _across(bend: Vector) -> Vector:
    """The matrix (3, 3) of the cross product with it."""
    a, b, c = bend
    return np.array([[0.0, -c, b], [c, 0.0, -a], [-b, a, 0.0]])
