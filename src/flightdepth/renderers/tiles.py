"""Shading a tile of the picture: its pixels are sorted by what they see, and each sort is shaded as a bundle."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flightdepth.renderers.bundles import LANES, padded
from flightdepth.renderers.compiling import compiled
from flightdepth.renderers.shading import Blockers, Colours, shade, sky_colour
from flightdepth.renderers.shadows import Lists, list_blockers
from flightdepth.renderers.tracing import PARTS, SKY, Labels
from flightdepth.renderers.view import Records
from flightdepth.scenes.scene import Floats, Ints

TILE = math.isqrt(LANES)  # pixels; the objects that may cast a shadow are listed per tile and face
NOBODY = -1


@compiled
def sort_tile(label: Labels, top: int, left: int, heads: Ints, chain: Ints, kinds: Ints) -> int:
    """Chain the pixels of a tile that have the same label; the number of labels.

    kinds [n] lists the labels, heads [label + PARTS] holds the first pixel of one, chain [pixel] the next pixel.
    A pixel is its row in the tile times TILE plus its column. `heads` is NOBODY everywhere before and after use.
    """
    bottom, right = min(top + TILE, label.shape[0]), min(left + TILE, label.shape[1])
    count = 0
    for i in range(top, bottom):
        for j in range(left, right):
            head, pixel = label[i, j] + PARTS, (i - top) * TILE + j - left
            if heads[head] == NOBODY:
                kinds[count] = label[i, j]
                count += 1
            chain[pixel], heads[head] = heads[head], pixel
    return count


@compiled
def gather(
    across: Floats,
    down: Floats,
    depth: Floats,
    chain: Ints,
    pixel: int,
    top: int,
    left: int,
    bundles: Records,
) -> int:
    """Put the pixels chained from `pixel` on into a bundle; how many there are."""
    rays, count = bundles[0], 0
    while pixel != NOBODY:
        i, j = top + pixel // TILE, left + pixel % TILE
        rays.row[count], rays.column[count] = i, j
        rays.x[count], rays.y[count], rays.t[count] = across[1, j], down[1, i], depth[i, j]
        count += 1
        pixel = chain[pixel]
    return count


@compiled
def shade_tile(
    cameras: Records, things: Records, materials: Records, lamps: Records, lists: Lists,
    texels: NDArray[np.uint8], across: Floats, down: Floats, depth: Floats, label: Labels,
    colour: Colours, dark: Labels, blockers: Blockers,
    heads: Ints, chain: Ints, kinds: Ints, bundles: Records, found: Blockers, top: int, left: int,
) -> None:  # fmt: skip
    """Fill colour, dark and blockers of the pixels of a tile."""
    for kind in range(sort_tile(label, top, left, heads, chain, kinds)):
        seen = kinds[kind]
        pixel, heads[seen + PARTS] = heads[seen + PARTS], NOBODY
        count = gather(across, down, depth, chain, pixel, top, left, bundles)
        if seen == PARTS * SKY:
            _shade_sky(cameras, bundles, count)
        else:
            k, part = seen // PARTS, seen % PARTS
            _list_for_bundle(cameras, things, lamps, lists, k, bundles, count)
            full = padded(bundles, count)
            shade(cameras, things, materials, lamps, lists, texels, k, part, bundles, full, found)
        _scatter(bundles, count, found, colour, dark, blockers)


@compiled
def _shade_sky(cameras: Records, bundles: Records, count: int) -> None:
    rays = bundles[0]
    for i in range(count):
        rays.r[i], rays.g[i], rays.b[i] = sky_colour(cameras, rays.x[i], rays.y[i])
        rays.dark[i] = 0


@compiled
def _scatter(
    bundles: Records, count: int, found: Blockers, colour: Colours, dark: Labels, blockers: Blockers
) -> None:
    """Write what was found out to the pixels."""
    rays = bundles[0]
    for n in range(count):
        i, j = rays.row[n], rays.column[n]
        colour[i, j, 0], colour[i, j, 1], colour[i, j, 2] = rays.r[n], rays.g[n], rays.b[n]
        dark[i, j] = rays.dark[n]
        for lamp in range(len(found) if rays.dark[n] != 0 else 0):  # asked for only where a lamp is dark
            blockers[i, j, lamp] = found[lamp, n]


@compiled
def _list_for_bundle(
    cameras: Records, things: Records, lamps: Records, lists: Lists, k: int, bundles: Records, count: int
) -> None:
    """List what may shade the hits of a bundle on thing k, by a box round them in camera space."""
    rays = bundles[0]
    low_x, low_y, low_z, high_x, high_y, high_z = np.inf, np.inf, np.inf, -np.inf, -np.inf, -np.inf
    for i in range(count):
        t = rays.t[i]
        x, y = t * rays.x[i], t * rays.y[i]
        low_x, high_x = min(low_x, x), max(high_x, x)
        low_y, high_y = min(low_y, y), max(high_y, y)
        low_z, high_z = min(low_z, t), max(high_z, t)
    x, y, z = 0.5 * (low_x + high_x), 0.5 * (low_y + high_y), 0.5 * (low_z + high_z)
    dx, dy, dz = high_x - low_x, high_y - low_y, high_z - low_z
    c = cameras[0]
    list_blockers(
        things, lamps, k,
        c.position_0 + c.turn_00 * x + c.turn_01 * y + c.turn_02 * z,
        c.position_1 + c.turn_10 * x + c.turn_11 * y + c.turn_12 * z,
        c.position_2 + c.turn_20 * x + c.turn_21 * y + c.turn_22 * z,
        0.5 * np.sqrt(dx * dx + dy * dy + dz * dz) + 0.01, lists,
    )  # fmt: skip
