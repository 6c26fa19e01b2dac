"""What stands still in the pictures of a camera that turns: landing gear, a propeller guard, burned-in text.

When a camera turns, all that it sees moves, however far away it is. Edges that stay where they are belong to the
drone, or were drawn into the picture. An edge along the way that the picture moves seems to stay as well, as the
horizon does while the camera pans, so only the part of a gradient along that way counts.
"""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.flight.rotation import rotation_flow
from flightdepth.motion import Vector
from flightdepth.runtimes.arrays import Flags
from flightdepth.runtimes.lens import pixel_rays

WIDTH = 320  # of the pictures that are looked at
BLUR_PX = 0.8
LEAST_TURN_RAD = math.radians(2.0)  # since the last picture that was looked at
FEWEST = 20  # pictures looked at
LEVELS = 3.0  # of grey a pixel: a gradient as strong is an edge, and a stronger one counts no more
STAYS = 0.6  # of the pictures, in which an edge stands at the same place
GAP_PX = 7  # between letters, at most
OPEN_PX = 21  # where an outline runs along the way that the picture moves, at most
LEAST_PX = 30  # of a part; fewer are chance
MARGIN_PX = 3  # beside what stands still: networks see it there too
LEAST_SHARE, MOST_SHARE = 0.005, 0.3  # of the picture; more does not belong to a drone
BLANK = 0.3  # how little what is enclosed by still edges may change, beside the rest of the picture

Floats = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class StillPart:
    """What stands still: `share` of the picture, and `shown` [H, W] where it hides nothing, as masks have it."""

    share: float
    shown: Flags


class StillParts:
    """Looks at each picture before which the camera turned; some milliseconds each."""

    def __init__(self, camera: Camera, shown: Flags | None = None) -> None:
        """`shown` [H, W] is False where a mask hides the pictures already."""
        self._camera, self._known = camera, shown
        small = camera.resized(WIDTH, max(1, round(camera.height * WIDTH / camera.width)))
        self._size = small.width, small.height
        # [h, w, 2, 3]: how far a turn moves each point of the picture.
        self._moves = np.stack(rotation_flow(pixel_rays(small, 1)[..., :2].reshape(-1, 2)), axis=1)
        self._moves = self._moves.reshape(small.height, small.width, 2, 3).astype(np.float32)
        self._before: tuple[Vector, Hashable] | None = None  # a rotation, and in whose axes
        self._count = 0
        self._edges: Floats = np.zeros((small.height, small.width, 2), np.float32)
        self._grey = np.zeros((2, small.height, small.width))  # sums of levels and of their squares

    def add(self, image: NDArray[np.uint8], from_camera: Vector, axes: Hashable = None) -> None:
        """A picture uint8 RGB [H, W, 3] of the camera's size, and the rotation (3, 3) from its axes to `axes`.

        Only rotations to the same axes tell a turn.
        """
        if self._before is None or self._before[1] != axes:  # nobody knows which way it turned
            self._before = from_camera, axes
            return
        turn = cv2.Rodrigues(from_camera.T @ self._before[0])[0][:, 0]
        if np.linalg.norm(turn) < LEAST_TURN_RAD:
            return
        self._before = from_camera, axes
        grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        grey = cv2.resize(grey, self._size, interpolation=cv2.INTER_AREA).astype(np.float32)
        self._grey += grey, np.square(grey)
        grey = cv2.GaussianBlur(grey, (0, 0), BLUR_PX)
        gradient = np.stack([cv2.Sobel(grey, cv2.CV_32F, dx, 1 - dx, scale=1 / 8) for dx in (1, 0)], axis=-1)
        way = self._moves @ turn.astype(np.float32)
        way /= np.maximum(np.linalg.norm(way, axis=-1, keepdims=True), 1e-9)
        self._edges += np.clip((gradient * way).sum(-1, keepdims=True) / LEVELS, -1, 1) * way
        self._count += 1

    def found(self) -> StillPart | None:
        """What stands still and no mask hides; None where that is next to nothing, or too few turns tell."""
        if self._count < FEWEST:
            return None
        stays = np.linalg.norm(self._edges, axis=-1) > STAYS * self._count
        if stays.mean() > MOST_SHARE:
            return None
        still = _large(self._filled(stays.astype(np.uint8)))
        still = cv2.dilate(still, np.ones((2 * MARGIN_PX + 1,) * 2, np.uint8))
        size = self._camera.width, self._camera.height
        hidden = cv2.resize(still, size, interpolation=cv2.INTER_NEAREST) > 0
        if self._known is not None:
            hidden &= self._known
        share = float(hidden.mean())
        return StillPart(share, ~hidden) if LEAST_SHARE <= share <= MOST_SHARE else None

    def _filled(self, edges: Any) -> Any:
        """Still edges, and what they, or they and the picture's edge, enclose and hardly changes: 1 there, 0 else."""
        mean, square = self._grey / self._count
        deviation = np.sqrt(np.maximum(square - mean**2, 0))
        still = _closed(edges, GAP_PX)
        _, parts, figures, _ = cv2.connectedComponentsWithStats(1 - _closed(edges, OPEN_PX), connectivity=4)
        if len(figures) == 1:  # all of the picture
            return still
        outside = parts == 1 + np.argmax(figures[1:, cv2.CC_STAT_AREA])  # the largest
        around = np.percentile(deviation[outside], 90)  # half of what a camera sees may be sky
        count, parts = cv2.connectedComponents(np.asarray(~outside & (still == 0), np.uint8), connectivity=4)
        blank = [part for part in range(1, count) if np.median(deviation[parts == part]) < BLANK * around]
        return _closed(still | np.isin(parts, blank).astype(np.uint8), GAP_PX)


def _closed(still: Any, gap_px: int) -> Any:
    """With gaps of so many pixels bridged."""
    return cv2.morphologyEx(
        still, cv2.MORPH_CLOSE, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (gap_px, gap_px))
    )


def _large(still: Any) -> Any:
    """Without parts of less than LEAST_PX."""
    _, parts, figures, _ = cv2.connectedComponentsWithStats(still, connectivity=8)
    large = figures[:, cv2.CC_STAT_AREA] >= LEAST_PX
    return np.asarray(still * large[parts], np.uint8)
