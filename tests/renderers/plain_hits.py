"""First hits of a ray o + t d with unit primitives by schoolbook formulas in float64: the reference."""

from __future__ import annotations

import numpy as np

from flightdepth.scenes.scene import Shape


def first(candidates) -> float:
    return min((t for t in candidates if t > 0), default=np.inf)


def real(roots: np.ndarray) -> np.ndarray:
    return roots[np.abs(roots.imag) < 1e-7].real


def hit_cube(o, d) -> float:
    found = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            t = (side - o[axis]) / d[axis]
            others = [i for i in range(3) if i != axis]
            if np.abs((o + t * d)[others]).max() <= 1:
                found.append(t)
    return first(found)


def hit_sphere(o, d) -> float:
    return first(real(np.roots([d @ d, 2 * o @ d, o @ o - 1])))


def hit_cone(o, d) -> float:
    t = (-1 - o[2]) / d[2]
    found = [t] if np.hypot(*(o + t * d)[:2]) <= 1 else []
    # x^2 + y^2 - (1 - z)^2 / 4 = 0 as a polynomial in t
    x, y, w = (np.poly1d([d[i], o[i]]) for i in range(3))
    side = x * x + y * y - (1 - w) * (1 - w) * 0.25
    found += [t for t in real(side.roots) if abs(o[2] + t * d[2]) <= 1]
    return first(found)


def torus_polynomial(o, d, radius) -> np.poly1d:
    x, y, z = (np.poly1d([d[i], o[i]]) for i in range(3))
    ring = x * x + y * y
    return (ring + z * z + 1 - radius**2) ** 2 - 4 * ring


def hit_torus(o, d, radius) -> float:
    return first(real(torus_polynomial(o, d, radius).roots))


def hit_unit(shape: Shape, radius: float, o: np.ndarray, d: np.ndarray) -> float:
    if shape is Shape.TORUS:
        return hit_torus(o, d, radius)
    return {Shape.CUBE: hit_cube, Shape.SPHERE: hit_sphere, Shape.CONE: hit_cone}[shape](o, d)


def torus_value(points: np.ndarray, radius: float) -> np.ndarray:
    """Distance from a torus' surface, [...], negative inside, without any polynomial."""
    return np.hypot(np.hypot(points[..., 0], points[..., 1]) - 1, points[..., 2]) - radius
