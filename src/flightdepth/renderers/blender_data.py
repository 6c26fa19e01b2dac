"""A scene as plain arrays that the script inside Blender turns into Blender's objects.

Blender gets the world with our axes (right-handed, x right, y down, z forward at a camera that is not turned),
moved so that the first camera stands at the origin, where 32-bit floats are finest. Only its cameras look
along -z with y up.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.renderers.surfaces import LINEAR
from flightdepth.scenes.scene import Floats, Materials, Scene, Shape
from flightdepth.scenes.textures import EDGE, Textures

Arrays = dict[str, NDArray[np.generic]]

SENSOR_MM = 36.0  # any width will do
CAMERA_AXES = np.diag([1.0, -1.0, -1.0])  # ours from Blender's
POINT_LIGHT_W = 4.0 * np.pi**2  # a lamp of this many watts gives a white matt surface radiance 1 at 1 m
# Where the first sample's ray goes from the pixel's centre, in pixels right and down: Cycles looks the middle up in
# a table of 1024 entries, half an entry aside. The picture is moved by as much.
MIDDLE_PX = (0.5 / 1023, -0.5 / 1023)
# Ashikhmin-Shirley with exponent n at its peak, times pi: (n + 1) / (8 cos(view)); ours has height 1 there.
SHINE = 8.0 / 33.0
TILE = EDGE + 2  # in the atlas: a texture and one texel of its opposite border all round
# u and v of a texture that is turned by quarters, from (u, v, 1), as in `shading`.
TURNS = np.array(
    [[[1, 0, 0], [0, 1, 0]], [[0, 1, 0], [-1, 0, 1]], [[-1, 0, 1], [0, -1, 1]], [[0, -1, 1], [1, 0, 0]]],
    float,
)


def mesh_names(scene: Scene) -> list[str]:
    """Which mesh each object shows; equal names are one mesh."""
    shapes = zip(map(Shape, scene.shape), scene.torus_radius, strict=True)
    return [f"torus-{radius!r}" if shape is Shape.TORUS else shape.name.lower() for shape, radius in shapes]


def scene_arrays(scene: Scene, frames: Sequence[int], atlas: Atlas) -> Arrays:
    """Objects (walls last), lamps, sky and cameras."""
    origin = scene.camera_position[frames[0]]
    poses, worn = scene.world_from_object, scene.object_material
    if not scene.is_open:
        room = scene.world_from_room.copy()
        room[:, :3] *= scene.room_half
        poses, worn = np.concatenate([poses, [room] * 6]), np.append(worn, scene.room_material)
    poses = poses.copy()
    poses[:, :, 3] -= origin
    return {
        "pose": poses,
        **{name: values[worn] for name, values in _surfaces(scene.materials, atlas.corners).items()},
        "atlas_size": np.array(atlas.texels.shape[1::-1]),
        "lamp_position": scene.lamp_position - origin,
        "lamp_power": scene.lamp_power * POINT_LIGHT_W,
        "ambient": scene.ambient,
        "sky": scene.sky_colour if np.isinf(scene.room_half).any() else np.zeros((2, 3)),
        "camera": np.stack([camera_pose(scene, frame, origin) for frame in frames]),
    }


def camera_pose(scene: Scene, frame: int, origin: Floats) -> Floats:
    """World from Blender's camera, [3, 4]."""
    turn = scene.world_from_camera[frame] @ CAMERA_AXES
    return np.column_stack([turn, scene.camera_position[frame] - origin])


def lens(camera: Camera) -> dict[str, float]:
    """Blender's names for the intrinsics of an ideal pinhole.

    The horizontal sensor fits the width. Shifts are in widths, of the picture against the optical axis:
    right and up are positive. Pixels are `aspect_x` wide and `aspect_y` high.
    """
    ratio = camera.fx / camera.fy
    return {
        "lens_mm": camera.fx * SENSOR_MM / camera.width,
        "shift_x": ((camera.width - 1) / 2 - camera.cx - MIDDLE_PX[0]) / camera.width,
        "shift_y": (camera.cy - (camera.height - 1) / 2 + MIDDLE_PX[1]) * ratio / camera.width,
        "aspect_x": max(1.0, 1.0 / ratio),  # Blender takes none below 1
        "aspect_y": max(1.0, ratio),
    }


class Atlas(NamedTuple):
    """One picture of many textures, because then one material serves all objects and equal shapes share a mesh.

    texels    [H, W, 3]   linear RGB; its row 0 is v = 0, as in ours
    corners   [M, 2]      first texel (x, y) of each material's tile
    """

    texels: NDArray[np.float32]
    corners: Floats


def texture_atlas(materials: Materials, textures: Textures) -> Atlas:
    """All textures that are worn; the first tile is white, for plain surfaces."""
    worn, tile = np.unique(np.append(materials.texture, -1), return_inverse=True)  # -1, plain, comes first
    columns = int(np.ceil(np.sqrt(len(worn))))
    texels = np.ones((-(-len(worn) // columns) * TILE, columns * TILE, 3), np.float32)
    for place, texture in enumerate(worn[1:], start=1):
        picture = LINEAR[textures.texels[texture, : EDGE * EDGE]].reshape(EDGE, EDGE, 3)
        row, column = divmod(place, columns)
        texels[row * TILE : (row + 1) * TILE, column * TILE : (column + 1) * TILE] = np.pad(
            picture, ((1, 1), (1, 1), (0, 0)), mode="wrap"
        )
    corners = (np.stack([tile[:-1] % columns, tile[:-1] // columns], -1) * TILE + 1).astype(np.float64)
    return Atlas(texels, corners)


def write_atlas(path: Path, atlas: Atlas) -> None:
    """A TIFF file of 32-bit floats; files begin with the row that Blender counts last."""
    picture = np.ascontiguousarray(atlas.texels[::-1, :, ::-1])
    if not cv2.imwrite(str(path), picture, [cv2.IMWRITE_TIFF_COMPRESSION, 1]):
        raise OSError(f"cannot write {path}")


def _surfaces(materials: Materials, corners: Floats) -> dict[str, Floats]:
    """What the one material reads from each object, [M, ...]."""
    rows = TURNS[materials.turn] * materials.repeats[:, None, None]
    return {
        "u_row": rows[:, 0],
        "v_row": rows[:, 1],
        "tile": np.column_stack([corners, np.zeros(len(corners))]),
        "tint": materials.colour,
        "shine": materials.specular * SHINE,
    }
