"""Draw one outdoor scene, and a drone's flight through it, from (config, seed, number)."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from flightdepth.scenes import chance
from flightdepth.scenes.orientation import noisy_orientations
from flightdepth.scenes.outdoor_config import HIGHEST_MOUND_M, Flight, OutdoorConfig, draw_flight
from flightdepth.scenes.outdoor_site import Site
from flightdepth.scenes.outdoor_textures import Surface
from flightdepth.scenes.outdoor_things import (
    TILE_M,
    Part,
    boulder,
    broadleaf,
    bush,
    fir,
    heading,
    house,
    materials,
    placed,
    tint,
    version,
)
from flightdepth.scenes.scene import Floats, Scene, Shape

_NOISE = 8  # what a random stream is for; 0 is the flight, 1 to 6 are what is built, 7 is the sun
REACH = 0.33  # of a tree's crown, over its height
LEAST_CHECKED_M = 0.1
PLAIN_HALF_M = 620.0
FIELDS_M = (-230.0, -40.0, 230.0, 330.0)  # x and z from, x and z to
SUN_DISTANCE_M = 20_000.0


def draw_outdoor(config: OutdoorConfig, seed: int, number: int = 0) -> Scene:
    """Scene `number` of the outdoor set (config, seed), to be rendered with `outdoor_textures`.

    Depends on its arguments only. Each kind of thing has a random stream of its own.
    """
    flight = outdoor_flight(config, seed, number)
    site = Site(flight.position(_times_s(config)), _checked_path(flight, config), config.clearance_m)
    for kind, build in enumerate((_ground, _hills, _houses, _trees, _woods, _bushes), start=1):
        build(chance.stream(seed, number, kind), config, site)
    sun, power = _sun(chance.stream(seed, number, 7))
    parts = site.parts
    return Scene(
        shape=np.array([part.shape for part in parts], dtype=np.int64),
        world_from_object=np.array([part.world_from_object for part in parts]),
        torus_radius=np.zeros(len(parts)),
        object_material=np.arange(len(parts)),
        room_half=np.full(3, np.inf),
        world_from_room=np.eye(3, 4),
        room_material=np.zeros(6, dtype=np.int64),
        materials=materials(parts),
        lamp_position=sun[None],
        lamp_power=power[None],
        ambient=np.array([0.30, 0.36, 0.46]),
        sky_colour=np.array([[0.66, 0.77, 0.89], [0.04, 0.14, 0.46]]),
        camera_position=site.path,
        world_from_camera=noisy_orientations(
            chance.stream(seed, number, _NOISE),
            flight.world_from_camera,
            config.frames,
            config.orientation_noise_rad,
        ),
    )


def outdoor_flight(config: OutdoorConfig, seed: int, number: int = 0) -> Flight:
    """The flight through scene `number`: positions and velocities at any time."""
    return draw_flight(chance.stream(seed, number, 0), config)


def outdoor_velocity(config: OutdoorConfig, seed: int, number: int = 0) -> Floats:
    """Velocity at each frame of scene `number`, m/s in world axes, shape [F, 3]."""
    return outdoor_flight(config, seed, number).velocity(_times_s(config))


def _times_s(config: OutdoorConfig, per_frame: int = 1) -> Floats:
    """Time of each frame, or of `per_frame` instants from each to the next, shape [F] or [per_frame (F - 1) + 1]."""
    return np.arange(per_frame * (config.frames - 1) + 1) / (per_frame * config.rate_hz)


def _checked_path(flight: Flight, config: OutdoorConfig) -> Floats:
    """Points of the path no farther apart than the clearance: each frame's position, and more where it is fast."""
    most_m = max(float(np.linalg.norm(leg)) for leg in (flight.first_m_s, flight.second_m_s)) / config.rate_hz
    per_frame = math.ceil(most_m / max(config.clearance_m, LEAST_CHECKED_M))
    return flight.position(_times_s(config, max(per_frame, 1)))


def _between(rng: np.random.Generator, limits: tuple[int, int]) -> range:
    """As many steps as drawn from `limits`, both included."""
    return range(int(rng.integers(limits[0], limits[1] + 1)))


def _ground(rng: np.random.Generator, config: OutdoorConfig, site: Site) -> None:
    """A plain, fields a little above it, and mounds."""
    site.parts.append(
        _slab((-PLAIN_HALF_M, -PLAIN_HALF_M, PLAIN_HALF_M, PLAIN_HALF_M), 0.0, rng, Surface.GRASS)
    )
    kinds = (Surface.GRASS, Surface.CROP, Surface.CROP, Surface.SOIL)
    for corners in _split(rng, FIELDS_M):
        site.parts.append(_slab(corners, rng.uniform(0.02, 0.2), rng, kinds[int(rng.integers(len(kinds)))]))
    for _ in _between(rng, config.mounds):
        radius, top = rng.uniform(50, 130), rng.uniform(0.9, HIGHEST_MOUND_M)
        ahead = chance.log_uniform(rng, 12.0, 160.0)
        x, z = rng.uniform(-0.9, 0.9) * ahead, ahead
        site.mounds.append((x, z, radius, top))
        pose = placed(heading(rng) * radius, x, radius - top, z)
        repeats = round(4.5 * radius / TILE_M)
        site.parts.append(Part(Shape.SPHERE, pose, version(rng, Surface.GRASS), tint(rng, 0.85), repeats))


