"""COLMAP's binary files, read as its format page tells them, and by nothing of flightdepth's."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

MODELS = {1: ("PINHOLE", 4)}


@dataclass
class Model:
    """By id: cameras (model, width, height, parameters), images, points."""

    cameras: dict[int, tuple[str, int, int, tuple[float, ...]]]
    images: dict[int, Image]
    points: dict[int, Point]


@dataclass
class Image:
    name: str
    camera: int
    quaternion: np.ndarray  # w, x, y, z
    shift: np.ndarray
    seen: np.ndarray  # x, y, id of the point; [N, 3]

    @property
    def camera_from_world(self) -> np.ndarray:
        w, x, y, z = self.quaternion
        return np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )

    @property
    def place(self) -> np.ndarray:
        return -self.camera_from_world.T @ self.shift


@dataclass
class Point:
    xyz: np.ndarray
    rgb: tuple[int, ...]
    error: float
    track: list[tuple[int, int]]  # image, place in its list


class Bytes:
    def __init__(self, path: Path) -> None:
        self.data, self.at = path.read_bytes(), 0

    def take(self, kinds: str) -> tuple:
        values = struct.unpack_from("<" + kinds, self.data, self.at)
        self.at += struct.calcsize("<" + kinds)
        return values

    def text(self) -> str:
        end = self.data.index(b"\0", self.at)
        found, self.at = self.data[self.at : end].decode(), end + 1
        return found


def read_model(folder: Path) -> Model:
    cameras, images, points = (Bytes(folder / f"{name}.bin") for name in ("cameras", "images", "points3D"))
    model = Model({}, {}, {})
    for _ in range(*cameras.take("Q")):
        number, kind, width, height = cameras.take("iiQQ")
        name, count = MODELS[kind]
        model.cameras[number] = name, width, height, cameras.take(f"{count}d")
    for _ in range(*images.take("Q")):
        (number,) = images.take("i")
        pose = np.array(images.take("7d"))
        (camera,), name = images.take("i"), images.text()
        (count,) = images.take("Q")
        seen = np.array([images.take("ddq") for _ in range(count)]).reshape(-1, 3)
        model.images[number] = Image(name, camera, pose[:4], pose[4:], seen)
    for _ in range(*points.take("Q")):
        (number,) = points.take("Q")
        xyz, rgb, (error,) = np.array(points.take("3d")), points.take("3B"), points.take("d")
        (count,) = points.take("Q")
        model.points[number] = Point(xyz, rgb, error, [points.take("ii") for _ in range(count)])
    assert all(file.at == len(file.data) for file in (cameras, images, points))
    return model


def projected(model: Model, image: Image, xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where points [N, 3] fall in a picture, COLMAP's pixels [N, 2], and their depth [N]."""
    fx, fy, cx, cy = model.cameras[image.camera][3]
    there = xyz @ image.camera_from_world.T + image.shift
    return there[:, :2] / there[:, 2:] * (fx, fy) + (cx, cy), there[:, 2]
