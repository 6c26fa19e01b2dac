"""Corners of the current picture, found again in earlier ones; what each pair shows is tracked once."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.levels import AnyImage, grey
from flightdepth.motion import Vector
from flightdepth.ranges.turning import turned
from flightdepth.runtimes.arrays import Flags
from flightdepth.runtimes.sampling import shown_at

Rays = tuple[Vector, Vector]  # now and before, [N, 3] each, z = 1

MOST_POINTS = 250
QUALITY = 0.005  # of the best corner's
# A wide window holds the edge of a near thing and what lies behind it: 11 px are no better. Eight make OpenCV's
# vectors full: they take half the time of 11.
WINDOW_PX = 8
LEVELS = 2  # reaches 10 px
STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 10, 0.03)  # steps, and px below which they end
LARGEST_RETURN_PX = 0.25  # a track that does not come back to within this is lost
# Up to such a turn points are followed as well in pictures that are not turned back.
TURNS_PATCHES_RAD = np.radians(1)


class Tracker:
    """Tracks of pairs that share their current picture, of `camera`, an ideal pinhole."""

    def __init__(self, camera: Camera, shown: Flags | None = None) -> None:
        """`shown` [h, w], a quarter of the size, is False where no corners are to be tracked."""
        self.camera, self._shown = camera, shown
        self._current: AnyImage | None = None
        self._corners: Corners | None = None
        self._found: list[tuple[AnyImage, Rays]] = []

    def rays(self, previous: AnyImage, current: AnyImage) -> Rays:
        """Rays (x, y, 1) of corners of `current` and of the same points in `previous`; RGB or grey, 0 to 255."""
        if self._corners is None or self._current is not current:
            corners = Corners(current, self.camera, self._shown)
            self._current, self._corners, self._found = current, corners, []
        known = next((rays for image, rays in self._found if image is previous), None)
        if known is None:
            known = self._corners.rays(previous)
            self._found.append((previous, known))
        return known

    def rays_turned(self, previous: AnyImage, current: AnyImage, turn: Vector, turn_rad: float) -> Rays:
        """The same, those of `previous` in the current orientation as far as that is known; `turn` (3, 3)."""
        if turn_rad > TURNS_PATCHES_RAD:
            return self.rays(turned(in_grey(previous), turn, self.camera), current)
        now, before = self.rays(previous, current)
        before = before @ turn.T
        return now, before / before[:, 2:]


class Corners:
    """Corners of one picture."""

    def __init__(self, image: AnyImage, camera: Camera, shown: Flags | None = None) -> None:
        self.camera = camera
        self._grey = in_grey(image)
        # Corners of half the size are found in a third of the time, and are as good to follow.
        half = cv2.resize(self._grey, (camera.width // 2, camera.height // 2), interpolation=cv2.INTER_AREA)
        size = (half.shape[1], half.shape[0])
        mask = None if shown is None else shown_at(shown, *size).astype(np.uint8)
        found = cv2.goodFeaturesToTrack(half, MOST_POINTS, QUALITY, max(3, camera.width // 64), mask=mask)
        self._points = None if found is None else 2 * found + 0.5

    def rays(self, previous: AnyImage) -> Rays:
        """Rays (x, y, 1) of the corners that are found in `previous`, now and there, [N, 3] each."""
        if self._points is None:
            return np.empty((0, 3)), np.empty((0, 3))
        grey = in_grey(previous)
        there, found = _tracked(self._grey, grey, self._points)
        # A right track returns to where it began, so that is where the way back is looked for.
        back, found_back = _tracked(grey, self._grey, there, near=self._points)
        missed_px = (back - self._points)[:, 0]
        returned = (missed_px * missed_px).sum(axis=1) < LARGEST_RETURN_PX**2
        kept = found & found_back & returned
        return _rays(self._points[kept, 0], self.camera), _rays(there[kept, 0], self.camera)


def tracked_rays(previous: AnyImage, current: AnyImage, camera: Camera) -> Rays:
    """Rays of a single pair's corners; see Corners."""
    return Corners(current, camera).rays(previous)


def in_grey(image: AnyImage) -> AnyImage:
    """A picture [H, W, 3] RGB as [H, W]; one that is grey already as it is."""
    return image if image.ndim == 2 else grey(image)


def _tracked(
    start: NDArray[Any], end: NDArray[Any], points: NDArray[Any], *, near: NDArray[Any] | None = None
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Where points [N, 1, 2] of one grey picture are in another (Lucas-Kanade), and whether they were found.

    `near` [N, 1, 2]: where they are but for a few pixels, which needs no smaller pictures.
    """
    window: dict[str, Any] = {"winSize": (WINDOW_PX, WINDOW_PX), "criteria": STOP}
    if near is None:
        window |= {"maxLevel": LEVELS}
    else:
        near, window = near.copy(), window | {"maxLevel": 0, "flags": cv2.OPTFLOW_USE_INITIAL_FLOW}
    there, found, _ = cv2.calcOpticalFlowPyrLK(start, end, points, near, **window)  # type: ignore[arg-type]
    return np.asarray(there, dtype=np.float32), np.asarray(found)[:, 0] == 1


def _rays(pixels: NDArray[np.float32], camera: Camera) -> Vector:
    rays = np.ones((len(pixels), 3))
    rays[:, :2] = (pixels - np.array([camera.cx, camera.cy])) / np.array([camera.fx, camera.fy])
    return rays
