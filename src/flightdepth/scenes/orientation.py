"""The camera's orientation at each frame: turns about three axes, orientation noise."""

from __future__ import annotations

import numpy as np

from flightdepth.scenes import chance
from flightdepth.scenes.scene import Floats


def euler(angles_rad: Floats) -> Floats:
    """Rz(c) Ry(b) Rx(a) of angles (a, b, c) about x, y and z, less than pi each, shape (3, 3).

    Bit-equal on every machine: the tangent of half an angle is rounded to float32, where libraries of mathematics
    agree (an error of 6e-8 of the angle), and the rest is products, so that the matrix is a rotation to 1e-16.
    """
    half = np.tan(np.asarray(angles_rad, dtype=np.float64) / 2).astype(np.float32).astype(np.float64)
    ca, cb, cc = (1 - half * half) / (1 + half * half)
    sa, sb, sc = 2 * half / (1 + half * half)
    return np.array(
        [
            [cc * cb, cc * sb * sa - sc * ca, cc * sb * ca + sc * sa],
            [sc * cb, sc * sb * sa + cc * ca, sc * sb * ca - cc * sa],
            [-sb, cb * sa, cb * ca],
        ]
    )


def composed(first: Floats, second: Floats) -> Floats:
    """first @ second of two (3, 3) matrices, summed in a fixed order: a linear-algebra library may choose another."""
    return np.column_stack([chance.turned(first, second[:, column]) for column in range(3)])


def noisy_orientations(rng: np.random.Generator, steady: Floats, frames: int, noise_rad: float) -> Floats:
    """R(t) = R0 Euler(N0 mu(t)), shape [F, 3, 3], mu(t) a fresh random unit vector at each frame (paper, IV).

    `steady` is R0, world_from_camera without noise; N0 is `noise_rad`. The paper writes a sum; it means this.
    """
    if noise_rad == 0:
        return np.repeat(steady[None], frames, axis=0)
    turns = [euler(noise_rad * chance.unit_vector(rng)) for _ in range(frames)]
    return np.array([composed(steady, turn) for turn in turns])
