"""The colour of hits: texture, ambient share, lamps by Lambert and Blinn, cast shadows."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flightdepth.renderers.bundles import place_hits
from flightdepth.renderers.compiling import compiled
from flightdepth.renderers.shadows import LIT, Lists, aim, cast_shadow
from flightdepth.renderers.surfaces import Vec3, texture_colour, texture_place
from flightdepth.renderers.view import Records

DARKEST = 1e-3  # least light of a lamp, linear, for which its shadow is looked for
SHINE_SQUARINGS = 5  # highlight exponent 2^5
Colours = NDArray[np.float32]  # linear RGB
Blockers = NDArray[np.int16]  # the object that keeps a lamp's light away, or LIT


@compiled
def sky_colour(cameras: Records, x: float, y: float) -> Vec3:
    """From the horizon's colour to the zenith's; the world's y axis points down."""
    camera = cameras[0]
    dx = camera.turn_00 * x + camera.turn_01 * y + camera.turn_02
    dy = camera.turn_10 * x + camera.turn_11 * y + camera.turn_12
    dz = camera.turn_20 * x + camera.turn_21 * y + camera.turn_22
    up = min(max(-dy / math.sqrt(dx * dx + dy * dy + dz * dz), 0.0), 1.0)
    return (
        camera.horizon_0 + up * (camera.zenith_0 - camera.horizon_0),
        camera.horizon_1 + up * (camera.zenith_1 - camera.horizon_1),
        camera.horizon_2 + up * (camera.zenith_2 - camera.horizon_2),
    )


@compiled
def shade(
    cameras: Records, things: Records, materials: Records, lamps: Records, lists: Lists,
    texels: NDArray[np.uint8], k: int, part: int, bundles: Records, count: int, found: Blockers,
) -> None:  # fmt: skip
    """Linear colour r, g, b in 0..1 of the hits of a bundle on face `part` of thing k.

    Lambert's law and inverse square for each lamp, a Blinn highlight on glossy surfaces, an ambient share.
    What blocks the lamps goes to `found` [L, LANES] and, as a bit mask, to the bundle's `dark`.
    """
    place_hits(cameras, things, k, part, bundles, count)
    material = _material(cameras, things, k, part)
    _face_viewer(cameras, bundles, count)
    _albedo(cameras, things, materials, texels, k, part, material, bundles, count)
    _begin_with_ambient(cameras, bundles, count)
    for lamp in range(len(lamps)):
        aim(lamps, lamp, bundles, count)
        _await_light(lamps[lamp].power_0, bundles, count)
        for place in range(1, lists[lamp, 0] + 1):
            cast_shadow(things, int(lists[lamp, place]), bundles, count)
        _add_light(materials, lamps, material, lamp, bundles, count)
        _note_blockers(lamp, bundles, count, found)
    _limit(bundles, count)


@compiled
def _material(cameras: Records, things: Records, k: int, part: int) -> int:
    """Number of the material of an object, or of the room's wall `part`."""
    if k < len(things) - 1:
        number: int = things[k].material
        return number
    camera = cameras[0]
    walls = (camera.wall_0, camera.wall_1, camera.wall_2, camera.wall_3, camera.wall_4, camera.wall_5)
    wall: int = walls[part]
    return wall


@compiled
def _face_viewer(cameras: Records, bundles: Records, count: int) -> None:
    rays = bundles[0]
    x, y, z = cameras[0].position_0, cameras[0].position_1, cameras[0].position_2
    for i in range(count):
        vx, vy, vz = x - rays.px[i], y - rays.py[i], z - rays.pz[i]
        scale = 1.0 / math.sqrt(vx * vx + vy * vy + vz * vz)
        vx, vy, vz = vx * scale, vy * scale, vz * scale
        rays.vx[i], rays.vy[i], rays.vz[i] = vx, vy, vz
        rays.facing[i] = rays.nx[i] * vx + rays.ny[i] * vy + rays.nz[i] * vz


@compiled
def _albedo(
    cameras: Records, things: Records, materials: Records, texels: NDArray[np.uint8],
    k: int, part: int, number: int, bundles: Records, count: int,
) -> None:  # fmt: skip
    """Linear colour of the surface under white light."""
    rays, thing, material = bundles[0], things[k], materials[number]
    red, green, blue = material.colour_0, material.colour_1, material.colour_2
    if material.texture < 0:
        for i in range(count):
            rays.red[i], rays.green[i], rays.blue[i] = red, green, blue
        return
    _texture_places(thing, part, material, cameras[0].fx, bundles, count)
    for i in range(count):
        r, g, b = texture_colour(texels, material.texture, rays.u[i], rays.v[i], rays.footprint[i])
        rays.red[i], rays.green[i], rays.blue[i] = red * r, green * g, blue * b


