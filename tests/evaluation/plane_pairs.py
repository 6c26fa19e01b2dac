"""Pairs of pictures of one textured plane, drawn with numpy; their truth follows from the plane's equation."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from flightdepth.camera import Camera


@dataclass(frozen=True)
class PlanePair:
    """As `stillbox.testset.TestPair`."""

    previous: np.ndarray
    current: np.ndarray
    depth_m: np.ndarray
    displacement: np.ndarray
    focal_px: float


def plane_pair(
    camera: Camera,
    displacement: tuple[float, float, float],
    *,
    distance_m: float = 10.0,
    tilt: float = 0.0,
    seed: int = 0,
) -> PlanePair:
    """The plane z = distance + tilt * x in the current camera's frame, seen from both positions.

    A point X of the current frame stands at X + displacement in the previous one.
    """
    moved, rays = np.asarray(displacement, dtype=np.float64), camera.rays()
    lean = rays @ np.array([-tilt, 0.0, 1.0])
    offset = distance_m + moved @ np.array([-tilt, 0.0, 1.0])
    points = rays * (distance_m / lean)[..., None]
    points_previous = rays * (offset / lean)[..., None] - moved
    grain_m = distance_m / camera.fx  # a pixel at that distance
    current, previous = (paint(each[..., :2] / grain_m, seed) for each in (points, points_previous))
    return PlanePair(previous, current, points[..., 2].astype(np.float32), moved, camera.fx)


def paint(where: np.ndarray, seed: int) -> np.ndarray:
    """RGB of smooth noise, some 4 units a grain, at points [H, W, 2]; it repeats after 512 units."""
    noise = np.random.default_rng(seed).random((512, 512), np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.0, borderType=cv2.BORDER_REFLECT)
    smooth = (smooth - smooth.mean()) / smooth.std() * 45 + 128
    x, y = (np.mod(where[..., axis] + 256, 510).astype(np.float32) for axis in (0, 1))
    grey = cv2.remap(smooth, x, y, cv2.INTER_CUBIC).clip(0, 255).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)
