"""What each pixel's centre sees: object by object, nearest first, over the pixels its outline covers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flightdepth.renderers.compiling import compiled
from flightdepth.renderers.intersections import hit_shape
from flightdepth.renderers.view import Records
from flightdepth.scenes.scene import Floats, Ints

SKY = -1  # what a ray hits besides the objects 0 .. K - 1 and the room, K
Labels = NDArray[np.int32]  # PARTS * thing + part
PARTS = 8
SPARE = 1e-3  # pixels by which an outline is widened, against rounding


@compiled
def trace_picture(cameras: Records, things: Records, near_to_far: Ints, depth: Floats, label: Labels) -> None:
    """Fill depth and label [H + 2, W + 2]: the picture with a border of one pixel, to see edges across it."""
    rows, columns = depth.shape
    _trace_background(cameras, things, depth, label)
    for k in near_to_far:
        thing = things[k]
        for i in range(max(thing.top + 1, 0), min(thing.bottom + 1, rows)):
            y = (i - 1 - cameras[0].cy) / cameras[0].fy
            first, last = _covered(cameras, thing, y, columns)
            for j in range(first, last):
                if thing.nearest < depth[i, j]:
                    x = (j - 1 - cameras[0].cx) / cameras[0].fx
                    t, part = hit_thing(things, k, x, y, depth[i, j])
                    if t < depth[i, j]:
                        depth[i, j], label[i, j] = t, PARTS * k + part


@compiled
def _trace_background(cameras: Records, things: Records, depth: Floats, label: Labels) -> None:
    """The room's walls, or the sky, in every pixel."""
    rows, columns = depth.shape
    room = len(things) - 1
    for i in range(rows):
        y = (i - 1 - cameras[0].cy) / cameras[0].fy
        for j in range(columns):
            if cameras[0].has_room:
                t, part = hit_thing(things, room, (j - 1 - cameras[0].cx) / cameras[0].fx, y, math.inf)
                depth[i, j], label[i, j] = t, PARTS * room + part
            else:
                depth[i, j], label[i, j] = math.inf, PARTS * SKY


@compiled
def _covered(cameras: Records, thing: Any, y: float, columns: int) -> tuple[int, int]:
    """Columns of the bordered picture, first and last + 1, where a row at height y may see an object.

    The outline is a x^2 + 2 b x + c >= 0 along a row; a >= 0 means that it is no ellipse (the object reaches the
    camera's plane), and the row is searched all along.
    """
    first, last = max(thing.left + 1, 0), min(thing.right + 1, columns)
    a = thing.outline_00
    b = thing.outline_01 * y + thing.outline_02
    c = (thing.outline_11 * y + 2.0 * thing.outline_12) * y + thing.outline_22
    if a >= 0.0 or thing.nearest <= 0.0:
        return first, last
    disc = b * b - a * c
    if disc < -1e-9 * b * b:
        return 0, 0
    root = math.sqrt(max(disc, 0.0))
    scale = cameras[0].fx / a
    low = (-b + root) * scale + cameras[0].cx - SPARE
    high = (-b - root) * scale + cameras[0].cx + SPARE
    return max(first, math.ceil(low) + 1), min(last, math.floor(high) + 2)


@compiled
def hit_thing(things: Records, k: int, x: float, y: float, t_max: float) -> tuple[float, int]:
    """z-depth and part where the ray (x, y, 1) meets thing k before t_max, or (infinity, 0)."""
    thing = things[k]
    dx = thing.ray_00 * x + thing.ray_01 * y + thing.ray_02
    dy = thing.ray_10 * x + thing.ray_11 * y + thing.ray_12
    dz = thing.ray_20 * x + thing.ray_21 * y + thing.ray_22
    return hit_shape(
        thing.shape,
        thing.torus_radius,
        thing.origin_0,
        thing.origin_1,
        thing.origin_2,
        dx,
        dy,
        dz,
        0.0,
        t_max,
    )
