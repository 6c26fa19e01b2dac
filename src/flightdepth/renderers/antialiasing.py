"""Edges: 2x2 rays decide what a pixel shows, colours come from the pixel centres around (multisampling).

Inside a surface the mip-mapped texture and the light are smooth, so a ray's surface is shaded where a pixel
centre nearby has seen it already. Only a surface or a shadow that no centre around has seen is shaded anew.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flightdepth.renderers.bundles import STRIDE, padded, place_hits
from flightdepth.renderers.compiling import compiled
from flightdepth.renderers.intersections import CONE, CUBE, SPHERE, TORUS, hit_cone, hit_cube, hit_sphere
from flightdepth.renderers.shading import Blockers, Colours, shade, sky_colour
from flightdepth.renderers.shadows import LIT, Lists, aim, cast_shadow, list_blockers
from flightdepth.renderers.surfaces import Vec3
from flightdepth.renderers.tracing import PARTS, SKY, Labels, meet_torus, ray_in_object, rays_in_object
from flightdepth.renderers.view import Records
from flightdepth.scenes.scene import Floats

FOLD = 0.05  # relative step in depth within one torus that counts as an edge
ROW_STEP, COLUMN_STEP = (0, 0, -1, 1, 0), (0, -1, 0, 0, 1)  # a pixel and its neighbours
QUAD, NEAR = 4, 5  # rays through a pixel, pixels that are asked
AROUND = np.dtype(  # what a pixel and its neighbours show
    [(f, "u8", (NEAR,)) for f in ("row", "column")]
    + [("depth", "f8", (NEAR,)), ("label", "i8", (NEAR,)), ("dark", "i8", (NEAR,))]
)


@compiled
def mark_edges(label: Labels, dark: Labels, row: int, edge: NDArray[np.bool_]) -> None:
    """Fill edge [W + 2]: whether one of the four neighbours shows another thing, face or shadow."""
    here, above, below = label[row], label[row - 1], label[row + 1]
    dark_here, dark_above, dark_below = dark[row], dark[row - 1], dark[row + 1]
    for j in range(1, len(edge) - 1):
        other = (
            (here[j] ^ here[j - 1]) | (here[j] ^ here[j + 1]) | (here[j] ^ above[j]) | (here[j] ^ below[j])
        )
        light = dark_here[j]
        mixed = (light ^ dark_here[j - 1]) | (light ^ dark_here[j + 1]) | (light ^ dark_above[j])
        edge[j] = (other | mixed | (light ^ dark_below[j])) != 0


@compiled
def is_fold(things: Records, depth: Floats, label: Labels, row: int, column: int) -> bool:
    """Whether the pixel shows a torus, the only shape that hides a part of itself, and a neighbour another part."""
    here, near = label[row, column], depth[row, column]
    if here == PARTS * SKY or things[here // PARTS].shape != TORUS:
        return False
    folds = False
    for i in range(1, NEAR):
        folds |= abs(depth[row + ROW_STEP[i], column + COLUMN_STEP[i]] - near) > FOLD * near
    return folds


@compiled
def supersample(
    cameras: Records, things: Records, materials: Records, lamps: Records, lists: Lists,
    texels: NDArray[np.uint8], across: Floats, down: Floats, depth: Floats, label: Labels,
    colour: Colours, dark: Labels, blockers: Blockers,
    around: Records, quads: Records, bundles: Records, found: Blockers, row: int, column: int,
) -> Vec3:  # fmt: skip
    """Mean linear colour of 2x2 rays through the pixel whose place in the bordered picture is (row, column)."""
    r, g, b = 0.0, 0.0, 0.0
    quad, near = quads[0], around[0]
    mixed = _look_around(depth, label, dark, row, column, around)
    # Within one smooth surface in one light, the pixel's own colour will do.
    plain = mixed == 0 and (near.label[0] == PARTS * SKY or things[near.label[0] // PARTS].shape != TORUS)
    _trace_quad(things, across, down, row, column, around, quads)
    _light_quad(cameras, things, lamps, blockers, mixed, around, quads)
    for i in range(QUAD):
        seen, place = quad.seen[i], 0
        if not plain or seen != near.label[0]:
            place = _seen_by(around, seen, quad.t[i], quad.doubt[i], quad.dark[i])
        if place >= 0:
            i1, j1 = near.row[place], near.column[place]
            r1, g1, b1 = colour[i1, j1, 0], colour[i1, j1, 1], colour[i1, j1, 2]
        elif seen == PARTS * SKY:
            r1, g1, b1 = sky_colour(cameras, quad.x[i], quad.y[i])
        else:
            r1, g1, b1 = _shade_anew(
                cameras, things, materials, lamps, lists, texels, seen, quad.x[i], quad.y[i], quad.t[i],
                bundles, found,
            )  # fmt: skip
        r, g, b = r + 0.25 * r1, g + 0.25 * g1, b + 0.25 * b1
    return r, g, b


@compiled
def _look_around(depth: Floats, label: Labels, dark: Labels, row: int, column: int, around: Records) -> int:
    """Note what a pixel and its neighbours show; bit mask of the lamps that reach some of them, and others not."""
    near, mixed = around[0], 0
    for n in range(NEAR):
        i, j = np.uintp(row + ROW_STEP[n]), np.uintp(column + COLUMN_STEP[n])
        near.row[n], near.column[n] = i, j
        near.depth[n], near.label[n], near.dark[n] = depth[i, j], label[i, j], dark[i, j]
        mixed |= near.dark[n] ^ near.dark[0]
    return mixed


@compiled
def _trace_quad(
    things: Records, across: Floats, down: Floats, row: int, column: int, around: Records, quads: Records
) -> None:
    """First hits of the 2x2 rays among what the pixel and its neighbours see: t and label.

    A ray that slips between all of them counts as one through the pixel's centre.
    """
    quad, near, sky = quads[0], around[0], False
    for i in range(STRIDE):  # twice the same four
        quad.x[i], quad.y[i] = across[i % 2 * 2, column], down[i // 2 % 2 * 2, row]
        quad.t[i], quad.seen[i] = math.inf, PARTS * SKY
    for n in range(NEAR):
        k, known = near.label[n] // PARTS, False
        for m in range(n):
            known |= near.label[m] // PARTS == k
        sky |= k == SKY
        if not known and k != SKY:
            _hit_by_quad(things, k, quads, STRIDE)
    if not sky:
        for i in range(QUAD):
            if quad.t[i] == math.inf:
                quad.t[i], quad.seen[i] = near.depth[0], near.label[0]


@compiled
def _hit_by_quad(things: Records, k: int, quads: Records, count: int) -> None:
    """Note thing k for those of the rays that meet it first; `count` is unknown here so that loops stay loops."""
    quad, shape, name, rays = quads[0], things[k].shape, PARTS * k, rays_in_object(things, k)
    if shape == CUBE:
        for i in range(count):
            t, part = hit_cube(*ray_in_object(rays, quad.x[i], quad.y[i]), 0.0, quad.t[i])
            quad.seen[i] = name + part if t < quad.t[i] else quad.seen[i]
            quad.t[i] = min(t, quad.t[i])
    elif shape == SPHERE:
        for i in range(count):
            t, part = hit_sphere(*ray_in_object(rays, quad.x[i], quad.y[i]), 0.0, quad.t[i])
            quad.seen[i] = name + part if t < quad.t[i] else quad.seen[i]
            quad.t[i] = min(t, quad.t[i])
    elif shape == CONE:
        for i in range(count):
            t, part = hit_cone(*ray_in_object(rays, quad.x[i], quad.y[i]), 0.0, quad.t[i])
            quad.seen[i] = name + part if t < quad.t[i] else quad.seen[i]
            quad.t[i] = min(t, quad.t[i])
    else:
        for i in range(count):
            quad.far[i] = quad.t[i]
        meet_torus(things, k, quads, count)
        for i in range(count):
            quad.seen[i] = name if quad.hit[i] < quad.t[i] else quad.seen[i]
            quad.t[i] = min(quad.hit[i], quad.t[i])


@compiled
def _light_quad(
    cameras: Records, things: Records, lamps: Records, blockers: Blockers, mixed: int, around: Records,
    quads: Records,
) -> None:  # fmt: skip
    """For each of the 2x2 rays: which of the mixed lamps are in `doubt`, and which of these are `dark`."""
    quad, near, done = quads[0], around[0], 0
    for i in range(QUAD):
        quad.dark[i], quad.doubt[i] = 0, 0
    for i in range(QUAD if mixed != 0 else 0):
        if done & (1 << i) != 0:
            continue
        seen, same, some_dark, some_lit = quad.seen[i], 0, 0, 0
        for n in range(QUAD):
            same |= (1 << n) if quad.seen[n] == seen else 0
        for n in range(NEAR):
            some_dark |= near.dark[n] if near.label[n] == seen else 0
            some_lit |= ~near.dark[n] if near.label[n] == seen else 0
        done |= same
        doubt = mixed & some_dark & some_lit
        if doubt != 0:
            _darken(cameras, things, lamps, blockers, seen, doubt, same, around, quads, STRIDE)


@compiled
def _darken(
    cameras: Records, things: Records, lamps: Records, blockers: Blockers,
    seen: int, doubt: int, same: int, around: Records, quads: Records, count: int,
) -> None:  # fmt: skip
    """Mark for the rays of the bit mask `same` the lamps in doubt, and those of them that are dark.

    Only objects that shade a pixel around are asked.
    """
    quad, near = quads[0], around[0]
    place_hits(cameras, things, seen // PARTS, seen % PARTS, quads, count)
    for lamp in range(len(lamps)):
        bit, last = 1 << lamp, LIT
        if doubt & bit == 0:
            continue
        aim(lamps, lamp, quads, count)
        for n in range(NEAR):
            if near.label[n] == seen and near.dark[n] & bit != 0:
                blocker = int(blockers[near.row[n], near.column[n], lamp])
                if blocker != last:
                    cast_shadow(things, blocker, quads, count)
                last = blocker
        for n in range(QUAD):
            asked = same & (1 << n) != 0
            quad.doubt[n] |= bit if asked else 0
            quad.dark[n] |= bit if asked & (quad.blocker[n] != LIT) else 0


@compiled
def _seen_by(around: Records, seen: int, t: float, doubt: int, dark: int) -> int:
    """Which of the five pixels shows the same surface in the same light, nearest in depth; -1 for none."""
    near, best, place = around[0], math.inf, -1
    for n in range(NEAR):
        step = abs(near.depth[n] - t)
        fits = (near.label[n] == seen) & ((near.dark[n] ^ dark) & doubt == 0) & (step < best)
        best, place = (step if fits else best), (n if fits else place)
    return place


@compiled
def _shade_anew(
    cameras: Records, things: Records, materials: Records, lamps: Records, lists: Lists,
    texels: NDArray[np.uint8], seen: int, x: float, y: float, t: float, bundles: Records, found: Blockers,
) -> Vec3:  # fmt: skip
    """Colour of a hit that no pixel around shows in the same light."""
    rays, k, part = bundles[0], seen // PARTS, seen % PARTS
    rays.x[0], rays.y[0], rays.t[0] = x, y, t
    full = padded(bundles, 1)
    place_hits(cameras, things, k, part, bundles, full)
    list_blockers(things, lamps, k, rays.px[0], rays.py[0], rays.pz[0], 0.0, lists)
    shade(cameras, things, materials, lamps, lists, texels, k, part, bundles, full, found)
    return rays.r[0], rays.g[0], rays.b[0]
