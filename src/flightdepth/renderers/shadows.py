"""Which objects keep a lamp's light from the hits of a bundle."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flightdepth.renderers.compiling import compiled
from flightdepth.renderers.intersections import (
    CONE,
    CUBE,
    SPHERE,
    TORUS,
    Ray,
    hit_cone,
    hit_cube,
    hit_sphere,
)
from flightdepth.renderers.tori import hit_tori
from flightdepth.renderers.view import Records

Lists = NDArray[np.int16]  # [L, K + 1] for each lamp a count, then that many object numbers
LIT = -1
LIFT_M = 1e-4  # a shadow ray starts this far above its surface


@compiled
def list_blockers(
    things: Records, lamps: Records, receiver: int, x: float, y: float, z: float, radius: float, lists: Lists
) -> None:
    """List for each lamp the objects that may shade points on `receiver` within `radius` of (x, y, z).

    Such an object's bounding sphere, widened by the radius, meets the line from (x, y, z) to the lamp.
    """
    for lamp in range(len(lamps)):
        lx, ly, lz = lamps[lamp].position_0 - x, lamps[lamp].position_1 - y, lamps[lamp].position_2 - z
        inverse = 1.0 / (lx * lx + ly * ly + lz * lz)
        count = 0
        for k in range(len(things) - 1):
            if k == receiver and things[k].shape != TORUS:
                continue  # a convex surface that faces the lamp does not shade itself
            cx, cy, cz = things[k].centre_0 - x, things[k].centre_1 - y, things[k].centre_2 - z
            near = min(max((cx * lx + cy * ly + cz * lz) * inverse, 0.0), 1.0)
            ax, ay, az = cx - near * lx, cy - near * ly, cz - near * lz
            reach = things[k].bound + radius
            if ax * ax + ay * ay + az * az <= reach * reach:
                count += 1
                lists[lamp, count] = k
        lists[lamp, 0] = count


@compiled
def aim(lamps: Records, lamp: int, bundles: Records, count: int) -> None:
    """The way from each hit to a lamp; light is awaited everywhere."""
    rays = bundles[0]
    x, y, z = lamps[lamp].position_0, lamps[lamp].position_1, lamps[lamp].position_2
    for i in range(count):
        lx, ly, lz = x - rays.px[i], y - rays.py[i], z - rays.pz[i]
        square = lx * lx + ly * ly + lz * lz
        away = 1.0 / math.sqrt(square)
        rays.lx[i], rays.ly[i], rays.lz[i] = lx, ly, lz
        rays.square[i], rays.inverse[i], rays.away[i] = square, 1.0 / square, away
        rays.cosine[i] = (rays.nx[i] * lx + rays.ny[i] * ly + rays.nz[i] * lz) * away
        rays.waits[i], rays.blocker[i] = 1, LIT


@compiled
def cast_shadow(things: Records, k: int, bundles: Records, count: int) -> None:
    """Name object k as `blocker` where light is awaited, not yet blocked, and k stands in its way."""
    if not _passes_close(things, k, bundles, count):
        return
    _enter_object(things, k, bundles, count)
    rays, shape, radius = bundles[0], things[k].shape, things[k].torus_radius
    if shape == CUBE:
        for i in range(count):
            t, _ = hit_cube(*_way(bundles, i), 0.0, 1.0)
            rays.blocker[i] = k if (rays.close[i] != 0) & (t < 1.0) else rays.blocker[i]
    elif shape == SPHERE:
        for i in range(count):
            t, _ = hit_sphere(*_way(bundles, i), 0.0, 1.0)
            rays.blocker[i] = k if (rays.close[i] != 0) & (t < 1.0) else rays.blocker[i]
    elif shape == CONE:
        for i in range(count):
            t, _ = hit_cone(*_way(bundles, i), 0.0, 1.0)
            rays.blocker[i] = k if (rays.close[i] != 0) & (t < 1.0) else rays.blocker[i]
    else:
        for i in range(count):
            rays.far[i] = 1.0 if rays.close[i] != 0 else -math.inf
        hit_tori(radius, bundles, count)
        for i in range(count):
            rays.blocker[i] = k if rays.hit[i] < 1.0 else rays.blocker[i]


@compiled
def _passes_close(things: Records, k: int, bundles: Records, count: int) -> bool:
    """Fill `close`: where light is awaited through the bounding sphere of object k; whether it is anywhere."""
    rays, bound = bundles[0], things[k].bound * things[k].bound
    x, y, z = things[k].centre_0, things[k].centre_1, things[k].centre_2
    any_close = 0
    for i in range(count):
        cx = x - (rays.px[i] + LIFT_M * rays.nx[i])
        cy = y - (rays.py[i] + LIFT_M * rays.ny[i])
        cz = z - (rays.pz[i] + LIFT_M * rays.nz[i])
        near = (cx * rays.lx[i] + cy * rays.ly[i] + cz * rays.lz[i]) * rays.inverse[i]
        near = min(max(near, 0.0), 1.0)
        ax, ay, az = cx - near * rays.lx[i], cy - near * rays.ly[i], cz - near * rays.lz[i]
        inside = ax * ax + ay * ay + az * az <= bound
        close = rays.waits[i] if inside & (rays.blocker[i] == LIT) else 0
        rays.close[i] = close
        any_close |= close
    return any_close != 0


@compiled
def _enter_object(things: Records, k: int, bundles: Records, count: int) -> None:
    """The ways to the lamp in the space of object k, from just above the surface."""
    rays, a = bundles[0], things[k]
    w00, w01, w02, w03 = a.from_world_00, a.from_world_01, a.from_world_02, a.from_world_03
    w10, w11, w12, w13 = a.from_world_10, a.from_world_11, a.from_world_12, a.from_world_13
    w20, w21, w22, w23 = a.from_world_20, a.from_world_21, a.from_world_22, a.from_world_23
    for i in range(count):
        px, py = rays.px[i] + LIFT_M * rays.nx[i], rays.py[i] + LIFT_M * rays.ny[i]
        pz = rays.pz[i] + LIFT_M * rays.nz[i]
        lx, ly, lz = rays.lx[i], rays.ly[i], rays.lz[i]
        rays.ox[i] = w00 * px + w01 * py + w02 * pz + w03
        rays.oy[i] = w10 * px + w11 * py + w12 * pz + w13
        rays.oz[i] = w20 * px + w21 * py + w22 * pz + w23
        rays.dx[i] = w00 * lx + w01 * ly + w02 * lz
        rays.dy[i] = w10 * lx + w11 * ly + w12 * lz
        rays.dz[i] = w20 * lx + w21 * ly + w22 * lz


@compiled
def _way(bundles: Records, i: int) -> Ray:
    rays = bundles[0]
    return rays.ox[i], rays.oy[i], rays.oz[i], rays.dx[i], rays.dy[i], rays.dz[i]
