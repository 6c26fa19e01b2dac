"""Which objects keep a lamp's light from a point."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flightdepth.renderers.compiling import compiled
from flightdepth.renderers.intersections import TORUS, hit_shape
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
def first_blocker(
    things: Records, lists: Lists, lamp: int,
    px: float, py: float, pz: float,
    nx: float, ny: float, nz: float,
    lx: float, ly: float, lz: float,
) -> int:  # fmt: skip
    """A listed object between the point p with normal n and the lamp at p + l, or LIT."""
    px, py, pz = px + LIFT_M * nx, py + LIFT_M * ny, pz + LIFT_M * nz
    inverse = 1.0 / (lx * lx + ly * ly + lz * lz)
    for place in range(1, lists[lamp, 0] + 1):
        k = int(lists[lamp, place])
        thing = things[k]
        cx, cy, cz = thing.centre_0 - px, thing.centre_1 - py, thing.centre_2 - pz
        near = min(max((cx * lx + cy * ly + cz * lz) * inverse, 0.0), 1.0)
        ax, ay, az = cx - near * lx, cy - near * ly, cz - near * lz
        if ax * ax + ay * ay + az * az <= thing.bound * thing.bound and _stands_between(
            things, k, px, py, pz, lx, ly, lz
        ):
            return k
    return LIT


@compiled
def _stands_between(
    things: Records, k: int, px: float, py: float, pz: float, lx: float, ly: float, lz: float
) -> bool:
    """Whether the stretch from p to p + l meets object k."""
    a = things[k]
    t, _ = hit_shape(
        a.shape, a.torus_radius,
        a.from_world_00 * px + a.from_world_01 * py + a.from_world_02 * pz + a.from_world_03,
        a.from_world_10 * px + a.from_world_11 * py + a.from_world_12 * pz + a.from_world_13,
        a.from_world_20 * px + a.from_world_21 * py + a.from_world_22 * pz + a.from_world_23,
        a.from_world_00 * lx + a.from_world_01 * ly + a.from_world_02 * lz,
        a.from_world_10 * lx + a.from_world_11 * ly + a.from_world_12 * lz,
        a.from_world_20 * lx + a.from_world_21 * ly + a.from_world_22 * lz,
        0.0, 1.0,
    )  # fmt: skip
    return t < 1.0
