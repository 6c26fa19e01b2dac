"""Compiled kernels asked for one ray, or for a few, at a time."""

from __future__ import annotations

import numpy as np

from flightdepth.renderers.bundles import BUNDLE, LANES, padded, place_hits
from flightdepth.renderers.intersections import hit_cone, hit_cube, hit_sphere
from flightdepth.renderers.tori import hit_tori
from flightdepth.renderers.tracing import PARTS, trace_picture
from flightdepth.renderers.view import place_things, prepare_cameras, prepare_world
from flightdepth.scenes.scene import Shape

ONE_BY_ONE = {Shape.CUBE: hit_cube, Shape.SPHERE: hit_sphere, Shape.CONE: hit_cone}


def filled(**columns) -> tuple[np.ndarray, int]:
    """A bundle with these columns, and how many rays it holds."""
    bundles, count = np.zeros(1, BUNDLE), len(next(iter(columns.values())))
    assert count <= LANES
    for name, values in columns.items():
        bundles[0][name][:count] = values
    return bundles, count


def tori_hits(radius: float, origins, directions, far=np.inf) -> np.ndarray:
    """First hits of rays, at most LANES, with a torus."""
    o, d = np.asarray(origins, float), np.asarray(directions, float)
    names = ("ox", "oy", "oz", "dx", "dy", "dz")
    bundles, count = filled(**dict(zip(names, (*o.T, *d.T), strict=True)))
    bundles[0]["far"][:count] = far
    hit_tori(radius, bundles, count)
    return bundles[0]["hit"][:count].copy()


def hit(shape: Shape, radius: float, o, d, *, t_max=np.inf) -> tuple[float, int]:
    """First hit and part of one ray with a unit primitive."""
    if shape is Shape.TORUS:
        return float(tori_hits(radius, [o], [d], t_max)[0]), 0
    return ONE_BY_ONE[shape](*o, *d, 0.0, t_max)


class Seen:
    """A scene laid out for the first camera position."""

    def __init__(self, scene, camera) -> None:
        world = prepare_world(scene)
        self.cameras = prepare_cameras(scene, camera, [0])
        self.things, self.lamps = world.things, world.lamps
        self.order = np.empty(len(self.things) - 1, np.int64)
        place_things(self.cameras, self.things, self.order)

    def trace(self, x, y) -> tuple[np.ndarray, np.ndarray]:
        """Depth and label of the rays (x[j], y[i], 1), [I, J]."""
        across, down = (
            np.repeat([np.asarray(x, float)], 3, axis=0),
            np.repeat([np.asarray(y, float)], 3, axis=0),
        )
        depth, label = np.empty((len(y), len(x))), np.empty((len(y), len(x)), np.int32)
        for edge in ("left", "top"):
            self.things[edge] = -1
        for edge in ("right", "bottom"):
            self.things[edge] = LANES
        self.things["outline_00"] = 0.0  # every column is searched
        trace_picture(self.cameras, self.things, self.order, across, down, np.zeros(1, BUNDLE), depth, label)
        return depth, label

    def place(self, label: int, x, y, t) -> tuple[np.ndarray, np.ndarray]:
        """Points and normals [N, 3] of hits that share a label."""
        bundles, count = filled(x=x, y=y, t=t)
        place_hits(self.cameras, self.things, label // PARTS, label % PARTS, bundles, padded(bundles, count))
        rays = bundles[0]
        points, normals = ([rays[a + b][:count] for b in "xyz"] for a in "pn")
        return np.stack(points, -1), np.stack(normals, -1)
