"""The colour of a hit: texture, ambient share, lamps by Lambert and Blinn, cast shadows."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flightdepth.renderers.compiling import compiled
from flightdepth.renderers.shadows import LIT, Lists, first_blocker
from flightdepth.renderers.surfaces import Vec3, normal_in_object, texture_colour, texture_place
from flightdepth.renderers.view import Records

DARKEST = 1e-3  # least light of a lamp, linear, for which its shadow is looked for
SHINE_SQUARINGS = 5  # highlight exponent 2^5
Blockers = NDArray[np.int16]  # [H + 2, W + 2, L] the object that keeps a lamp's light from a pixel, or LIT
Point = tuple[float, float, float, float, float, float]


@compiled
def point_and_normal(
    cameras: Records, things: Records, k: int, part: int, x: float, y: float, t: float
) -> Point:
    """World position of the hit at depth t of the ray (x, y, 1), and the unit normal on the viewer's side."""
    camera, thing = cameras[0], things[k]
    dx = camera.turn_00 * x + camera.turn_01 * y + camera.turn_02
    dy = camera.turn_10 * x + camera.turn_11 * y + camera.turn_12
    dz = camera.turn_20 * x + camera.turn_21 * y + camera.turn_22
    qx, qy, qz = _in_object(things, k, x, y, t)
    ex, ey, ez = normal_in_object(thing.shape, part, thing.torus_radius, qx, qy, qz)
    nx = thing.from_world_00 * ex + thing.from_world_10 * ey + thing.from_world_20 * ez
    ny = thing.from_world_01 * ex + thing.from_world_11 * ey + thing.from_world_21 * ez
    nz = thing.from_world_02 * ex + thing.from_world_12 * ey + thing.from_world_22 * ez
    scale = 1.0 / max(math.sqrt(nx * nx + ny * ny + nz * nz), 1e-300)
    if nx * dx + ny * dy + nz * dz > 0.0:
        scale = -scale
    return (
        camera.position_0 + t * dx, camera.position_1 + t * dy, camera.position_2 + t * dz,
        nx * scale, ny * scale, nz * scale,
    )  # fmt: skip


@compiled
def _in_object(things: Records, k: int, x: float, y: float, t: float) -> Vec3:
    thing = things[k]
    return (
        thing.origin_0 + t * (thing.ray_00 * x + thing.ray_01 * y + thing.ray_02),
        thing.origin_1 + t * (thing.ray_10 * x + thing.ray_11 * y + thing.ray_12),
        thing.origin_2 + t * (thing.ray_20 * x + thing.ray_21 * y + thing.ray_22),
    )


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
    texels: NDArray[np.uint8], k: int, part: int, x: float, y: float, t: float,
    found: NDArray[np.int16],
) -> Vec3:  # fmt: skip
    """Linear colour in 0..1 of the hit at depth t of the ray (x, y, 1); its blockers go to `found` [L].

    Lambert's law and inverse square for each lamp, a Blinn highlight on glossy surfaces, an ambient share.
    """
    px, py, pz, nx, ny, nz = point_and_normal(cameras, things, k, part, x, y, t)
    vx, vy, vz = (
        cameras[0].position_0 - px,
        cameras[0].position_1 - py,
        cameras[0].position_2 - pz,
    )
    to_viewer = 1.0 / math.sqrt(vx * vx + vy * vy + vz * vz)
    vx, vy, vz = vx * to_viewer, vy * to_viewer, vz * to_viewer
    facing = nx * vx + ny * vy + nz * vz
    red, green, blue = _albedo(cameras, things, materials, texels, k, part, x, y, t, facing)
    material = materials[_material(cameras, things, k, part)]
    r, g, b = red * cameras[0].ambient_0, green * cameras[0].ambient_1, blue * cameras[0].ambient_2
    for lamp in range(len(lamps)):
        found[lamp] = LIT
        lx, ly, lz = (
            lamps[lamp].position_0 - px,
            lamps[lamp].position_1 - py,
            lamps[lamp].position_2 - pz,
        )
        square = lx * lx + ly * ly + lz * lz
        away = 1.0 / math.sqrt(square)
        cosine = (nx * lx + ny * ly + nz * lz) * away
        if lamps[lamp].power_0 * cosine < DARKEST * square:  # behind, or too faint to show
            continue
        blocker = first_blocker(things, lists, lamp, px, py, pz, nx, ny, nz, lx, ly, lz)
        found[lamp] = blocker
        if blocker != LIT:
            continue
        matt, shine = cosine / square, 0.0
        if material.specular > 0.0:
            hx, hy, hz = lx * away + vx, ly * away + vy, lz * away + vz
            shine = max((nx * hx + ny * hy + nz * hz) / math.sqrt(hx * hx + hy * hy + hz * hz), 0.0)
            for _ in range(SHINE_SQUARINGS):
                shine *= shine
            shine *= material.specular / square
        r += lamps[lamp].power_0 * (red * matt + shine)
        g += lamps[lamp].power_1 * (green * matt + shine)
        b += lamps[lamp].power_2 * (blue * matt + shine)
    return min(r, 1.0), min(g, 1.0), min(b, 1.0)


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
def _albedo(
    cameras: Records, things: Records, materials: Records, texels: NDArray[np.uint8],
    k: int, part: int, x: float, y: float, t: float, facing: float,
) -> Vec3:  # fmt: skip
    """Linear colour of the surface under white light; `facing` is the cosine between normal and viewer."""
    material, thing = materials[_material(cameras, things, k, part)], things[k]
    if material.texture < 0:
        return material.colour_0, material.colour_1, material.colour_2
    qx, qy, qz = _in_object(things, k, x, y, t)
    u, v, unit = texture_place(thing.shape, part, thing.torus_radius, qx, qy, qz)
    if material.turn % 2 == 1:
        u, v = v, 1.0 - u
    if material.turn >= 2:
        u, v = 1.0 - u, 1.0 - v
    # A pixel's width on the surface; the geometric mean of its two axes on a slanted one.
    width = t / cameras[0].fx / math.sqrt(max(facing, 0.02))
    repeats = material.repeats
    r, g, b = texture_colour(
        texels, material.texture, u * repeats, v * repeats, width * repeats / (unit * thing.unit_m)
    )
    return material.colour_0 * r, material.colour_1 * g, material.colour_2 * b
