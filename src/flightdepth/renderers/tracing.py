"""What each pixel's centre sees: object by object, nearest first, over the pixels its outline covers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flightdepth.renderers.bundles import LANES
from flightdepth.renderers.compiling import compiled
from flightdepth.renderers.intersections import CUBE, SPHERE, TORUS, Ray, hit_cone, hit_cube, hit_sphere
from flightdepth.renderers.tori import hit_tori
from flightdepth.renderers.view import Records
from flightdepth.scenes.scene import Floats, Ints

SKY = -1  # what a ray hits besides the objects 0 .. K - 1 and the room, K
Labels = NDArray[np.int32]  # PARTS * thing + part
PARTS = 8
SPARE = 1e-3  # pixels by which an outline is widened, against rounding
# Origin, then the matrix of directions row by row.
Matrix = tuple[float, float, float, float, float, float, float, float, float, float, float, float]


@compiled
def trace_picture(
    cameras: Records, things: Records, near_to_far: Ints, across: Floats, down: Floats, bundles: Records,
    depth: Floats, label: Labels,
) -> None:  # fmt: skip
    """Fill depth and label [H + 2, W + 2]: the picture with a border of one pixel, to see edges across it.

    The ray of the pixel in row i and column j is (across[1, j], down[1, i], 1).
    """
    rows, columns = depth.shape
    for i in range(rows):
        depth[i, :] = math.inf
        label[i, :] = PARTS * SKY
    if cameras[0].has_room:
        for i in range(rows):
            _trace_row(things, len(things) - 1, across[1], down[1, i], depth[i], label[i])
    for k in near_to_far:
        if things[k].shape == TORUS:
            _trace_torus(cameras, things, k, across, down, bundles, depth, label)
            continue
        for i in range(max(things[k].top + 1, 0), min(things[k].bottom + 1, rows)):
            y = down[1, i]
            first, last = _covered(cameras, things[k], y, columns)
            _trace_row(things, k, across[1, first:last], y, depth[i, first:last], label[i, first:last])


@compiled
def _trace_row(things: Records, k: int, across: Floats, y: float, depth: Floats, label: Labels) -> None:
    """Show thing k in a stretch of a row wherever nothing nearer stands."""
    shape, name = things[k].shape, PARTS * k
    rays = rays_in_object(things, k)
    if shape == CUBE:
        for j in range(len(depth)):
            t, part = hit_cube(*ray_in_object(rays, across[j], y), 0.0, depth[j])
            label[j] = name + part if t < depth[j] else label[j]
            depth[j] = min(t, depth[j])
    elif shape == SPHERE:
        for j in range(len(depth)):
            t, part = hit_sphere(*ray_in_object(rays, across[j], y), 0.0, depth[j])
            label[j] = name + part if t < depth[j] else label[j]
            depth[j] = min(t, depth[j])
    else:
        for j in range(len(depth)):
            t, part = hit_cone(*ray_in_object(rays, across[j], y), 0.0, depth[j])
            label[j] = name + part if t < depth[j] else label[j]
            depth[j] = min(t, depth[j])


@compiled
def rays_in_object(things: Records, k: int) -> Matrix:
    """Origin and directions of thing k's rays; read once, before a loop that writes."""
    a = things[k]
    return (
        a.origin_0, a.origin_1, a.origin_2,
        a.ray_00, a.ray_01, a.ray_02, a.ray_10, a.ray_11, a.ray_12, a.ray_20, a.ray_21, a.ray_22,
    )  # fmt: skip


@compiled
def ray_in_object(rays: Matrix, x: float, y: float) -> Ray:
    """Origin and direction, in object space, of the ray (x, y, 1)."""
    ox, oy, oz, r00, r01, r02, r10, r11, r12, r20, r21, r22 = rays
    return ox, oy, oz, r00 * x + r01 * y + r02, r10 * x + r11 * y + r12, r20 * x + r21 * y + r22


@compiled
def _trace_torus(
    cameras: Records, things: Records, k: int, across: Floats, down: Floats, bundles: Records,
    depth: Floats, label: Labels,
) -> None:  # fmt: skip
    """Show torus k wherever nothing nearer stands: as many pixels at once as a bundle holds."""
    rays, thing, count = bundles[0], things[k], 0
    for i in range(max(thing.top + 1, 0), min(thing.bottom + 1, len(depth))):
        first, last = _covered(cameras, thing, down[1, i], depth.shape[1])
        for j in range(first, last):
            if thing.nearest < depth[i, j]:
                rays.row[count], rays.column[count] = i, j
                rays.x[count], rays.y[count], rays.far[count] = across[1, j], down[1, i], depth[i, j]
                count += 1
                if count == LANES:
                    _show_torus(things, k, bundles, count, depth, label)
                    count = 0
    _show_torus(things, k, bundles, count, depth, label)


@compiled
def _show_torus(things: Records, k: int, bundles: Records, count: int, depth: Floats, label: Labels) -> None:
    meet_torus(things, k, bundles, count)
    rays = bundles[0]
    for n in range(count):
        i, j = rays.row[n], rays.column[n]
        if rays.hit[n] < depth[i, j]:
            depth[i, j], label[i, j] = rays.hit[n], PARTS * k


@compiled
def meet_torus(things: Records, k: int, bundles: Records, count: int) -> None:
    """Fill `hit`: the z-depth where the rays (x, y, 1) meet torus k before `far`, or infinity."""
    rays, matrix = bundles[0], rays_in_object(things, k)
    for i in range(count):
        way = ray_in_object(matrix, rays.x[i], rays.y[i])
        rays.ox[i], rays.oy[i], rays.oz[i], rays.dx[i], rays.dy[i], rays.dz[i] = way
    hit_tori(things[k].torus_radius, bundles, count)


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
