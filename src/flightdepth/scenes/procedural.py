"""Textures made from a seed: dead leaves, 1/f noise, tiles and lettering, with the statistics of photographs.

Dead leaves (Lee, Mumford, Huang 2001: occluding shapes with a 1/r^3 law of sizes) and 1/f noise have the
power spectrum of natural images; tiles and lettering bring the repetition and fine print of built things.
"""

from __future__ import annotations

import string

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.scenes import chance
from flightdepth.scenes.pictures import Image

Floats = NDArray[np.float32]
Doubles = NDArray[np.float64]

CORNERS = (3, 4, 4, 24)  # of leaves: triangles, boxes twice as often, ellipses
SMOOTH_BELOW_PX = 6  # radius of a leaf whose edge is drawn smooth
FRACTIONAL_BITS = 4  # of a corner's coordinates


def texture(seed: int, number: int, edge: int) -> Image:
    """Texture `number` of a seed, uint8 RGB [edge, edge, 3]; the four kinds take turns."""
    rng = chance.stream(seed, number)
    kind = (dead_leaves, one_over_f, tiles, lettering)[number % 4]
    grain = 1 + rng.uniform(0.03, 0.25) * fractal_noise(rng, edge, 0.9)[..., None]
    return np.clip(kind(rng, edge) * grain, 0, 255).astype(np.uint8)


def fractal_noise(rng: np.random.Generator, edge: int, exponent: float) -> Floats:
    """Noise whose amplitude falls with frequency^-exponent, mean 0, deviation 1, float32 [edge, edge]."""
    frequency = np.hypot(np.fft.fftfreq(edge)[:, None], np.fft.rfftfreq(edge)[None, :])
    frequency[0, 0] = np.inf
    spectrum = np.fft.rfft2(rng.random((edge, edge)) - 0.5) / frequency**exponent
    noise = np.fft.irfft2(spectrum, s=(edge, edge))
    return np.asarray(noise / noise.std(), dtype=np.float32)


def _palette(rng: np.random.Generator, colours: int) -> Floats:
    """Colours round a random brightness and, as in photographs, a mostly weak tint: float32 [colours, 3], 0..255."""
    centre = rng.uniform(50, 190) + rng.uniform(5, 55) * rng.uniform(-1, 1, 3)
    spread = rng.uniform(15, 90)
    light = rng.uniform(-1, 1, (colours, 1)) * spread
    tint = rng.uniform(-1, 1, (colours, 3)) * spread * rng.uniform(0.2, 0.9)
    return np.clip(centre + light + tint, 5, 250).astype(np.float32)


def dead_leaves(rng: np.random.Generator, edge: int) -> Floats:
    """Opaque ellipses, boxes and triangles over each other, sizes by 1/r^3."""
    colours = _palette(rng, 64).tolist()
    image = np.empty((edge, edge, 3), np.float32)
    image[:] = colours[0]
    smallest, largest = edge / 170, edge / rng.uniform(3, 9)
    leaves = int(rng.integers(1500, 4000))
    chances, tints, corners = np.empty((leaves, 6)), np.empty(leaves, int), np.empty(leaves, int)
    for leaf in range(leaves):  # in the order that makes a seed's texture what it is
        chances[leaf, 0] = rng.random()
        tints[leaf] = rng.integers(64)
        chances[leaf, 1:3] = rng.random(2)
        corners[leaf] = CORNERS[rng.integers(len(CORNERS))]
        chances[leaf, 3:] = rng.random(3)
    # Inverse of the cumulative distribution of a density ~ r^-3 on [smallest, largest].
    u = chances[:, 0]
    radius = 1 / np.sqrt((1 - u) / smallest**2 + u / largest**2)
    outlines = _outlines(chances[:, 1:3] * edge, radius, corners, chances[:, 3:])
    for outline, ends, tint, size in zip(outlines, corners, tints, radius, strict=True):
        line = cv2.LINE_AA if size < SMOOTH_BELOW_PX else cv2.LINE_8
        cv2.fillPoly(image, [outline[:ends]], colours[tint], line, shift=FRACTIONAL_BITS)
    return image


