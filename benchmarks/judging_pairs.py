"""Pairs to fit the judge of `runtimes.alignment` on (`judging`), of scenes that neither training nor a test uses.

Rooms and flights outdoors, lenses of 25 to 110 degrees, displacements of one to nine frames; three in five with what a
camera does to pictures, and three in five with a motion that is reported wrongly and then mended as in flight. To fit,
two in five show things that move by themselves. `benchmarks/alignment.py --fit` runs it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np
from moving import with_moving_thing

from flightdepth.camera import Camera
from flightdepth.ranges.derotation import derotated
from flightdepth.renderers.raycast import render
from flightdepth.scenes import Scene, StillBoxConfig, Textures, chance, draw_scene
from flightdepth.scenes.outdoor import draw_outdoor
from flightdepth.scenes.outdoor_textures import outdoor_textures
from flightdepth.stillbox.motion_noise import rotated, tilted
from flightdepth.stillbox.pairs import Pair
from flightdepth.stillbox.photometric import Photometric
from flightdepth.stillbox.sets import ANY_FLIGHT

SEED = 2018_0_2026
# So that the grid is the camera; less for a network that sees less.
SHAPES = ((256, 256), (256, 192), (192, 256))
FOV_DEG = (25.0, 110.0)
ROOM_SHIFTS, OUTDOOR_SHIFTS = (1, 2, 3, 3, 4, 6, 9), (1, 1, 2, 3, 5, 8)  # frames
ROOM_SHARE, BACKWARD_SHARE, EFFECTS_SHARE, WRONG_SHARE = 0.55, 0.3, 0.6, 0.6
WRONG_ROTATION_DEG, WRONG_DIRECTION_DEG = 0.5, 4.0  # the largest; small ones are more frequent (u^2)
TEXTURE_SETS = 3
MOVING_SHARE, MOST_THINGS = 0.4, 3
LEAST_OFF_PX = 1.0

_PAIR, _THINGS = 20, 21  # what a random stream is for

Flown = tuple[Scene, Textures, tuple[int, int]]  # and which frames are the pair


def fitting_pairs(
    count: int,
    shrunk: int = 1,
    seed: int = SEED,
    *,
    moving_share: float = 0.0,
    wrong_share: float = WRONG_SHARE,
) -> Iterator[Pair]:
    """Pairs of pictures 1 / `shrunk` as large as SHAPES.

    `moving_share` of them show things that move by themselves, `wrong_share` have a motion that is reported wrongly.
    """
    effects = Photometric()
    for number in range(count):
        rng = chance.stream(seed, number, _PAIR)
        width, height = SHAPES[rng.integers(len(SHAPES))]
        camera = Camera.from_fov(width // shrunk, height // shrunk, float(rng.uniform(*FOV_DEG)))
        scene, textures, frames = (room if rng.random() < ROOM_SHARE else outdoors)(seed, number, rng)
        if rng.random() < BACKWARD_SHARE:
            frames = frames[::-1]
        seen = render(scene, textures, camera, frames=frames)
        pair = Pair(seen.images[0], seen.images[1], seen.depth_m[1], scene.displacement(*frames), camera)
        moving = chance.stream(seed, number, _THINGS)
        if moving.random() < moving_share:
            pair = with_moving_things(pair, textures, moving)
        if rng.random() < EFFECTS_SHARE:
            pair = effects(rng, pair)
        yield reported_wrongly(pair, rng) if rng.random() < wrong_share else pair


def with_moving_things(pair: Pair, textures: Textures, rng: np.random.Generator) -> Pair:
    """The pair with up to three things more; no depth where one left its line so little that nothing shows it."""
    for _ in range(rng.integers(1, MOST_THINGS + 1)):
        thing = with_moving_thing(pair, textures, rng)
        if thing is not None:
            seen = thing.off_px > LEAST_OFF_PX
            depth_m = (
                thing.pair.target_m if seen else np.where(thing.inside, np.float32(np.nan), pair.target_m)
            )
            pair = replace(thing.pair, target_m=depth_m)
    return pair


def room(seed: int, number: int, rng: np.random.Generator) -> Flown:
    textures = _room_textures(seed + int(rng.integers(TEXTURE_SETS)))
    scene = draw_scene(StillBoxConfig(), len(textures), seed, number)
    return scene, textures, (0, int(rng.choice(ROOM_SHIFTS)))


def outdoors(seed: int, number: int, rng: np.random.Generator) -> Flown:
    textures = outdoor_textures(seed + int(rng.integers(TEXTURE_SETS)))
    scene = draw_outdoor(ANY_FLIGHT, seed, number)
    first = int(rng.integers(0, ANY_FLIGHT.frames - max(OUTDOOR_SHIFTS)))
    return scene, textures, (first, first + int(rng.choice(OUTDOOR_SHIFTS)))


@cache
def _room_textures(seed: int) -> Textures:
    return Textures.procedural(64, seed)


def reported_wrongly(pair: Pair, rng: np.random.Generator) -> Pair:
    """The same with a motion that is off, mended as far as the pictures allow."""
    turn = chance.unit_vector(rng) * np.radians(WRONG_ROTATION_DEG) * rng.random() ** 2
    previous = rotated(pair.previous, pair.camera, turn)
    motion = tilted(pair.displacement, chance.unit_vector(rng), WRONG_DIRECTION_DEG * rng.random() ** 2)
    previous, motion, _ = derotated(previous, pair.current, motion, pair.camera)
    return replace(pair, previous=previous, displacement=motion)
