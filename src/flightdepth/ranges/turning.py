"""Rotating an earlier frame into the current one's orientation, row by row where it bends: no depth needed."""

from __future__ import annotations

import cv2
import numpy as np

from flightdepth.camera import Camera
from flightdepth.levels import AnyImage, within_levels
from flightdepth.motion import Vector
from flightdepth.ranges.rolling_shutter import straight_from_bent
from flightdepth.runtimes.arrays import Flags, Maps

# A turn that moves no pixel by more than this is left alone: resampling would cost more than it mends.
UNSEEN_PX = 0.1
NOWHERE_PX = -9.0  # left of every picture
LEAST_AHEAD = 1e-3  # of what lies behind: far beyond the edges of every picture


def homography(current_from_previous: Vector, camera: Camera) -> Vector:
    """K R K^-1, shape (3, 3): pixels of the previous frame to where the current orientation sees them."""
    return np.asarray(camera.matrix @ current_from_previous @ np.linalg.inv(camera.matrix))


def is_visible(angle_rad: float, camera: Camera) -> bool:
    """Whether a turn of `angle_rad` moves the picture measurably."""
    return angle_rad * max(camera.fx, camera.width / 2) > UNSEEN_PX


def turned(
    image: AnyImage, current_from_previous: Vector, camera: Camera, bend: Vector | None = None
) -> AnyImage:
    """`image` [H, W, 3] or [H, W] of an ideal pinhole, seen in the current orientation; edges replicated.

    bend  (3,) radians by which the rotation grows from the first row to the last
    """
    border = cv2.BORDER_REPLICATE
    if bend is None:
        warp = homography(current_from_previous, camera)
        size = (image.shape[1], image.shape[0])
        seen = np.asarray(cv2.warpPerspective(image, warp, size, flags=cv2.INTER_CUBIC, borderMode=border))
    else:
        x, y = _rows_before(current_from_previous, camera, bend)
        seen = np.asarray(cv2.remap(image, x, y, cv2.INTER_CUBIC, borderMode=border))
    return seen if image.dtype == np.uint8 else within_levels(seen)


def in_view(current_from_previous: Vector, camera: Camera, valid: Flags) -> Flags:
    """Which pixels of an [h, w] map the previous picture showed too, before the turn, far things assumed.

    valid  [h, w] those of either picture that show the scene, not padding
    """
    height, width = valid.shape
    small = camera.resized(width, height)
    # v @ R is R^T v for each row vector: from the current orientation into the previous one.
    rays = small.rays() @ current_from_previous
    ahead = rays[..., 2] > 0
    depth = np.where(ahead, rays[..., 2], 1.0)
    x = np.where(ahead, small.fx * rays[..., 0] / depth + small.cx, NOWHERE_PX)
    y = small.fy * rays[..., 1] / depth + small.cy
    shown = cv2.remap(valid.astype(np.uint8), x.astype(np.float32), y.astype(np.float32), cv2.INTER_NEAREST)
    return np.asarray(shown, dtype=np.bool_)


def _rows_before(current_from_previous: Vector, camera: Camera, bend: Vector) -> tuple[Maps, Maps]:
    """Where the previous picture has what is far away at each pixel, x and y [H, W]: a homography for each row."""
    back = camera.matrix @ current_from_previous.T @ straight_from_bent(bend, camera)
    columns, rows, ones = (
        (back @ np.linalg.inv(camera.matrix)).astype(np.float32).transpose(2, 1, 0)[..., None]
    )
    down = np.arange(camera.height, dtype=np.float32)[:, None]
    x, y, z = columns * np.arange(camera.width, dtype=np.float32) + (rows * down + ones)
    ahead = np.maximum(z, LEAST_AHEAD)
    return x / ahead, y / ahead
