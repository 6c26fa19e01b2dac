"""Draws that are bit-equal on every machine: uniform numbers, square roots and products only."""

from __future__ import annotations

import numpy as np

from flightdepth.motion import rotations_from_quaternions
from flightdepth.scenes.scene import Floats


def stream(*key: int) -> np.random.Generator:
    """Random stream of a key such as (seed, scene number); a key and the same with zeros behind it are one stream.

    What is drawn beside scene `number` has its kind behind that number, (seed, number, kind), and a kind from 20 on
    that nothing else has: 0 (no kind) to 8 are the scenes' own, and (seed, kind, number) is a stream of scene `kind`.
    """
    return np.random.default_rng(np.random.SeedSequence(key))


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Log-uniform in [low, high]; rounded to float32, where libraries of mathematics agree."""
    return float(np.float32(low * (high / low) ** rng.random()))


def unit_vector(rng: np.random.Generator, dimensions: int = 3) -> Floats:
    """Uniform on the unit sphere, by rejection from the cube."""
    while True:
        vector = rng.uniform(-1.0, 1.0, dimensions)
        square = float((vector * vector).sum())
        if 1e-4 < square <= 1.0:
            return np.asarray(vector / np.sqrt(square))


def rotation(rng: np.random.Generator) -> Floats:
    """Uniformly random rotation matrix, shape (3, 3), from a uniform unit quaternion."""
    return np.asarray(rotations_from_quaternions(unit_vector(rng, 4)[None])[0])


def turned(rotation: Floats, vector: Floats) -> Floats:
    """rotation @ vector, shape (3,), summed in a fixed order: a linear-algebra library may choose another."""
    return np.asarray((rotation * vector).sum(axis=1))
