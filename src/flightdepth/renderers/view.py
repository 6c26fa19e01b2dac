"""A scene seen from one camera position, laid out as records for the compiled ray caster.

Records, not a class of many arrays: compiled code passes a record array as one pointer, where each array of
a tuple would cost two atomic counter updates per call. For the same reason it sees every vector and matrix
of a record as single numbers, `origin_0`, `ray_12` (see `_flat`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.renderers.compiling import compiled
from flightdepth.scenes.scene import Ints, Scene

Records = NDArray[Any]

THING = np.dtype(  # an object; the last one is the room
    [
        ("shape", "i8"),
        ("material", "i8"),
        ("torus_radius", "f8"),
        ("unit_m", "f8"),  # metres per unit of object space, geometric mean
        ("bound", "f8"),  # radius round the centre that holds it, metres
        ("unit_bound", "f8"),  # the same in object space
        ("centre", "f8", (3,)),  # world
        ("from_world", "f8", (3, 4)),  # object space from world
        # What follows depends on the camera.
        ("origin", "f8", (3,)),  # camera position in object space
        ("ray", "f8", (3, 3)),  # object space from camera space, directions
        ("outline", "f8", (3, 3)),  # the ray d = (x, y, 1) meets the bound where d' outline d >= 0
        ("nearest", "f8"),  # least z-depth of the bounding sphere
        ("left", "i8"),  # pixels that may see it: left <= column < right, top <= row < bottom
        ("top", "i8"),
        ("right", "i8"),
        ("bottom", "i8"),
    ]
)
MATERIAL = np.dtype(
    [("texture", "i8"), ("turn", "i8"), ("specular", "f8"), ("repeats", "f8"), ("colour", "f8", (3,))]
)
LAMP = np.dtype([("position", "f8", (3,)), ("power", "f8", (3,))])
CAMERA = np.dtype(  # one record: the camera and what fills the rest of the world
    [
        ("position", "f8", (3,)),
        ("turn", "f8", (3, 3)),  # world from camera
        ("fx", "f8"),
        ("fy", "f8"),
        ("cx", "f8"),
        ("cy", "f8"),
        ("has_room", "i8"),
        ("wall", "i8", (6,)),  # materials
        ("ambient", "f8", (3,)),
        ("horizon", "f8", (3,)),
        ("zenith", "f8", (3,)),
    ]
)


def _flat(nested: np.dtype[Any]) -> np.dtype[Any]:
    """The same bytes with a field per number: a vector v becomes v_0, v_1, ..., a matrix m m_00, m_01, ..."""
    fields: list[tuple[str, np.dtype[Any]]] = []
    for name in nested.names or ():
        base, shape = nested[name].base, nested[name].shape
        places = ["_" + "".join(map(str, place)) for place in np.ndindex(shape)] if shape else [""]
        fields += [(name + place, base) for place in places]
    return np.dtype(fields)


FLAT_THING, FLAT_MATERIAL, FLAT_LAMP, FLAT_CAMERA = map(_flat, (THING, MATERIAL, LAMP, CAMERA))


class World(NamedTuple):
    """What does not change while the camera moves."""

    things: Records  # flat THING [K + 1]
    materials: Records  # flat MATERIAL [M]
    lamps: Records  # flat LAMP [L]


def prepare_world(scene: Scene) -> World:
    """Lay out what all frames share."""
    room = scene.world_from_room.copy()
    if not scene.is_open:
        room[:, :3] *= scene.room_half
    poses = np.concatenate([scene.world_from_object, room[None]])
    objects = len(scene.shape)
    things = np.zeros(objects + 1, THING)
    things["shape"][:objects] = scene.shape
    things["torus_radius"][:objects] = scene.torus_radius
    things["material"][:objects] = scene.object_material
    things["bound"][:objects] = scene.bound_radii_m()
    things["unit_bound"][:objects] = scene.unit_bound_radii()
    things["unit_m"] = np.cbrt(np.abs(np.linalg.det(poses[:, :, :3])))
    things["centre"] = poses[:, :, 3]
    things["from_world"][:, :, :3] = np.linalg.inv(poses[:, :, :3])
    things["from_world"][:, :, 3:] = -(things["from_world"][:, :, :3] @ poses[:, :, 3:])
    materials = np.zeros(len(scene.materials.texture), MATERIAL)
    for name in MATERIAL.names or ():
        materials[name] = getattr(scene.materials, name)
    lamps = np.zeros(len(scene.lamp_position), LAMP)
    lamps["position"], lamps["power"] = scene.lamp_position, scene.lamp_power
    return World(things.view(FLAT_THING), materials.view(FLAT_MATERIAL), lamps.view(FLAT_LAMP))


def prepare_cameras(scene: Scene, camera: Camera, frames: Sequence[int]) -> Records:
    """Lay out where `camera` is in each frame, flat CAMERA [F]. A ray is (x, y, 1), so t is the z-depth."""
    records = np.zeros(len(frames), CAMERA)
    which = list(frames)
    records["position"], records["turn"] = scene.camera_position[which], scene.world_from_camera[which]
    for name in ("fx", "fy", "cx", "cy"):
        records[name] = getattr(camera, name)
    records["wall"], records["ambient"] = scene.room_material, scene.ambient
    records["horizon"], records["zenith"] = scene.sky_colour
    records["has_room"] = not scene.is_open
    return records.view(FLAT_CAMERA)


@compiled
def place_things(cameras: Records, things: Records, near_to_far: Ints) -> None:
    """Fill what depends on the camera, cameras[0], in `things`, and the objects' order by least depth."""
    objects = len(things) - 1
    _write_origin_and_ray(cameras[0], things[objects])
    for k in range(objects):
        thing = things[k]
        _write_origin_and_ray(cameras[0], thing)
        _write_outline(thing)
        _write_rectangle(cameras[0], thing)
        place = k
        while place > 0 and things[near_to_far[place - 1]].nearest > thing.nearest:
            near_to_far[place] = near_to_far[place - 1]
            place -= 1
        near_to_far[place] = k