def _split(
    rng: np.random.Generator, corners: tuple[float, float, float, float]
) -> list[tuple[float, float, float, float]]:
    """Cut a rectangle (x, z, x, z) into fields, the smaller the nearer."""
    x0, z0, x1, z1 = corners
    nearest = np.hypot(max(x0, 0.0, -x1), max(z0, 0.0, -z1))
    if max(x1 - x0, z1 - z0) < 26.0 + 0.45 * nearest:
        return [corners]
    share = rng.uniform(0.35, 0.65)
    if x1 - x0 > z1 - z0:
        x = x0 + share * (x1 - x0)
        return _split(rng, (x0, z0, x, z1)) + _split(rng, (x, z0, x1, z1))
    z = z0 + share * (z1 - z0)
    return _split(rng, (x0, z0, x1, z)) + _split(rng, (x0, z, x1, z1))


def _slab(
    corners: tuple[float, float, float, float], height: float, rng: np.random.Generator, surface: Surface
) -> Part:
    """Level ground over a rectangle; as deep as wide, so that the texture's mip levels fit."""
    x0, z0, x1, z1 = corners
    half_x, half_z = (x1 - x0) / 2, (z1 - z0) / 2
    deep = float(np.sqrt(half_x * half_z))
    pose = placed(np.diag([half_x, deep, half_z]), (x0 + x1) / 2, deep - height, (z0 + z1) / 2)
    repeats = max(1.0, round(2 * deep / TILE_M))
    return Part(Shape.CUBE, pose, version(rng, surface), tint(rng, 0.75), repeats, int(rng.integers(4)))


def _hills(rng: np.random.Generator, config: OutdoorConfig, site: Site) -> None:
    """Wooded hills side by side along the horizon."""
    steps = _between(rng, config.hills)
    for step in steps:
        sideways = -1.15 + 2.3 * (step + rng.uniform(0.2, 0.8)) / len(steps)
        away = rng.uniform(260, 420)
        wide, high = rng.uniform(70, 130), rng.uniform(18, 46)
        centre = np.array([sideways * away, 0.1 * high, away])
        pose = placed(heading(rng) * (wide, high, wide * rng.uniform(0.6, 0.9)), *centre)
        haze = np.array([0.90, 0.98, 1.0]) * (0.72 + 0.28 * (away - 260) / 160)
        part = Part(Shape.SPHERE, pose, version(rng, Surface.HILL), haze, repeats=3.0)
        if site.is_clear(centre, wide, high):  # a flight may be long enough to come there
            site.parts.append(part)


def _houses(rng: np.random.Generator, config: OutdoorConfig, site: Site) -> None:
    for _ in _between(rng, config.houses):
        size = rng.uniform(2.8, 4.6)
        foot = site.find(rng, (30.0, 140.0), 2.0 * size, 3.0 * size)
        if foot is not None:
            site.parts.extend(house(rng, foot, size))


def _trees(rng: np.random.Generator, config: OutdoorConfig, site: Site) -> None:
    for _ in _between(rng, config.near_trees):
        _tree(rng, site, (6.0, 18.0), rng.uniform(5.0, 11.0), detail=4)
    for _ in _between(rng, config.trees):
        _tree(rng, site, (18.0, 200.0), rng.uniform(6.0, 15.0), detail=2)


def _tree(
    rng: np.random.Generator, site: Site, distance_m: tuple[float, float], height: float, detail: int
) -> None:
    build = _kind(rng)
    foot = site.find(rng, distance_m, REACH * height, height)
    if foot is not None:
        pieces = (2 + detail) if build is fir else 3 * (1 + detail)
        site.parts.extend(build(rng, foot, height, pieces))


def _kind(rng: np.random.Generator) -> Callable[..., list[Part]]:
    return fir if rng.random() < 0.45 else broadleaf


def _woods(rng: np.random.Generator, config: OutdoorConfig, site: Site) -> None:
    for _ in _between(rng, config.woods):
        middle = site.find(rng, (60.0, 220.0), 12.0, 16.0)
        if middle is None:
            continue
        for _ in range(12):
            foot = site.foot(middle[0] + rng.uniform(-12, 12), middle[2] + rng.uniform(-12, 12))
            build, height = _kind(rng), rng.uniform(8.0, 16.0)
            tree = build(rng, foot, height, 3)
            # The outermost trees of a wood stand out of the place that was found for it.
            if site.is_clear(foot, REACH * height, height):
                site.parts.extend(tree)


def _bushes(rng: np.random.Generator, config: OutdoorConfig, site: Site) -> None:
    for _ in _between(rng, config.bushes):
        build, size = (
            (bush, rng.uniform(0.5, 1.6)) if rng.random() < 0.7 else (boulder, rng.uniform(0.4, 1.5))
        )
        foot = site.find(rng, (8.0, 90.0), 1.5 * size, 1.5 * size)
        if foot is not None:
            site.parts.extend(build(rng, foot, size))


def _sun(rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Position and power of the sun: behind the camera to one side, 30 to 65 degrees high."""
    side = 1.0 if rng.random() < 0.5 else -1.0
    towards = np.array([side * rng.uniform(0.6, 1.3), -rng.uniform(0.9, 1.4), -rng.uniform(0.2, 0.9)])
    towards /= np.sqrt((towards * towards).sum())
    power = np.array([1.0, 0.93, 0.80]) * (1.15 * SUN_DISTANCE_M**2)
    return towards * SUN_DISTANCE_M, power
