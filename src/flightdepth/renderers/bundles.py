"""Rays that hit the same face of the same thing, worked on side by side: a column for each quantity.

Loops over such columns have no branches, so that the compiler takes several rays at once; the sums of each ray
stay the same. The columns stand in one record: their distances are known to the compiler, so it need not fear
that they overlap.
"""

from __future__ import annotations

import math

import numpy as np

from flightdepth.renderers.compiling import compiled
from flightdepth.renderers.intersections import CONE, CUBE, SPHERE, TORUS
from flightdepth.renderers.surfaces import normal_in_object
from flightdepth.renderers.view import Records

LANES = 64  # most rays in a bundle
STRIDE = 8  # the loops run to a multiple of this, the widest vector of any processor
FLOATS = (
    *("x", "y", "t"),  # the ray (x, y, 1) and its depth
    *("qx", "qy", "qz"),  # the hit in object space
    *("px", "py", "pz", "nx", "ny", "nz"),  # the hit and its unit normal, world
    *("vx", "vy", "vz", "facing"),  # to the viewer, unit length, and its cosine with the normal
    *("u", "v", "footprint"),  # place on a texture, width of a pixel there
    *("red", "green", "blue"),  # albedo
    *("lx", "ly", "lz", "cosine"),  # to a lamp, and its cosine with the normal
    *("square", "inverse", "away"),  # distance of the lamp: squared, 1 / squared, 1 / distance
    *("shine", "r", "g", "b"),  # highlight, light to the viewer
    *("ox", "oy", "oz", "dx", "dy", "dz"),  # a ray in the space of an object
    *("far", "hit"),  # end of the interval of t that counts, first t in it where the object is met
    *("p", "q", "s", "shift", "length"),  # quartic of a torus, see tori.py
    # What its roots are searched with.
    *("low", "high", "a", "f_a", "u0", "u1", "f0", "root", "c0", "c1", "f_c0", "f_c1", "g_c0", "g_c1"),
)
INTS = (
    "seen",  # label
    "waits",  # 1 where a lamp's light may arrive
    "close",  # 1 where the way to the lamp passes the bound of an object
    "blocker",  # the object that keeps the lamp's light away, or -1
    "dark",  # bit mask of the lamps whose light is kept away
    "doubt",  # bit mask of the lamps for which that is asked
    # 1 where a torus' root is looked for, where a dip below zero is, where it is bracketed.
    *("open", "dips", "found"),
)
PLACES = ("row", "column")  # of the pixel in the bordered picture; never negative
KINDS = (("f8", FLOATS), ("i8", INTS), ("u8", PLACES))
BUNDLE = np.dtype([(name, kind, (LANES,)) for kind, names in KINDS for name in names])


@compiled
def padded(bundles: Records, count: int) -> int:
    """Fill up to a multiple of STRIDE with copies of the first ray; the number of rays then."""
    rays = bundles[0]
    full = (count + STRIDE - 1) // STRIDE * STRIDE
    for i in range(count, full):
        rays.x[i], rays.y[i], rays.t[i] = rays.x[0], rays.y[0], rays.t[0]
    return full


@compiled
def place_hits(cameras: Records, things: Records, k: int, part: int, bundles: Records, count: int) -> None:
    """Where the rays hit face `part` of thing k: in object space, in the world, and the normal there.

    The normal has unit length and points to the viewer's side.
    """
    _into_object(things, k, bundles, count)
    _object_normals(things[k].shape, part, bundles, count)
    _into_world(cameras, things, k, bundles, count)


@compiled
def _into_object(things: Records, k: int, bundles: Records, count: int) -> None:
    rays, a = bundles[0], things[k]
    o0, o1, o2 = a.origin_0, a.origin_1, a.origin_2
    r00, r01, r02 = a.ray_00, a.ray_01, a.ray_02
    r10, r11, r12 = a.ray_10, a.ray_11, a.ray_12
    r20, r21, r22 = a.ray_20, a.ray_21, a.ray_22
    for i in range(count):
        x, y, t = rays.x[i], rays.y[i], rays.t[i]
        rays.qx[i] = o0 + t * (r00 * x + r01 * y + r02)
        rays.qy[i] = o1 + t * (r10 * x + r11 * y + r12)
        rays.qz[i] = o2 + t * (r20 * x + r21 * y + r22)


@compiled
def _object_normals(shape: int, part: int, bundles: Records, count: int) -> None:
    """Outward normals (not of unit length) of a unit primitive, object space."""
    # The shape is named anew in each branch: so the compiler knows it inside the loop.
    if shape == CUBE:
        for i in range(count):
            _write_normal(CUBE, part, bundles, i)
    elif shape == SPHERE:
        for i in range(count):
            _write_normal(SPHERE, part, bundles, i)
    elif shape == CONE:
        for i in range(count):
            _write_normal(CONE, part, bundles, i)
    else:
        for i in range(count):
            _write_normal(TORUS, part, bundles, i)


@compiled
def _write_normal(shape: int, part: int, bundles: Records, i: int) -> None:
    rays = bundles[0]
    normal = normal_in_object(shape, part, rays.qx[i], rays.qy[i], rays.qz[i])
    rays.nx[i], rays.ny[i], rays.nz[i] = normal


@compiled
def _into_world(cameras: Records, things: Records, k: int, bundles: Records, count: int) -> None:
    rays, a, c = bundles[0], things[k], cameras[0]
    p0, p1, p2 = c.position_0, c.position_1, c.position_2
    t00, t01, t02, t10, t11, t12 = c.turn_00, c.turn_01, c.turn_02, c.turn_10, c.turn_11, c.turn_12
    t20, t21, t22 = c.turn_20, c.turn_21, c.turn_22
    w00, w01, w02, w10, w11, w12 = (
        a.from_world_00, a.from_world_01, a.from_world_02, a.from_world_10, a.from_world_11, a.from_world_12,
    )  # fmt: skip
    w20, w21, w22 = a.from_world_20, a.from_world_21, a.from_world_22
    for i in range(count):
        x, y, t = rays.x[i], rays.y[i], rays.t[i]
        dx, dy, dz = t00 * x + t01 * y + t02, t10 * x + t11 * y + t12, t20 * x + t21 * y + t22
        rays.px[i], rays.py[i], rays.pz[i] = p0 + t * dx, p1 + t * dy, p2 + t * dz
        ex, ey, ez = rays.nx[i], rays.ny[i], rays.nz[i]
        nx, ny, nz = (
            w00 * ex + w10 * ey + w20 * ez,
            w01 * ex + w11 * ey + w21 * ez,
            w02 * ex + w12 * ey + w22 * ez,
        )
        scale = 1.0 / max(math.sqrt(nx * nx + ny * ny + nz * nz), 1e-300)
        scale = -scale if nx * dx + ny * dy + nz * dz > 0.0 else scale
        rays.nx[i], rays.ny[i], rays.nz[i] = nx * scale, ny * scale, nz * scale