@compiled
def _write_origin_and_ray(camera: Any, a: Any) -> None:
    """The camera's position and its directions, in object space."""
    p0, p1, p2 = camera.position_0, camera.position_1, camera.position_2
    a.origin_0 = a.from_world_00 * p0 + a.from_world_01 * p1 + a.from_world_02 * p2 + a.from_world_03
    a.origin_1 = a.from_world_10 * p0 + a.from_world_11 * p1 + a.from_world_12 * p2 + a.from_world_13
    a.origin_2 = a.from_world_20 * p0 + a.from_world_21 * p1 + a.from_world_22 * p2 + a.from_world_23
    t00, t10, t20 = camera.turn_00, camera.turn_10, camera.turn_20
    t01, t11, t21 = camera.turn_01, camera.turn_11, camera.turn_21
    t02, t12, t22 = camera.turn_02, camera.turn_12, camera.turn_22
    a.ray_00 = a.from_world_00 * t00 + a.from_world_01 * t10 + a.from_world_02 * t20
    a.ray_01 = a.from_world_00 * t01 + a.from_world_01 * t11 + a.from_world_02 * t21
    a.ray_02 = a.from_world_00 * t02 + a.from_world_01 * t12 + a.from_world_02 * t22
    a.ray_10 = a.from_world_10 * t00 + a.from_world_11 * t10 + a.from_world_12 * t20
    a.ray_11 = a.from_world_10 * t01 + a.from_world_11 * t11 + a.from_world_12 * t21
    a.ray_12 = a.from_world_10 * t02 + a.from_world_11 * t12 + a.from_world_12 * t22
    a.ray_20 = a.from_world_20 * t00 + a.from_world_21 * t10 + a.from_world_22 * t20
    a.ray_21 = a.from_world_20 * t01 + a.from_world_21 * t11 + a.from_world_22 * t21
    a.ray_22 = a.from_world_20 * t02 + a.from_world_21 * t12 + a.from_world_22 * t22


