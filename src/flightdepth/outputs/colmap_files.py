"""COLMAP's binary model files: cameras.bin, images.bin, points3D.bin (https://colmap.github.io/format.html).

COLMAP counts pixels from the top-left corner of the picture, so that the centre of the first one is 0.5, 0.5; ids
count from 1 here. World axes may be any; a camera's are right, down, forward.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.files import write_atomic
from flightdepth.motion import Vector, quaternion_from_rotation
from flightdepth.outputs.voxels import Cloud

PINHOLE = 1  # the number of this model: fx, fy, cx, cy
CENTRE = 0.5  # of the first pixel
ERROR_UNKNOWN = -1.0  # of a point's reprojection
SEEN_POINT = np.dtype([("pixel", "<f8", 2), ("point", "<u8")])
TRACK = np.dtype([("image", "<u4"), ("place", "<u4")])


@dataclass(frozen=True, eq=False)
class PosedImage:
    """A picture: its name, its camera, an ideal one, where that stood, and which points it shows.

    world_from_camera  rotation (3, 3)
    position_m         (3,) of the camera in the world
    pixels             [N, 2], OpenCV's: the centre of the first is 0, 0
    points             [N], rows of the cloud
    """

    name: str
    camera: Camera
    world_from_camera: Vector
    position_m: Vector
    pixels: Vector
    points: NDArray[np.intp]


def write_model(folder: Path, images: Sequence[PosedImage], cloud: Cloud) -> None:
    """The three files of a model; images of the same lens share a camera."""
    cameras = list(dict.fromkeys(image.camera for image in images))
    write_atomic(folder / "cameras.bin", cameras_bytes(cameras))
    write_atomic(folder / "images.bin", images_bytes(images, cameras))
    write_atomic(folder / "points3D.bin", points_bytes(cloud, images))


def cameras_bytes(cameras: Sequence[Camera]) -> bytes:
    """Ideal cameras, whose ids are their places from 1."""
    parts = [struct.pack("<Q", len(cameras))]
    for number, camera in enumerate(cameras, start=1):
        parts.append(struct.pack("<iiQQ", number, PINHOLE, camera.width, camera.height))
        parts.append(struct.pack("<4d", camera.fx, camera.fy, camera.cx + CENTRE, camera.cy + CENTRE))
    return b"".join(parts)


def images_bytes(images: Sequence[PosedImage], cameras: Sequence[Camera]) -> bytes:
    """Images, whose ids are their places from 1, with the points that they show."""
    numbers = {camera: number for number, camera in enumerate(cameras, start=1)}
    parts = [struct.pack("<Q", len(images))]
    for number, image in enumerate(images, start=1):
        camera_from_world = image.world_from_camera.T
        shift = -camera_from_world @ image.position_m
        pose = *quaternion_from_rotation(camera_from_world), *shift
        parts.append(struct.pack("<I7dI", number, *pose, numbers[image.camera]))
        parts.append(image.name.encode() + b"\0")
        seen = np.empty(len(image.points), SEEN_POINT)
        seen["pixel"], seen["point"] = image.pixels + CENTRE, image.points + 1
        parts.append(struct.pack("<Q", len(seen)) + seen.tobytes())
    return b"".join(parts)


def points_bytes(cloud: Cloud, images: Sequence[PosedImage]) -> bytes:
    """Points, whose ids are their rows from 1, each with its track: the images that show it, and as which of theirs."""
    numbers = [np.full(len(image.points), number, np.uint32) for number, image in enumerate(images, start=1)]
    shown = np.concatenate([np.empty(0, np.intp), *(image.points for image in images)])
    order = np.argsort(shown, kind="stable")
    tracks = np.empty(len(shown), TRACK)
    tracks["image"] = np.concatenate([np.empty(0, np.uint32), *numbers])[order]
    tracks["place"] = np.concatenate([np.empty(0, np.intp), *(np.arange(len(i)) for i in numbers)])[order]
    ends = np.cumsum(np.bincount(shown, minlength=len(cloud)))
    parts, begin = [struct.pack("<Q", len(cloud))], 0
    for row, (point, colour, end) in enumerate(zip(cloud.points_m, cloud.colours, ends, strict=True)):
        parts.append(struct.pack("<Q3d3Bd", row + 1, *point, *colour, ERROR_UNKNOWN))
        parts.append(struct.pack("<Q", end - begin) + tracks[begin:end].tobytes())
        begin = end
    return b"".join(parts)