def _outlines(
    centre: Doubles, radius: Doubles, corners: NDArray[np.int_], chances: Doubles
) -> NDArray[np.int32]:
    """Corners of stretched and turned polygons, in pixels with FRACTIONAL_BITS: [leaves, most corners, (x, y)].

    centre [leaves, 2] and radius [leaves] in pixels; chances [leaves, 3] in 0..1: where the first corner lies, how
    wide it is, how it is turned. Of each leaf the first `corners` [leaves] count.
    """
    first, stretch, turn = chances[:, 0] * 2 * np.pi, 0.35 + 0.65 * chances[:, 1], np.pi * chances[:, 2]
    angle = first[:, None] + np.arange(max(CORNERS)) * (2 * np.pi / corners)[:, None]
    along, across = np.cos(angle) * radius[:, None], np.sin(angle) * (radius * stretch)[:, None]
    cos, sin = np.cos(turn)[:, None], np.sin(turn)[:, None]
    points = centre[:, None] + np.stack([along * cos - across * sin, along * sin + across * cos], 2)
    return np.rint(points * (1 << FRACTIONAL_BITS)).astype(np.int32)


def one_over_f(rng: np.random.Generator, edge: int) -> Floats:
    """Clouds, stone, grass: two fields of 1/f noise mix three colours."""
    a, b, c = _palette(rng, 3)
    exponent = rng.uniform(0.8, 1.5)
    first = 0.5 + 0.35 * fractal_noise(rng, edge, exponent)[..., None]
    second = 0.5 + 0.35 * fractal_noise(rng, edge, rng.uniform(0.7, 1.3))[..., None]
    if rng.random() < 0.4:
        first = (first > 0.5).astype(np.float32)  # patches with hard borders
    return np.asarray(a + (b - a) * first + (c - a) * second * rng.uniform(0.3, 1.0), dtype=np.float32)


def tiles(rng: np.random.Generator, edge: int) -> Floats:
    """Bricks, windows or planks: a grid with joints, each tile of its own shade."""
    rows = int(rng.integers(4, 24))
    columns = max(2, int(rows * rng.uniform(0.3, 1.4)))
    colours = _palette(rng, rows * columns)
    offset = rng.choice([0.0, 0.5])
    y = np.arange(edge, dtype=np.float32)[:, None] * (rows / edge)
    row = np.floor(y).astype(np.int64)
    x = np.arange(edge, dtype=np.float32)[None, :] * (columns / edge) + offset * (row % 2)
    column = np.floor(x).astype(np.int64) % columns
    image = colours[(row % rows) * columns + column]
    joint = rng.uniform(0.02, 0.14)
    in_joint = ((y % 1) < joint) | ((x % 1) < joint * columns / rows)
    image[in_joint] = _palette(rng, 1)[0]
    return np.asarray(image, dtype=np.float32)


def lettering(rng: np.random.Generator, edge: int) -> Floats:
    """Lines of random letters and digits of several sizes over a 1/f background."""
    background = one_over_f(rng, edge) * 0.4 + _palette(rng, 1)[0] * 0.6
    image = np.ascontiguousarray(background, dtype=np.float32)
    letters = np.array(list(string.ascii_letters + string.digits + "    "))
    for _ in range(int(rng.integers(10, 40))):
        text = "".join(rng.choice(letters, int(rng.integers(3, 30))))
        place = tuple(int(v) for v in rng.uniform([-edge / 4, 0], [edge, edge * 1.05]))
        size = chance.log_uniform(rng, 0.4, 4.0)
        colour = _palette(rng, 1)[0].tolist()
        thickness = max(1, round(size * rng.uniform(0.8, 2.5)))
        font = int(rng.integers(0, 8))
        cv2.putText(image, text, place, font, size, colour, thickness, cv2.LINE_8)
    return image
