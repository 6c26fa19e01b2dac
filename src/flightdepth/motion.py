"""Rotations. Quaternions are (w, x, y, z), unit length, `a_from_b` turns vectors of frame b into frame a."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flightdepth.errors import BadInput

Vector = NDArray[np.float64]
Stamps = NDArray[np.int64]  # nanoseconds

# A camera that looks north with its x axis east: x right = east, y down = down, z forward = north.
NED_FROM_CAMERA = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
ENU_FROM_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
NED_FROM_ENU = ENU_FROM_NED  # its own inverse


def unit_quaternion(quaternion: ArrayLike) -> Vector:
    """Normalise a quaternion, shape (4,); a zero or non-finite one is refused."""
    q = np.asarray(quaternion, dtype=np.float64)
    length = float(np.linalg.norm(q)) if q.shape == (4,) else float("nan")
    if not np.isfinite(length) or length < 1e-9:
        raise BadInput(
            "quaternion", expected="four finite numbers (w, x, y, z), not all zero", got=str(q.tolist())
        )
    return q / length


def is_rotation(quaternion: Iterable[float], within: float = 0.1) -> bool:
    """Whether four numbers are a unit quaternion, as far as whoever wrote them rounds."""
    return abs(math.hypot(*quaternion) - 1) < within  # False for NaN too


def rotation_from_quaternion(quaternion: ArrayLike) -> Vector:
    """Rotation matrix, shape (3, 3), of a quaternion (w, x, y, z)."""
    return np.asarray(rotations_from_quaternions(unit_quaternion(quaternion)[None])[0])


def rotations_from_quaternions(quaternions_k4: Vector) -> Vector:
    """Rotation matrices [k, 3, 3] of unit quaternions (w, x, y, z) [k, 4]."""
    w, x, y, z = quaternions_k4.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)


def quaternion_products(first: Vector, second: Vector) -> Vector:
    """Rotations of `second` [..., 4], then of `first` [..., 4], as quaternions (w, x, y, z) (Hamilton's product)."""
    (w, x, y, z), (a, b, c, d) = np.moveaxis(first, -1, 0), np.moveaxis(second, -1, 0)
    parts = [
        w * a - x * b - y * c - z * d,
        w * b + x * a + y * d - z * c,
        w * c - x * d + y * a + z * b,
        w * d + x * c - y * b + z * a,
    ]
    return np.stack(parts, axis=-1)


def mixed_quaternions(start: Vector, end: Vector, share: ArrayLike) -> Vector:
    """Unit quaternions `share` [...], 0..1, of the way from `start` [..., 4] to `end` [..., 4], along the shorter way.

    Normalised linear interpolation: between orientations 0.2 rad apart it is within 0.0001 rad of slerp.
    """
    # q and -q are the same rotation.
    end = np.where(np.sum(start * end, axis=-1, keepdims=True) < 0, -end, end)
    mixed = start + np.asarray(share)[..., None] * (end - start)
    return np.asarray(mixed / np.linalg.norm(mixed, axis=-1, keepdims=True))


def quaternion_from_rotation(rotation: ArrayLike) -> Vector:
    """Quaternion (w, x, y, z), w >= 0, of a rotation matrix (3, 3); Shepperd's method, stable at any angle."""
    m = np.asarray(rotation, dtype=np.float64)
    traces = np.array([m.trace(), 2 * m[0, 0] - m.trace(), 2 * m[1, 1] - m.trace(), 2 * m[2, 2] - m.trace()])
    largest = int(np.argmax(traces))
    q = np.array(
        [
            [1 + traces[0], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], 1 + traces[1], m[1, 0] + m[0, 1], m[0, 2] + m[2, 0]],
            [m[0, 2] - m[2, 0], m[1, 0] + m[0, 1], 1 + traces[2], m[2, 1] + m[1, 2]],
            [m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[2, 1] + m[1, 2], 1 + traces[3]],
        ]
    )[largest]
    q /= np.linalg.norm(q)
    return np.asarray(q if q[0] >= 0 else -q)


def rotation_from_euler(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Vector:
    """Rz(yaw) Ry(pitch) Rx(roll), shape (3, 3): the aerospace order, world_from_body in NED / FRD."""
    return rotation_from_quaternion(quaternion_from_euler(roll_rad, pitch_rad, yaw_rad))


def quaternion_from_euler(
    roll_rad: float, pitch_rad: float, yaw_rad: float
) -> tuple[float, float, float, float]:
    """Quaternion (w, x, y, z), w >= 0, of finite angles: `rotation_from_euler`, at the speed of plain numbers.

    The product of the turns about z, y and x, each (cos(angle / 2), sin(angle / 2) * axis).
    """
    cr, cp, cy = (math.cos(angle / 2) for angle in (roll_rad, pitch_rad, yaw_rad))
    sr, sp, sy = (math.sin(angle / 2) for angle in (roll_rad, pitch_rad, yaw_rad))
    w, x = cr * cp * cy + sr * sp * sy, sr * cp * cy - cr * sp * sy
    y, z = cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy
    return (w, x, y, z) if w >= 0 else (-w, -x, -y, -z)


def rotation_angle_rad(rotation: ArrayLike) -> float:
    """Angle of a rotation matrix, 0..pi."""
    m = np.asarray(rotation, dtype=np.float64)
    sine = np.linalg.norm([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]]) / 2
    return float(np.arctan2(sine, (m.trace() - 1) / 2))
