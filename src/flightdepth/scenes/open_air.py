"""A Still Box scene without its room: the same objects over open ground, under a sun and a sky.

Closed rooms never show what every drone sees: ground that runs to a horizon, and a sky in which nothing moves
however far one flies. Networks for flights are trained on some of these besides the rooms.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flightdepth.scenes import chance
from flightdepth.scenes.scene import Floats, Scene, Shape

GROUND_HALF_M = 400.0  # the ground is the top of a cube
SUN_DISTANCE_M = 2000.0
HEIGHT_M = (2.2, 40.0)  # of the camera over the ground, log-uniform
TILE_M = (3.0, 40.0)  # edge of the ground's texture, log-uniform


def opened(scene: Scene, texture_count: int, rng: np.random.Generator, clearance_m: float) -> Scene:
    """`scene` in the open: no room, no lamps; ground, sun, sky. Objects below the ground vanish in it.

    The ground lies at least `clearance_m` below the path, which sinks as it was drawn.
    """
    turn = _tilt(rng)
    up = -turn[:, 1]
    sinks_m = -float((scene.camera_position @ up).min())
    below_m = GROUND_HALF_M + chance.log_uniform(rng, *HEIGHT_M)
    below_m += max(0.0, sinks_m + clearance_m - HEIGHT_M[0])
    ground = np.column_stack([turn * GROUND_HALF_M, -up * below_m])
    to_sun = chance.unit_vector(rng) * 0.7 + up
    to_sun /= np.sqrt((to_sun * to_sun).sum())
    horizon = rng.uniform(0.3, 0.95) * rng.uniform([0.85, 0.9, 0.95], 1.0)
    with_ground = scene.with_object(
        Shape.CUBE,
        ground,
        texture=int(rng.integers(texture_count)) if texture_count else -1,
        colour=np.full(3, rng.uniform(0.5, 1.0)),
        repeats=2 * GROUND_HALF_M / chance.log_uniform(rng, *TILE_M),
    )
    return replace(
        with_ground,
        room_half=np.full(3, np.inf),
        lamp_position=(to_sun * SUN_DISTANCE_M)[None],
        lamp_power=np.full((1, 3), rng.uniform(0.3, 1.2) * SUN_DISTANCE_M**2),
        ambient=rng.uniform(0.2, 0.5) * np.array([0.9, 0.95, 1.0]),
        sky_colour=np.stack([horizon, horizon * rng.uniform([0.4, 0.55, 0.75], 1.0)]),
    )


def _tilt(rng: np.random.Generator) -> Floats:
    """World from ground: pitched by up to 30 degrees and rolled by up to 9, any heading; y points down."""
    pitch, roll, heading = rng.uniform(-1, 1, 3) * np.array([0.52, 0.16, np.pi])
    (cp, sp), (cr, sr), (ch, sh) = ((np.cos(a), np.sin(a)) for a in (pitch, roll, heading))
    about_x = np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])
    about_z = np.array([[cr, -sr, 0], [sr, cr, 0], [0, 0, 1]])
    about_y = np.array([[ch, 0, sh], [0, 1, 0], [-sh, 0, ch]])
    # float32 and back: where libraries of mathematics agree.
    return np.asarray((about_x @ about_z @ about_y).astype(np.float32), dtype=np.float64)
