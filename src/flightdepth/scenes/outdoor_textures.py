"""Procedural surfaces of the outdoors: ground, leaves, walls, roofs, rock. All of them repeat without a seam."""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from functools import lru_cache

import numpy as np

from flightdepth.scenes import chance
from flightdepth.scenes.pictures import Image
from flightdepth.scenes.procedural import Floats, fractal_noise
from flightdepth.scenes.textures import EDGE, Textures

Rgb = tuple[float, float, float]


class Surface(IntEnum):
    """Index of each surface in the textures; every one of them comes in VARIANTS versions."""

    GRASS = 0
    CROP = 1
    SOIL = 2
    LEAVES = 3
    NEEDLES = 4
    BARK = 5
    WALL = 6
    ROOF = 7
    ROCK = 8
    HILL = 9


VARIANTS = 3


@lru_cache(maxsize=4)
def outdoor_textures(seed: int) -> Textures:
    """Textures for `draw_outdoor`: surface s in version v is number VARIANTS * s + v; kept, 31 MB a seed."""

    def made(number: int) -> Image:
        surface, version = divmod(number, VARIANTS)
        return picture(Surface(surface), chance.stream(seed, surface, version))

    return Textures.made(len(Surface) * VARIANTS, made)


def picture(surface: Surface, rng: np.random.Generator) -> Image:
    """One surface, uint8 RGB [EDGE, EDGE, 3] of gamma 2.2."""
    makers: dict[Surface, Callable[[np.random.Generator], Floats]] = {
        Surface.GRASS: grass,
        Surface.CROP: crop,
        Surface.SOIL: soil,
        Surface.LEAVES: leaves,
        Surface.NEEDLES: needles,
        Surface.BARK: bark,
        Surface.WALL: wall,
        Surface.ROOF: roof,
        Surface.ROCK: rock,
        Surface.HILL: hill,
    }
    return np.asarray(np.clip(makers[surface](rng), 0, 255), dtype=np.uint8)


def blend(a: Rgb, b: Rgb, share: Floats) -> Floats:
    """Colours between a (0) and b (1), [H, W] to [H, W, 3]."""
    return np.asarray(np.array(a) + (np.array(b) - np.array(a)) * share[..., None], dtype=np.float32)


def soft_step(noise: Floats, sharpness: float) -> Floats:
    """Noise of deviation 1 to 0..1: patches with more or less soft borders."""
    return np.asarray(np.clip(0.5 + sharpness * noise, 0, 1), dtype=np.float32)


def shaded(colour: Floats, noise: Floats, depth: float) -> Floats:
    """Colour times 1 + depth * noise, never black."""
    return np.asarray(colour * np.clip(1 + depth * noise, 0.15, 2.2)[..., None], dtype=np.float32)


def squeezed(colour: Floats) -> Floats:
    """Twice side by side at half the width: round things stretch a texture about so much along its width."""
    return np.concatenate([colour[:, 0::2], colour[:, 0::2]], axis=1)


def grass(rng: np.random.Generator) -> Floats:
    """A meadow: patches of dry and fresh grass, tufts, some flowers."""
    patches = soft_step(fractal_noise(rng, EDGE, 0.9), 0.35)
    colour = blend((108, 124, 58), (146, 142, 84), patches)
    tufts = fractal_noise(rng, EDGE, 0.45)
    flowers = rng.random((EDGE, EDGE)) < rng.uniform(0.0, 0.0015)
    colour = shaded(colour, tufts, 0.24)
    colour[flowers] = (235, 225, 170)
    return colour


def crop(rng: np.random.Generator) -> Floats:
    """Rows of plants with soil between them."""
    rows = int(rng.integers(16, 26))
    waves = np.sin(np.arange(EDGE) * (2 * np.pi * rows / EDGE), dtype=np.float32)[:, None]
    plants = soft_step(waves + 0.7 * fractal_noise(rng, EDGE, 0.6), 0.45)
    ripe = float(rng.random())
    colour = blend((122, 104, 74), (112 + 92 * ripe, 142 + 30 * ripe, 58 + 30 * ripe), plants)
    return shaded(colour, fractal_noise(rng, EDGE, 0.5), 0.18)


def soil(rng: np.random.Generator) -> Floats:
    """A ploughed field: furrows and clods."""
    rows = int(rng.integers(14, 22))
    waves = np.sin(np.arange(EDGE) * (2 * np.pi * rows / EDGE), dtype=np.float32)[:, None]
    colour = blend((112, 88, 66), (164, 138, 106), soft_step(fractal_noise(rng, EDGE, 1.0), 0.3))
    return shaded(colour, waves + 1.3 * fractal_noise(rng, EDGE, 0.5), 0.14)


