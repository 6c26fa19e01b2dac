"""What stands outdoors, built of the ray caster's primitives. World axes: x right, y down, z ahead."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flightdepth.scenes import chance
from flightdepth.scenes.outdoor_textures import VARIANTS, Surface
from flightdepth.scenes.scene import Floats, Materials, Shape

BURIED_M = 1.5  # how deep a thing goes into uneven ground
TILE_M = 13.0  # one repeat of a ground texture


@dataclass(frozen=True)
class Part:
    """One primitive: world_from_object [3, 4] and what it wears."""

    shape: Shape
    world_from_object: Floats
    texture: int
    tint: Floats
    repeats: float = 1.0
    turn: int = 0


def materials(parts: Sequence[Part]) -> Materials:
    """A material for each part, in their order."""
    return Materials(
        texture=np.array([part.texture for part in parts], dtype=np.int64),
        colour=np.array([part.tint for part in parts]).reshape(-1, 3),
        specular=np.zeros(len(parts)),
        repeats=np.array([part.repeats for part in parts], dtype=np.float64),
        turn=np.array([part.turn for part in parts], dtype=np.int64),
    )


def version(rng: np.random.Generator, surface: Surface) -> int:
    """The texture number of a random version of a surface."""
    return int(VARIANTS * surface + rng.integers(VARIANTS))


def tint(rng: np.random.Generator, low: float = 0.75) -> Floats:
    """A near-grey factor for a texture: no two things look quite the same."""
    return np.asarray(rng.uniform(low, 1.0) * rng.uniform(0.9, 1.0, 3))


def heading(rng: np.random.Generator) -> Floats:
    """A random turn about the vertical, shape (3, 3)."""
    cosine, sine = chance.unit_vector(rng, 2)
    return np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])


def placed(linear: Floats, x: float, y: float, z: float) -> Floats:
    """Pose [3, 4] of a linear map (3, 3) and a position."""
    return np.column_stack([linear, (x, y, z)])


def below(point: Floats, metres: float) -> Floats:
    """The point so much further down; up for negative metres."""
    return np.asarray(point + np.array([0.0, metres, 0.0]))


def upright_cone(rng: np.random.Generator, foot: Floats, radius: float, height: float) -> Floats:
    """Pose of a cone that stands on `foot`, its axis up."""
    base = heading(rng) @ np.array([[radius, 0, 0], [0, 0, -height / 2], [0, radius, 0]])
    return placed(base, foot[0], foot[1] - height / 2, foot[2])


def fir(rng: np.random.Generator, foot: Floats, height: float, tiers: int) -> list[Part]:
    """A trunk and tiers of boughs, each a cone that reaches under the one above."""
    texture, shade = version(rng, Surface.NEEDLES), tint(rng, 0.7)
    bark = version(rng, Surface.BARK)
    buried = below(foot, BURIED_M)
    parts = [Part(Shape.CONE, upright_cone(rng, buried, 0.028 * height, height), bark, tint(rng))]
    width = height * rng.uniform(0.2, 0.28)
    for tier in range(tiers):
        up = 0.12 + 0.76 * tier / tiers
        top = min(1.0, up + 1.25 * (1 - up) / (1 + 0.35 * (tiers - 1 - tier)))
        radius = width * (1 - 0.82 * up)
        pose = upright_cone(rng, below(foot, -up * height), radius, (top - up) * height)
        parts.append(Part(Shape.CONE, pose, texture, shade, repeats=2.0))
    return parts


def broadleaf(rng: np.random.Generator, foot: Floats, height: float, clumps: int) -> list[Part]:
    """A trunk and a crown of overlapping balls of leaves."""
    texture, shade = version(rng, Surface.LEAVES), tint(rng, 0.65)
    bark = version(rng, Surface.BARK)
    buried = below(foot, BURIED_M)
    parts = [Part(Shape.CONE, upright_cone(rng, buried, 0.04 * height, 0.95 * height), bark, tint(rng))]
    crown = below(foot, -0.64 * height)
    reach = height * rng.uniform(0.2, 0.27)
    for clump in range(clumps):
        size = reach * (rng.uniform(0.34, 0.66) if clump else 0.95)
        away = chance.unit_vector(rng) * reach * (rng.uniform(0.68, 1.0) if clump else 0.0)
        linear = chance.rotation(rng) * (size * rng.uniform(0.8, 1.0, 3))
        centre = crown + away * (1.0, 1.15, 1.0)
        light = shade * rng.uniform(0.86, 1.0)
        parts.append(Part(Shape.SPHERE, placed(linear, *centre), texture, light, repeats=2.0))
    return parts


def house(rng: np.random.Generator, foot: Floats, size: float) -> list[Part]:
    """Walls, a gable roof and a chimney; `size` is half the width, and the house is longer than wide."""
    turn = heading(rng)
    length, walls, rise = (
        size * rng.uniform(1.5, 1.9),
        size * rng.uniform(1.05, 1.9),
        size * rng.uniform(0.6, 0.9),
    )
    plaster, shade = version(rng, Surface.WALL), tint(rng, 0.85)
    eaves = below(foot, -walls)
    box = turn * (size, walls / 2 + BURIED_M, length)
    # A cube sheared to a rhomb, the ridge its upper edge; its lower half is inside the walls.
    gable = np.array([[0.49, 0.49, 0.0], [0.48, -0.48, 0.0], [0.0, 0.0, 0.999]]) * [[size], [rise], [length]]
    chimney = np.array([0.4 * size, -walls - 0.75 * rise, rng.uniform(-0.6, 0.6) * length])
    return [
        Part(Shape.CUBE, placed(box, foot[0], foot[1] - walls / 2 + BURIED_M, foot[2]), plaster, shade),
        Part(Shape.CUBE, placed(turn @ gable, *eaves), version(rng, Surface.BARK), tint(rng)),
        *_roof(rng, eaves, turn, (size, rise, length)),
        Part(
            Shape.CUBE,
            placed(turn * (0.3, 0.5 * rise + 0.4, 0.3), *(foot + turn @ chimney)),
            version(rng, Surface.ROCK),
            np.array([0.75, 0.5, 0.42]),
        ),
    ]


def _roof(
    rng: np.random.Generator, eaves: Floats, turn: Floats, sizes: tuple[float, float, float]
) -> list[Part]:
    """Two slabs from the ridge to beyond the eaves; `sizes` are half width, rise and half length."""
    size, rise, length = sizes
    tiles, shade = version(rng, Surface.ROOF), tint(rng, 0.75)
    parts = []
    for side in (-1.0, 1.0):
        down = np.array([side * 0.58 * size, 0.58 * rise, 0.0])  # half of the way from the ridge to the edge
        slab = np.column_stack([(0.0, 0.0, 1.06 * length), (0.0, -0.12, 0.0), down])
        centre = eaves + turn @ (down - (0.0, rise, 0.0))
        parts.append(Part(Shape.CUBE, placed(turn @ slab, *centre), tiles, shade))
    return parts


def bush(rng: np.random.Generator, foot: Floats, size: float) -> list[Part]:
    """One to three low balls of leaves."""
    texture, shade = version(rng, Surface.LEAVES), tint(rng, 0.7)
    parts = []
    for _ in range(int(rng.integers(1, 4))):
        linear = chance.rotation(rng) * (size * rng.uniform(0.6, 1.0, 3))
        beside = foot + np.array([rng.uniform(-1, 1), -0.3, rng.uniform(-1, 1)]) * size
        parts.append(Part(Shape.SPHERE, placed(linear, *beside), texture, shade))
    return parts


def boulder(rng: np.random.Generator, foot: Floats, size: float) -> list[Part]:
    """A block of stone, turned anyhow."""
    shape = Shape.CUBE if rng.random() < 0.5 else Shape.SPHERE
    linear = chance.rotation(rng) * (size * rng.uniform(0.5, 0.9, 3))
    pose = placed(linear, foot[0], foot[1] - 0.25 * size, foot[2])
    return [Part(shape, pose, version(rng, Surface.ROCK), tint(rng))]
