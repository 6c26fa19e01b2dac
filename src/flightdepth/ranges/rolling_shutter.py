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


def row_times(rays: Vector, camera: Camera) -> Vector:
    """When the row of each ray [..., 3] (z = 1) is read, in readouts: -0.5 at the top of the picture, 0.5 below."""
    return np.asarray((camera.fy * rays[..., 1] + camera.cy + 0.5) / camera.height - 0.5)


def bent(rays: Vector, bend: Vector, times: Vector) -> Vector:
    """Rays [..., 3] turned by `bend` (3,), radians, times [...]; to first order, of any length."""
    (x, y, z), (a, b, c) = np.moveaxis(rays, -1, 0), bend
    added = np.stack([b * z - c * y, c * x - a * z, a * y - b * x], axis=-1)
    return np.asarray(rays + times[..., None] * added)