@compiled
def _texture_places(thing: Any, part: int, material: Any, focal: float, bundles: Records, count: int) -> None:
    """Where on the texture the hits are, u and v, and how wide a pixel is there."""
    rays, turn, repeats = bundles[0], material.turn, material.repeats
    shape, radius, unit_m = thing.shape, thing.torus_radius, thing.unit_m
    for i in range(count):
        u, v, unit = texture_place(shape, part, radius, rays.qx[i], rays.qy[i], rays.qz[i])
        u, v = (v, 1.0 - u) if turn % 2 == 1 else (u, v)
        u, v = (1.0 - u, 1.0 - v) if turn >= 2 else (u, v)
        # A pixel's width on the surface; the geometric mean of its two axes on a slanted one.
        width = rays.t[i] / focal / math.sqrt(max(rays.facing[i], 0.02))
        rays.u[i], rays.v[i], rays.footprint[i] = u * repeats, v * repeats, width * repeats / (unit * unit_m)


@compiled
def _begin_with_ambient(cameras: Records, bundles: Records, count: int) -> None:
    rays = bundles[0]
    red, green, blue = cameras[0].ambient_0, cameras[0].ambient_1, cameras[0].ambient_2
    for i in range(count):
        rays.r[i], rays.g[i], rays.b[i] = rays.red[i] * red, rays.green[i] * green, rays.blue[i] * blue
        rays.dark[i] = 0


@compiled
def _await_light(power: float, bundles: Records, count: int) -> None:
    """No light is awaited where the lamp is behind the surface or too faint to show."""
    rays = bundles[0]
    for i in range(count):
        rays.waits[i] = 0 if power * rays.cosine[i] < DARKEST * rays.square[i] else 1


@compiled
def _add_light(
    materials: Records, lamps: Records, material: int, lamp: int, bundles: Records, count: int
) -> None:
    """The light of a lamp that nothing blocks."""
    rays = bundles[0]
    _highlights(materials[material].specular, bundles, count)
    red, green, blue = lamps[lamp].power_0, lamps[lamp].power_1, lamps[lamp].power_2
    for i in range(count):
        lit = (rays.waits[i] != 0) & (rays.blocker[i] == LIT)
        matt, shine = rays.cosine[i] / rays.square[i], rays.shine[i]
        r, g, b = rays.r[i], rays.g[i], rays.b[i]
        rays.r[i] = r + red * (rays.red[i] * matt + shine) if lit else r
        rays.g[i] = g + green * (rays.green[i] * matt + shine) if lit else g
        rays.b[i] = b + blue * (rays.blue[i] * matt + shine) if lit else b


@compiled
def _highlights(specular: float, bundles: Records, count: int) -> None:
    """Blinn: a power of the cosine between the normal and the middle of the ways to lamp and viewer."""
    rays = bundles[0]
    if specular <= 0.0:
        for i in range(count):
            rays.shine[i] = 0.0
        return
    for i in range(count):
        away = rays.away[i]
        hx, hy, hz = (
            rays.lx[i] * away + rays.vx[i],
            rays.ly[i] * away + rays.vy[i],
            rays.lz[i] * away + rays.vz[i],
        )
        shine = rays.nx[i] * hx + rays.ny[i] * hy + rays.nz[i] * hz
        shine = max(shine / math.sqrt(hx * hx + hy * hy + hz * hz), 0.0)
        for _ in range(SHINE_SQUARINGS):
            shine *= shine
        rays.shine[i] = shine * (specular / rays.square[i])


@compiled
def _note_blockers(lamp: int, bundles: Records, count: int, found: Blockers) -> None:
    rays = bundles[0]
    for i in range(count):
        rays.dark[i] |= 0 if rays.blocker[i] == LIT else 1 << lamp
        found[lamp, i] = rays.blocker[i]


@compiled
def _limit(bundles: Records, count: int) -> None:
    rays = bundles[0]
    for i in range(count):
        rays.r[i], rays.g[i], rays.b[i] = min(rays.r[i], 1.0), min(rays.g[i], 1.0), min(rays.b[i], 1.0)
