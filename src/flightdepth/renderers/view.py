"""A scene seen from one camera position, laid out as records for the compiled ray caster.

Records, not a class of many arrays: compiled code passes a record array as one pointer, where each array of
a tuple would cost two atomic counter updates per call. For the same reason it sees every vector and matrix
of a record as single numbers, `origin_0`, `ray_12` (see `_flat`).
"""

from __future__ import annotations

import math
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

    things: Records  # THING [K + 1]
    materials: Records  # flat MATERIAL [M]
    lamps: Records  # flat LAMP [L]


class View(NamedTuple):
    """One camera position, flat records. A ray is (x, y, 1) in camera space, so t is the z-depth."""

    camera: Records  # [1]
    things: Records  # [K + 1]
    near_to_far: Ints  # [K]
    materials: Records  # [M]
    lamps: Records  # [L]


def prepare_world(scene: Scene) -> World:
    """Lay out what all frames share."""
    room = scene.world_from_room.copy()
    if np.isfinite(scene.room_half).all():
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
    return World(things, materials.view(FLAT_MATERIAL), lamps.view(FLAT_LAMP))


def prepare_view(scene: Scene, world: World, camera: Camera, frame: int) -> View:
    """Lay out frame `frame` as `camera` sees it."""
    position, turn = scene.camera_position[frame], scene.world_from_camera[frame]
    things = world.things.copy()
    linear = things["from_world"][:, :, :3]
    things["origin"] = linear @ position + things["from_world"][:, :, 3]
    things["ray"] = linear @ turn
    record = _camera_record(scene, camera, frame)
    _place_in_picture(record, things.view(FLAT_THING))
    near_to_far = np.argsort(things["nearest"][:-1], kind="stable")
    return View(record, things.view(FLAT_THING), near_to_far, world.materials, world.lamps)


def _camera_record(scene: Scene, camera: Camera, frame: int) -> Records:
    record = np.zeros(1, CAMERA)
    record["position"], record["turn"] = scene.camera_position[frame], scene.world_from_camera[frame]
    for name in ("fx", "fy", "cx", "cy"):
        record[name] = getattr(camera, name)
    record["wall"], record["ambient"] = scene.room_material, scene.ambient
    record["horizon"], record["zenith"] = scene.sky_colour
    record["has_room"] = np.isfinite(scene.room_half).all()
    return record.view(FLAT_CAMERA)


@compiled
def _place_in_picture(cameras: Records, things: Records) -> None:
    """Fill `outline`, `nearest` and the rectangle of every object: where in the picture its bound can be."""
    camera = cameras[0]
    for k in range(len(things) - 1):
        thing = things[k]
        _write_outline(thing)
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
            continue
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