def leaves(rng: np.random.Generator) -> Floats:
    """Broad leaves in clumps with dark gaps."""
    fresh = rng.uniform(0, 26)
    clumps = fractal_noise(rng, EDGE, 0.75)
    colour = blend((34, 52, 22), (118 + fresh, 144, 60), soft_step(clumps, 0.5))
    return squeezed(shaded(colour, fractal_noise(rng, EDGE, 0.35), 0.38))


def needles(rng: np.random.Generator) -> Floats:
    """Boughs of a fir: dark green, drooping rows."""
    rows = int(rng.integers(7, 11))
    row = np.arange(EDGE)[:, None] * (rows / EDGE)
    droop = (row + 0.25 * fractal_noise(rng, EDGE, 0.9)) % 1
    colour = blend((26, 44, 26), (84, 106, 58), np.asarray(droop, dtype=np.float32))
    return squeezed(shaded(colour, fractal_noise(rng, EDGE, 0.45), 0.34))


def bark(rng: np.random.Generator) -> Floats:
    """Bark: dark cracks."""
    colour = blend((58, 46, 36), (126, 104, 84), soft_step(fractal_noise(rng, EDGE, 0.8), 0.35))
    return shaded(colour, fractal_noise(rng, EDGE, 0.5), 0.2)


def wall(rng: np.random.Generator) -> Floats:
    """Plaster with rows of windows; it looks the same lying on its side, as cubes turn it."""
    plaster = rng.uniform(165, 225) + np.array((16.0, 2.0, -22.0)) * rng.uniform(0.2, 1.6)
    colour = np.empty((EDGE, EDGE, 3), np.float32)
    colour[:] = plaster
    colour = shaded(colour, fractal_noise(rng, EDGE, 1.0), 0.045)
    pitch = EDGE // int(rng.integers(3, 5))
    half = int(pitch * rng.uniform(0.17, 0.23))
    for row in range(pitch // 2, EDGE - pitch // 4, pitch):
        for column in range(pitch // 2, EDGE - pitch // 4, pitch):
            window(rng, colour, row, column, half)
    return colour


def window(rng: np.random.Generator, colour: Floats, row: int, column: int, half: int) -> None:
    """Paint a window with its frame and a cross bar."""
    frame = half // 5 + 1
    colour[row - half - frame : row + half + frame, column - half - frame : column + half + frame] = 228
    glass = np.array((58, 72, 88)) + rng.uniform(-24, 46)
    colour[row - half : row + half, column - half : column + half] = glass
    colour[row - half : row + half, column - 2 : column + 2] = 214
    colour[row - 2 : row + 2, column - half : column + half] = 214


def roof(rng: np.random.Generator) -> Floats:
    """Rows of tiles, each of its own shade."""
    rows, columns = 28, 32
    shade = rng.normal(0, 1, (rows, columns)).astype(np.float32)
    y = np.arange(EDGE)[:, None] * rows // EDGE
    x = ((np.arange(EDGE)[None, :] * columns + (y % 2) * (EDGE // 2)) // EDGE) % columns
    base = blend((116, 66, 50), (150, 100, 78), np.full((EDGE, EDGE), rng.random(), np.float32))
    edge_dark = ((np.arange(EDGE)[:, None] * rows % EDGE) < EDGE // 6).astype(np.float32)
    stains = fractal_noise(rng, EDGE, 1.1)
    return shaded(base, 0.9 * shade[y, x] - 2.0 * edge_dark + 0.7 * stains, 0.13)


def rock(rng: np.random.Generator) -> Floats:
    """Weathered stone with cracks and lichen."""
    colour = blend((98, 94, 88), (172, 168, 158), soft_step(fractal_noise(rng, EDGE, 1.1), 0.3))
    cracks = np.abs(fractal_noise(rng, EDGE, 1.0)) < 0.06
    colour[cracks] *= 0.5
    return shaded(colour, fractal_noise(rng, EDGE, 0.5), 0.16)


def hill(rng: np.random.Generator) -> Floats:
    """A wooded slope far away, pale from the air between."""
    crowns = soft_step(fractal_noise(rng, EDGE, 0.55), 0.4)
    clearings = fractal_noise(rng, EDGE, 1.3) > rng.uniform(0.5, 1.2)
    colour = blend((76, 98, 84), (122, 142, 112), crowns)
    colour[clearings] = blend((152, 164, 122), (168, 172, 136), crowns)[clearings]
    return squeezed(colour)
