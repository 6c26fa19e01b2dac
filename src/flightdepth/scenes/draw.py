"""Draw one Still Box scene from (config, seed, number)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flightdepth.scenes import chance
from flightdepth.scenes.config import StillBoxConfig
from flightdepth.scenes.open_air import opened
from flightdepth.scenes.orientation import noisy_orientations
from flightdepth.scenes.scene import BOUND_RADIUS, Floats, Materials, Scene, Shape

_OPEN, _NOISE = 1, 2  # what a random stream is for
MOST_TRIES = 60  # an object that finds no place is left out rather than squeezed in


def draw_scene(
    config: StillBoxConfig, texture_count: int, seed: int, number: int, height_per_width: float = 1.0
) -> Scene:
    """Scene `number` of the dataset (config, seed); the world frame is the first camera's frame, without noise.

    Depends on its arguments only, so any scene can be drawn alone, on any machine. `height_per_width` is the
    picture's: objects fill a wide or a tall view as they fill a square one.
    """
    rng = chance.stream(seed, number)
    position = _camera_path(rng, config)
    room_half, world_from_room = _room(rng, config, position)
    palette = _Palette(rng, config.texture_ratio, texture_count)
    room_material = np.array([palette.add(highlight=False) for _ in range(6)])
    objects = [
        placed
        for _ in range(int(rng.integers(config.meshes[0], config.meshes[1] + 1)))
        if (placed := _object(rng, config, position, height_per_width)) is not None
    ]
    lamp_position, lamp_power = _lamps(rng, config, room_half, world_from_room)
    scene = Scene(
        shape=np.array([o.shape for o in objects], dtype=np.int64),
        world_from_object=np.array([o.world_from_object for o in objects]).reshape(-1, 3, 4),
        torus_radius=np.array([o.torus_radius for o in objects]),
        object_material=np.array([palette.add(highlight=True) for _ in objects], dtype=np.int64),
        room_half=room_half,
        world_from_room=world_from_room,
        room_material=room_material,
        materials=palette.materials(),
        lamp_position=lamp_position,
        lamp_power=lamp_power,
        ambient=np.full(3, rng.uniform(0.04, 0.24)),
        sky_colour=np.zeros((2, 3)),
        camera_position=position,
        world_from_camera=noisy_orientations(
            chance.stream(seed, number, _NOISE), np.eye(3), config.frames, config.orientation_noise_rad
        ),
    )
    aside = chance.stream(seed, number, _OPEN)  # the closed scenes stay what they are
    if aside.random() >= config.open_share:
        return scene
    return opened(scene, texture_count, aside, config.clearance_m)


def stillbox_velocity(config: StillBoxConfig, seed: int, number: int) -> Floats:
    """Velocity at each frame of scene `number`, always the same, m/s in world axes, shape [F, 3]."""
    direction = chance.unit_vector(chance.stream(seed, number))
    return np.repeat((config.speed_m_s * direction)[None], config.frames, axis=0)


@dataclass(frozen=True)
class _Object:
    shape: Shape
    world_from_object: Floats
    torus_radius: float


def _camera_path(rng: np.random.Generator, config: StillBoxConfig) -> Floats:
    """Positions at constant velocity in a uniformly random direction, [F, 3], first at the origin."""
    steps = np.arange(config.frames, dtype=np.float64)[:, None]
    return np.asarray(steps * config.step_m * chance.unit_vector(rng))


def _room(rng: np.random.Generator, config: StillBoxConfig, path: Floats) -> tuple[Floats, Floats]:
    """A randomly turned box round the path: half edges [3] and pose [3, 4]."""
    half = rng.uniform(*config.room_half_m, 3)
    turn = chance.rotation(rng)
    # Where none is free, the room's centre is the path's.
    free = np.maximum(half - config.clearance_m - config.path_length_m, 0.0)
    centre = path.mean(axis=0) + chance.turned(turn, rng.uniform(-0.75, 0.75, 3) * free)
    return half, np.column_stack([turn, centre])


def _object(
    rng: np.random.Generator, config: StillBoxConfig, path: Floats, height_per_width: float
) -> _Object | None:
    """One shape in or near the field of view, clear of the path; None when no place was found."""
    reach = float(np.float32(np.tan(np.radians(config.horizontal_fov_deg) / 2) * 1.15))
    reach_y = reach * height_per_width
    shape = Shape(int(rng.integers(len(Shape))))
    torus_radius = float(rng.uniform(0.15, 0.45)) if shape is Shape.TORUS else 0.0
    for _ in range(MOST_TRIES):
        distance = chance.log_uniform(rng, *config.distance_m)
        size = distance * rng.uniform(*config.angular_size)
        aspect = rng.uniform(0.45, 1.0, 3)
        centre = distance * np.array([rng.uniform(-reach, reach), rng.uniform(-reach_y, reach_y), 1.0])
        if config.objects_ahead_of == "path":
            centre = centre + path[int(rng.integers(len(path)))]
        turn = chance.rotation(rng)
        radius = size * float(aspect.max()) * (BOUND_RADIUS[shape] + torus_radius)
        if _gap_m(path, centre, config.clearance_m) > radius + config.clearance_m:
            return _Object(shape, np.column_stack([turn * (size * aspect), centre]), torus_radius)
    return None


def _gap_m(path: Floats, point: Floats, fine_m: float) -> float:
    """Least distance from a straight path [F, 3] to a point, metres.

    Where steps are at most `fine_m` long, the positions stand for the path: with the clearance for `fine_m` a surface
    comes at most 14 % nearer between two of them (0.1 % at the default step). Else every point of the path counts.
    """
    flown = path[-1] - path[0]
    length = np.sqrt((flown * flown).sum())
    if length <= fine_m * (len(path) - 1):
        return float(np.linalg.norm(path - point, axis=1).min())
    share = np.clip(((point - path[0]) * flown).sum() / (length * length), 0.0, 1.0)
    return float(np.linalg.norm(path[0] + share * flown - point))


def _lamps(
    rng: np.random.Generator, config: StillBoxConfig, half: Floats, world_from_room: Floats
) -> tuple[Floats, Floats]:
    """Point lamps inside the room, two in three close to a wall, where they leave a bright glow."""
    count = int(rng.integers(config.lamps[0], config.lamps[1] + 1))
    places, powers = np.empty((count, 3)), np.empty((count, 3))
    for lamp in range(count):
        inside = rng.uniform(-0.9, 0.9, 3)
        at_wall = rng.random() < 2 / 3
        if at_wall:
            wall = int(rng.integers(6))
            inside[wall // 2] = (2 * (wall % 2) - 1) * rng.uniform(0.86, 0.95)
        places[lamp] = chance.turned(world_from_room[:, :3], inside * half) + world_from_room[:, 3]
        reach = rng.uniform(0.4, 1.0) * half.mean() / np.sqrt(count)
        powers[lamp] = rng.uniform(0.8, 1.0, 3) * (reach * reach * rng.uniform(0.8, 2.0))
    return places, powers


class _Palette:
    """Materials as they are drawn."""

    def __init__(self, rng: np.random.Generator, texture_ratio: float, texture_count: int) -> None:
        self._rng, self._ratio, self._count = rng, texture_ratio, texture_count
        self._rows: list[tuple[int, Floats, float, float, int]] = []

    def add(self, *, highlight: bool) -> int:
        """Draw a textured or a plain (pastel) surface; its number."""
        rng = self._rng
        textured = rng.random() < self._ratio and self._count > 0
        texture = int(rng.integers(self._count)) if textured else -1
        pastel = np.clip(rng.uniform(0.25, 0.85) + rng.uniform(-0.25, 0.25, 3), 0.04, 0.95)
        colour = np.full(3, rng.uniform(0.75, 1.0)) if textured else pastel
        specular = rng.uniform(0.3, 1.5) if highlight and not textured else 0.0
        repeat = float(rng.choice([1.0, 1.0, 1.0, 2.0, 3.0])) if highlight else 1.0
        self._rows.append((texture, colour, specular, repeat, int(rng.integers(4))))
        return len(self._rows) - 1

    def materials(self) -> Materials:
        """All that was drawn, as arrays."""
        texture, colour, specular, repeat, turn = zip(*self._rows, strict=True)
        return Materials(
            texture=np.array(texture, dtype=np.int64),
            colour=np.array(colour),
            specular=np.array(specular, dtype=np.float64),
            repeats=np.array(repeat),
            turn=np.array(turn, dtype=np.int64),
        )