@compiled
def _write_rectangle(camera: Any, thing: Any) -> None:
    """Where in the picture the bound can be: `nearest` and the rectangle."""
    x, y, z = (
        thing.centre_0 - camera.position_0,
        thing.centre_1 - camera.position_1,
        thing.centre_2 - camera.position_2,
    )
    x, y, z = (
        camera.turn_00 * x + camera.turn_10 * y + camera.turn_20 * z,
        camera.turn_01 * x + camera.turn_11 * y + camera.turn_21 * z,
        camera.turn_02 * x + camera.turn_12 * y + camera.turn_22 * z,
    )
    thing.nearest = z - thing.bound
    if z + thing.bound <= 0.0:  # behind the camera: an empty rectangle
        thing.left, thing.right, thing.top, thing.bottom = 0, 0, 0, 0
        return
    thing.left, thing.right = _interval(x, z, thing.bound, camera.fx, camera.cx)
    thing.top, thing.bottom = _interval(y, z, thing.bound, camera.fy, camera.cy)


@compiled
def _write_outline(thing: Any) -> None:
    """Rays (origin o, direction m d) that meet the sphere of radius R round the object's origin:
    (o . m d)^2 - |m d|^2 (|o|^2 - R^2) >= 0, a quadratic form of d.
    """
    o0, o1, o2 = thing.origin_0, thing.origin_1, thing.origin_2
    beyond = o0 * o0 + o1 * o1 + o2 * o2 - thing.unit_bound * thing.unit_bound
    s0 = thing.ray_00 * o0 + thing.ray_10 * o1 + thing.ray_20 * o2
    s1 = thing.ray_01 * o0 + thing.ray_11 * o1 + thing.ray_21 * o2
    s2 = thing.ray_02 * o0 + thing.ray_12 * o1 + thing.ray_22 * o2
    m00 = thing.ray_00 * thing.ray_00 + thing.ray_10 * thing.ray_10 + thing.ray_20 * thing.ray_20
    m01 = thing.ray_00 * thing.ray_01 + thing.ray_10 * thing.ray_11 + thing.ray_20 * thing.ray_21
    m02 = thing.ray_00 * thing.ray_02 + thing.ray_10 * thing.ray_12 + thing.ray_20 * thing.ray_22
    m11 = thing.ray_01 * thing.ray_01 + thing.ray_11 * thing.ray_11 + thing.ray_21 * thing.ray_21
    m12 = thing.ray_01 * thing.ray_02 + thing.ray_11 * thing.ray_12 + thing.ray_21 * thing.ray_22
    m22 = thing.ray_02 * thing.ray_02 + thing.ray_12 * thing.ray_12 + thing.ray_22 * thing.ray_22
    thing.outline_00, thing.outline_01 = s0 * s0 - beyond * m00, s0 * s1 - beyond * m01
    thing.outline_02, thing.outline_11 = s0 * s2 - beyond * m02, s1 * s1 - beyond * m11
    thing.outline_12, thing.outline_22 = s1 * s2 - beyond * m12, s2 * s2 - beyond * m22


@compiled
def _interval(side: float, depth: float, bound: float, focal: float, middle: float) -> tuple[int, int]:
    """Pixels (first, last + 1) between the two planes through the camera that touch a sphere, with one to spare.

    Everything for a sphere that reaches the camera's plane.
    """
    far = 2**30
    if depth <= bound:
        return -far, far
    root = bound * math.sqrt(side * side + depth * depth - bound * bound)
    scale = focal / (depth * depth - bound * bound)
    low, high = (side * depth - root) * scale + middle, (side * depth + root) * scale + middle
    return int(max(math.floor(low) - 1, -far)), int(min(math.ceil(high) + 2, far))
