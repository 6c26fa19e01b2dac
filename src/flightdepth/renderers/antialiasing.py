"""Edges: 2x2 rays decide what a pixel shows, colours come from the pixel centres around (multisampling).

Inside a surface the mip-mapped texture and the light are smooth, so a ray's surface is shaded where a pixel
centre nearby has seen it already. Only a surface or a shadow that no centre around has seen is shaded anew.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flightdepth.renderers.compiling import compiled
from flightdepth.renderers.intersections import TORUS
from flightdepth.renderers.shading import Blockers, point_and_normal, shade, sky_colour
from flightdepth.renderers.shadows import LIT, Lists, first_blocker, list_blockers
from flightdepth.renderers.surfaces import Vec3
from flightdepth.renderers.tracing import PARTS, SKY, Labels, hit_thing
from flightdepth.renderers.view import Records
from flightdepth.scenes.scene import Floats

FOLD = 0.05  # relative step in depth within one torus that counts as an edge
Colours = NDArray[np.float32]
ROW_STEP, COLUMN_STEP = (0, 0, -1, 1, 0), (0, -1, 0, 0, 1)  # a pixel and its neighbours


@compiled
def is_edge(things: Records, depth: Floats, label: Labels, blockers: Blockers, row: int, column: int) -> bool:
    """Whether one of the four neighbours shows another thing, face, shadow or fold."""
    here, near = label[row, column], depth[row, column]
    if here != label[row, column - 1] or here != label[row, column + 1]:
        return True
    if here != label[row - 1, column] or here != label[row + 1, column]:
        return True
    if here == PARTS * SKY:
        return False
    if _mixed_lamps(blockers, row, column) != 0:
        return True
    if things[here // PARTS].shape == TORUS:  # the only shape that hides a part of itself
        for i in range(1, 5):
            if abs(depth[row + ROW_STEP[i], column + COLUMN_STEP[i]] - near) > FOLD * near:
                return True
    return False


@compiled
def supersample(
    cameras: Records, things: Records, materials: Records, lamps: Records, lists: Lists,
    texels: NDArray[np.uint8], colour: Colours, depth: Floats, label: Labels, blockers: Blockers,
    found: NDArray[np.int16], row: int, column: int,
) -> Vec3:  # fmt: skip
    """Mean linear colour of 2x2 rays through the pixel whose place in the bordered picture is (row, column)."""
    r, g, b = 0.0, 0.0, 0.0
    centre = label[row, column]
    mixed = _mixed_lamps(blockers, row, column)
    simple = mixed == 0 and (centre == PARTS * SKY or things[centre // PARTS].shape != TORUS)
    for i in range(4):
        x = (column - 1 + 0.5 * (i % 2) - 0.25 - cameras[0].cx) / cameras[0].fx
        y = (row - 1 + 0.5 * (i // 2) - 0.25 - cameras[0].cy) / cameras[0].fy
        t, seen = _trace_nearby(things, label, depth, row, column, x, y)
        place, doubt, lit = 0, 0, 0
        if not simple or seen != centre:
            if mixed != 0:
                doubt = _lamps_in_doubt(label, blockers, row, column, seen, mixed)
            if doubt != 0:
                lit = _lit(cameras, things, lamps, lists, label, blockers, row, column, seen, doubt, x, y, t)
            place = _seen_by(label, depth, blockers, row, column, seen, t, doubt, lit)
        if place >= 0:
            i1, j1 = row + ROW_STEP[place], column + COLUMN_STEP[place]
            r1, g1, b1 = colour[i1, j1, 0], colour[i1, j1, 1], colour[i1, j1, 2]
        elif seen == PARTS * SKY:
            r1, g1, b1 = sky_colour(cameras, x, y)
        else:
            k, part = seen // PARTS, seen % PARTS
            px, py, pz, _, _, _ = point_and_normal(cameras, things, k, part, x, y, t)
            list_blockers(things, lamps, k, px, py, pz, 0.0, lists)
            r1, g1, b1 = shade(cameras, things, materials, lamps, lists, texels, k, part, x, y, t, found)
        r, g, b = r + 0.25 * r1, g + 0.25 * g1, b + 0.25 * b1
    return r, g, b


@compiled
def _trace_nearby(
    things: Records, label: Labels, depth: Floats, row: int, column: int, x: float, y: float
) -> tuple[float, int]:
    """First hit of the ray (x, y, 1) among what the pixel and its neighbours see: depth and label.

    A ray that slips between all of them counts as one through the pixel's centre.
    """
    near = (
        label[row, column] // PARTS,
        label[row, column - 1] // PARTS,
        label[row, column + 1] // PARTS,
        label[row - 1, column] // PARTS,
        label[row + 1, column] // PARTS,
    )
    best, seen, sky = math.inf, SKY, False
    for i in range(5):
        k = near[i]
        known = (i > 0 and k == near[0]) or (i > 1 and k == near[1]) or (i > 2 and k == near[2])
        if k == SKY:
            sky = True
        elif not known and not (i > 3 and k == near[3]):
            t, part = hit_thing(things, k, x, y, best)
            if t < best:
                best, seen = t, PARTS * k + part
    if best == math.inf:
        return (best, PARTS * SKY) if sky else (depth[row, column], label[row, column])
    return best, seen


@compiled
def _mixed_lamps(blockers: Blockers, row: int, column: int) -> int:
    """Bit mask of the lamps that reach some of the five pixels, and others not."""
    mixed = 0
    for lamp in range(blockers.shape[2]):
        lit = blockers[row, column, lamp] == LIT
        if (
            (blockers[row, column - 1, lamp] == LIT) != lit
            or (blockers[row, column + 1, lamp] == LIT) != lit
            or (blockers[row - 1, column, lamp] == LIT) != lit
            or (blockers[row + 1, column, lamp] == LIT) != lit
        ):
            mixed |= 1 << lamp
    return mixed


@compiled
def _lamps_in_doubt(label: Labels, blockers: Blockers, row: int, column: int, seen: int, mixed: int) -> int:
    """Of the mixed lamps those that differ between pixels with the label `seen`."""
    doubt = 0
    for lamp in range(blockers.shape[2]):
        if mixed & (1 << lamp) == 0:
            continue
        lit, dark = False, False
        for i in range(5):
            i1, j1 = row + ROW_STEP[i], column + COLUMN_STEP[i]
            if label[i1, j1] == seen:
                reached = blockers[i1, j1, lamp] == LIT
                lit, dark = lit or reached, dark or not reached
        if lit and dark:
            doubt |= 1 << lamp
    return doubt


@compiled
def _lit(
    cameras: Records, things: Records, lamps: Records, lists: Lists, label: Labels, blockers: Blockers,
    row: int, column: int, seen: int, doubt: int, x: float, y: float, t: float,
) -> int:  # fmt: skip
    """Which of the doubtful lamps reach the hit; only objects that shade a pixel around are asked."""
    px, py, pz, nx, ny, nz = point_and_normal(cameras, things, seen // PARTS, seen % PARTS, x, y, t)
    lit = 0
    for lamp in range(len(lamps)):
        if doubt & (1 << lamp) == 0:
            continue
        count = 0
        for i in range(5):
            i1, j1 = row + ROW_STEP[i], column + COLUMN_STEP[i]
            blocker = blockers[i1, j1, lamp]
            if label[i1, j1] == seen and blocker != LIT and (count == 0 or lists[lamp, count] != blocker):
                count += 1
                lists[lamp, count] = blocker
        lists[lamp, 0] = count
        lx, ly, lz = lamps[lamp].position_0 - px, lamps[lamp].position_1 - py, lamps[lamp].position_2 - pz
        if first_blocker(things, lists, lamp, px, py, pz, nx, ny, nz, lx, ly, lz) == LIT:
            lit |= 1 << lamp
    return lit


@compiled
def _seen_by(
    label: Labels, depth: Floats, blockers: Blockers, row: int, column: int,
    seen: int, t: float, doubt: int, lit: int,
) -> int:  # fmt: skip
    """Which of the five pixels shows the same surface in the same light, nearest in depth; -1 for none."""
    best, place = math.inf, -1
    for i in range(5):
        i1, j1 = row + ROW_STEP[i], column + COLUMN_STEP[i]
        if label[i1, j1] != seen:
            continue
        same_light = True
        for lamp in range(blockers.shape[2] if doubt != 0 else 0):
            if doubt & (1 << lamp) != 0:
                same_light &= (blockers[i1, j1, lamp] == LIT) == (lit & (1 << lamp) != 0)
        if same_light and abs(depth[i1, j1] - t) < best:
            best, place = abs(depth[i1, j1] - t), i
    return place
