"""Small scenes put together by hand."""

from __future__ import annotations

import numpy as np

from flightdepth.scenes.scene import Materials, Scene, Shape
from flightdepth.scenes.textures import Textures

NO_TEXTURES = Textures.from_images([])
GREY = 0.5


def pose(scale, position, turn=None) -> np.ndarray:
    turn = np.eye(3) if turn is None else turn
    return np.column_stack([turn * np.asarray(scale, float), np.asarray(position, float)])


def turned_by(seed: int) -> np.ndarray:
    q, r = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else q[:, ::-1]


def built(
    objects=(),
    *,
    room=(20.0, 20.0, 20.0),
    lamps=((0.0, -5.0, 0.0),),
    power=40.0,
    ambient=0.1,
    path=None,
    texture=-1,
) -> Scene:
    """`objects` are (shape, pose, torus radius); everything is matt and grey; `room` None opens the sky."""
    path = np.zeros((1, 3)) if path is None else np.asarray(path, float)
    materials = Materials(
        texture=np.array([texture]),
        colour=np.full((1, 3), GREY),
        specular=np.zeros(1),
        repeats=np.ones(1),
        turn=np.zeros(1, np.int64),
    )
    return Scene(
        shape=np.array([int(o[0]) for o in objects], dtype=np.int64),
        world_from_object=np.array([o[1] for o in objects]).reshape(-1, 3, 4),
        torus_radius=np.array([o[2] for o in objects], dtype=np.float64),
        object_material=np.zeros(len(objects), np.int64),
        room_half=np.full(3, np.inf) if room is None else np.asarray(room, float),
        world_from_room=pose(np.ones(3), np.zeros(3)),
        room_material=np.zeros(6, np.int64),
        materials=materials,
        lamp_position=np.asarray(lamps, float).reshape(-1, 3),
        lamp_power=np.full((len(lamps), 3), power),
        ambient=np.full(3, ambient),
        sky_colour=np.array([[0.8, 0.8, 0.8], [0.1, 0.2, 0.9]]),
        camera_position=path,
        world_from_camera=np.repeat(np.eye(3)[None], len(path), axis=0),
    )


SHAPES = {
    Shape.CUBE: 0.0,
    Shape.SPHERE: 0.0,
    Shape.CONE: 0.0,
    Shape.TORUS: 0.3,
}
