"""What a hit looks like: normal, place on the texture and filtered texture colour, compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flightdepth.renderers.compiling import compiled
from flightdepth.renderers.intersections import CONE, CUBE, SPHERE
from flightdepth.scenes.textures import EDGE, LEVELS

# First texel of each mip level in a texture's block.
LEVEL_OFFSET = np.cumsum([0] + [(EDGE >> level) ** 2 for level in range(LEVELS)])[:LEVELS].astype(np.int64)
LINEAR = ((np.arange(256) / 255.0) ** 2.2).astype(np.float32).astype(np.float64)  # byte -> linear light
# Texels in a pixel -> level.
FINER = np.array([0] + [n.bit_length() - 1 for n in range(1, EDGE)] + [LEVELS - 2])
SHRINK = 0.5 ** np.arange(LEVELS)
ENCODE_STEPS = 4096
ENCODED = np.rint(255 * (np.arange(ENCODE_STEPS + 1) / ENCODE_STEPS) ** (1 / 2.2)).astype(np.uint8)

Vec3 = tuple[float, float, float]


@compiled
def normal_in_object(shape: int, part: int, x: float, y: float, z: float) -> Vec3:
    """Outward normal (not unit length) of a unit primitive at a point on it, object space."""
    if shape == CUBE:
        sign = 1.0 if part % 2 == 1 else -1.0
        axis = part // 2
        return (sign if axis == 0 else 0.0), (sign if axis == 1 else 0.0), (sign if axis == 2 else 0.0)
    if shape == SPHERE:
        return x, y, z
    if shape == CONE:
        if part == 1:
            return 0.0, 0.0, -1.0
        return x, y, 0.25 * (1.0 - z)
    ring = max(math.sqrt(x * x + y * y), 1e-12)
    return x * (1.0 - 1.0 / ring), y * (1.0 - 1.0 / ring), z


@compiled
def texture_place(
    shape: int, part: int, radius: float, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """(u, v) in 0..1 over the surface, and the length in object space that one unit of them covers."""
    if shape == CUBE:
        axis = part // 2
        if axis == 0:
            return 0.5 + 0.5 * y, 0.5 + 0.5 * z, 2.0
        if axis == 1:
            return 0.5 + 0.5 * x, 0.5 + 0.5 * z, 2.0
        return 0.5 + 0.5 * x, 0.5 + 0.5 * y, 2.0
    around = math.atan2(y, x) / (2.0 * math.pi) + 0.5
    if shape == SPHERE:
        return around, math.acos(min(max(z, -1.0), 1.0)) / math.pi, 4.0
    if shape == CONE:
        if part == 1:
            return 0.5 + 0.5 * x, 0.5 + 0.5 * y, 2.0
        return around, 0.5 + 0.5 * z, 2.5
    ring = math.sqrt(x * x + y * y) - 1.0
    return around, math.atan2(z, ring) / (2.0 * math.pi) + 0.5, 4.0 * math.sqrt(radius) * 1.6


@compiled
def _bilinear(block: NDArray[np.uint8], level: int, u: float, v: float) -> Vec3:
    """Linear-light colour of one mip level, repeating at the border."""
    edge = EDGE >> level
    x, y = u * edge - 0.5, v * edge - 0.5
    floor_x, floor_y = math.floor(x), math.floor(y)
    ax, ay = x - floor_x, y - floor_y
    # Unsigned, or the compiler would look at each for a place counted from the end.
    x0, y0 = int(floor_x) & (edge - 1), int(floor_y) & (edge - 1)
    x1, y1 = (x0 + 1) & (edge - 1), (y0 + 1) & (edge - 1)
    base = LEVEL_OFFSET[level]
    i00, i01 = np.uintp(base + y0 * edge + x0), np.uintp(base + y0 * edge + x1)
    i10, i11 = np.uintp(base + y1 * edge + x0), np.uintp(base + y1 * edge + x1)
    w00, w01, w10, w11 = (1 - ax) * (1 - ay), ax * (1 - ay), (1 - ax) * ay, ax * ay
    r = (
        w00 * LINEAR[block[i00, 0]]
        + w01 * LINEAR[block[i01, 0]]
        + w10 * LINEAR[block[i10, 0]]
        + w11 * LINEAR[block[i11, 0]]
    )
    g = (
        w00 * LINEAR[block[i00, 1]]
        + w01 * LINEAR[block[i01, 1]]
        + w10 * LINEAR[block[i10, 1]]
        + w11 * LINEAR[block[i11, 1]]
    )
    b = (
        w00 * LINEAR[block[i00, 2]]
        + w01 * LINEAR[block[i01, 2]]
        + w10 * LINEAR[block[i10, 2]]
        + w11 * LINEAR[block[i11, 2]]
    )
    return r, g, b


@compiled
def texture_colour(texels: NDArray[np.uint8], texture: int, u: float, v: float, footprint: float) -> Vec3:
    """Trilinear look-up; `footprint` is the width of a pixel on the surface in units of u, v.

    Between two levels the blend is linear in the footprint, which spares a logarithm.
    """
    wide = max(footprint * EDGE, 1.0)
    lower = FINER[np.uintp(int(wide) if wide < EDGE else EDGE)]
    blend = wide * SHRINK[lower] - 1.0 if wide < EDGE else 1.0
    r, g, b = _bilinear(texels[texture], lower, u, v)
    if blend > 0.0:
        r1, g1, b1 = _bilinear(texels[texture], lower + 1, u, v)
        r, g, b = r + blend * (r1 - r), g + blend * (g1 - g), b + blend * (b1 - b)
    return r, g, b


@compiled
def encoded(linear: float) -> int:
    """A linear value as a byte of gamma 2.2, 0..255; what is no number, as beside a lamp at a wall, is black."""
    if linear >= 1.0:
        return 255
    level: int = ENCODED[int(linear * ENCODE_STEPS + 0.5)] if linear > 0.0 else 0
    return level
