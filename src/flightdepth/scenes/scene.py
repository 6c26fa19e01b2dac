"""A scene: shapes, room or sky, materials, lamps and the camera's path, as plain arrays that a renderer reads."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MOST_LAMPS = 31  # a bit each says where they are dark
MOST_OBJECTS = np.iinfo(np.int16).max  # shadows name them by numbers of 16 bits


class Shape(IntEnum):
    """Unit primitives in object space; `world_from_object` scales, turns and moves them."""

    CUBE = 0  # |x|, |y|, |z| <= 1
    SPHERE = 1  # radius 1
    CONE = 2  # base of radius 1 at z = -1, apex at z = 1
    TORUS = 3  # major radius 1 round the z axis, minor radius `torus_radius`


# Radius of a sphere round the origin that holds the unit primitive (a torus adds its minor radius).
BOUND_RADIUS = {Shape.CUBE: 3**0.5, Shape.SPHERE: 1.0, Shape.CONE: 2**0.5, Shape.TORUS: 1.0}


@dataclass(frozen=True)
class Materials:
    """Surfaces. Colours are linear RGB in 0..1.

    texture   [M] int   index into the textures, -1 for plain
    colour    [M, 3]    albedo of a plain surface, tint of a textured one
    specular  [M]       strength of the highlight, 0 for none
    repeats   [M]       how often the texture repeats over the surface
    turn      [M] int   texture turned by 0..3 quarter turns
    """

    texture: Ints
    colour: Floats
    specular: Floats
    repeats: Floats
    turn: Ints


@dataclass(frozen=True)
class Scene:
    """One rigid scene and a flight through it. Metres; the world frame has the axes of OpenCV's camera.

    shape               [K] int      a `Shape` each
    world_from_object   [K, 3, 4]    scale, rotation and position
    torus_radius        [K]          minor radius of a torus, 0 elsewhere
    object_material     [K] int
    room_half           [3]          half the edges of the closed room; all infinite for an open sky
    world_from_room     [3, 4]       rotation and centre
    room_material       [6] int      walls -x, +x, -y, +y, -z, +z
    lamp_position       [L, 3]
    lamp_power          [L, 3]       linear RGB times square metres: irradiance = power / distance^2
    ambient             [3]          light that comes from everywhere
    sky_colour          [2, 3]       horizon and zenith, linear RGB, where there is no room
    camera_position     [F, 3]
    world_from_camera   [F, 3, 3]
    """

    shape: Ints
    world_from_object: Floats
    torus_radius: Floats
    object_material: Ints
    room_half: Floats
    world_from_room: Floats
    room_material: Ints
    materials: Materials
    lamp_position: Floats
    lamp_power: Floats
    ambient: Floats
    sky_colour: Floats
    camera_position: Floats
    world_from_camera: Floats

    def __post_init__(self) -> None:
        objects, frames = len(self.shape), len(self.camera_position)
        expected = {
            "world_from_object": (objects, 3, 4),
            "torus_radius": (objects,),
            "object_material": (objects,),
            "room_half": (3,),
            "world_from_room": (3, 4),
            "room_material": (6,),
            "lamp_power": (len(self.lamp_position), 3),
            "ambient": (3,),
            "sky_colour": (2, 3),
            "world_from_camera": (frames, 3, 3),
        }
        for name, shape in expected.items():
            if getattr(self, name).shape != shape:
                raise ValueError(f"{name}: expected shape {shape}, got {getattr(self, name).shape}")
        worn, known = np.concatenate([self.object_material, self.room_material]), len(self.materials.texture)
        if worn.min() < 0 or worn.max() >= known:
            raise ValueError(f"materials: expected numbers 0..{known - 1}, got {worn.min()}..{worn.max()}")
        for array in (*_arrays(self), *_arrays(self.materials)):
            array.setflags(write=False)

    @property
    def frames(self) -> int:
        """Number of camera positions."""
        return len(self.camera_position)

    @property
    def is_open(self) -> bool:
        """Whether there is no room, but a sky."""
        return not bool(np.isfinite(self.room_half).all())

    def displacement(self, previous: int, current: int) -> Floats:
        """Position at frame `current` minus that at `previous`, metres, in `current`'s orientation, shape (3,).

        With orientation noise `previous` is turned a little against `current`, as on a gimbal; that is left in.
        """
        return displacement(self.camera_position, self.world_from_camera, previous, current)

    def with_object(
        self, shape: Shape, pose: Floats, *, texture: int, colour: Floats, repeats: float
    ) -> Scene:
        """The scene with one object more, matt and no torus: `pose` [3, 4], and what it wears, as in `Materials`."""
        worn = self.materials
        return replace(
            self,
            shape=np.append(self.shape, int(shape)),
            world_from_object=np.concatenate([self.world_from_object, pose[None]]),
            torus_radius=np.append(self.torus_radius, 0.0),
            object_material=np.append(self.object_material, len(worn.texture)),
            materials=Materials(
                texture=np.append(worn.texture, texture),
                colour=np.concatenate([worn.colour, colour[None]]),
                specular=np.append(worn.specular, 0.0),
                repeats=np.append(worn.repeats, repeats),
                turn=np.append(worn.turn, 0),
            ),
        )

    def unit_bound_radii(self) -> Floats:
        """Radius, in object space, of a sphere round the origin that holds each object, shape [K]."""
        return np.array([BOUND_RADIUS[Shape(s)] for s in self.shape]) + self.torus_radius

    def bound_radii_m(self) -> Floats:
        """Radius of a sphere round each object's centre that holds it, shape [K], metres."""
        scale = np.linalg.norm(self.world_from_object[:, :, :3], axis=1).max(axis=1, initial=0.0)
        return np.asarray(self.unit_bound_radii() * scale)


def displacement(position: Floats, world_from_camera: Floats, previous: int, current: int) -> Floats:
    """Of two frames of a path, positions [F, 3] and orientations [F, 3, 3]: see `Scene.displacement`."""
    moved = position[current] - position[previous]
    return np.asarray(moved @ world_from_camera[current])


def _arrays(holder: Scene | Materials) -> list[NDArray[np.generic]]:
    values = [getattr(holder, field.name) for field in fields(holder)]
    return [value for value in values if isinstance(value, np.ndarray)]
