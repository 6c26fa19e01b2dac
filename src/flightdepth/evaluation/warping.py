"""How well depth explains a pair: the earlier picture, warped by depth and displacement, beside the current one.

A point of `current` at ray (x, y, 1) and depth Z was seen by a camera that did not turn at
(x + w d_x, y + w d_y) / (1 + w d_z), with w = 1/Z. Occlusion is not modelled: what the earlier picture hid is
compared with what hid it, so even the true depth leaves an error beside edges. It leaves more where texture is finer
than the pixels or was drawn differently (on rendered bare fields 0.24 to 0.27 of the error without a warp), so the
figure ranks methods and has no ideal. Interpolation smooths noise, which favours every warp over none.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from flightdepth.camera import Camera
from flightdepth.levels import AnyImage, exact_grey
from flightdepth.motion import Vector
from flightdepth.runtimes.arrays import Flags, Maps

NEAREST_M = 1e-3  # a network's output of exactly 0 has no inverse
# Sideways shifts, pixels, of the constant depths to choose from: a quarter of a pixel to a sixth of the width.
CONSTANT_SHIFTS_PX = np.geomspace(0.25, 64.0, 33)
LEAST_INSIDE = 0.5  # of the known pixels, for a constant depth that may be called the best


@dataclass(frozen=True)
class Match:
    """error: mean |grey difference| after the warp, as a share of that without any warp on the same pixels
    (0 perfect, 1 as good as the plane at infinity); NaN where nothing can be compared. inside: those pixels,
    as a share of the known ones.
    """

    error: float
    inside: float


class WarpedPair:
    """Two pictures RGB [H, W, 3] of an ideal pinhole that did not turn, `displacement` (3,) metres apart.

    `known_previous`, `known_current`, bool [H, W]: the pixel shows the scene, not padding.
    """

    def __init__(
        self,
        previous: AnyImage,
        current: AnyImage,
        displacement: Vector,
        camera: Camera,
        *,
        known_previous: Flags,
        known_current: Flags,
    ) -> None:
        self._previous, self._current = exact_grey(previous), exact_grey(current)
        self._known_previous = known_previous.astype(np.float32)
        self._comparable = known_previous & known_current
        self._displacement, self._camera = displacement, camera
        self._rays = camera.rays()
        self._unmoved = np.abs(self._current - self._previous)

    def error_map(self, depth_m: Maps) -> Maps:
        """|grey difference|, 0..255, float32 [H, W], after warping by depth [H, W] or [h, w]; NaN outside."""
        return self._error(inverse_at(depth_m, self._camera))

    def unmoved_map(self) -> Maps:
        """The same without any warp: the plane at infinity."""
        return np.where(self._comparable, self._unmoved, np.float32(np.nan)).astype(np.float32)

    def match(self, error: Maps) -> Match:
        """How well the depth of an `error_map` [H, W] explains the pair."""
        inside = np.isfinite(error)
        without = float(self._unmoved[inside].sum(dtype=np.float64))
        share = float(error[inside].sum(dtype=np.float64)) / without if without > 0 else float("nan")
        return Match(share, float(inside.sum() / max(1, int(self._comparable.sum()))))

    def best_constant(self) -> Match:
        """The match of the one depth, chosen with both pictures in sight, that explains the pair best."""
        length_m = float(np.linalg.norm(self._displacement))
        inverses = CONSTANT_SHIFTS_PX / (self._camera.fx * length_m)
        constants = (np.full(self._current.shape, float(inverse), np.float32) for inverse in inverses)
        matches = [self.match(self._error(constant)) for constant in constants]
        kept = [match for match in matches if match.inside >= LEAST_INSIDE and np.isfinite(match.error)]
        return min(kept, key=lambda match: match.error, default=Match(float("nan"), 0.0))

    def _error(self, inverse: Maps) -> Maps:
        x, y = self._seen_at(inverse)
        linear, outside = cv2.INTER_LINEAR, cv2.BORDER_CONSTANT
        there = cv2.remap(self._previous, x, y, linear, borderMode=outside)
        known = cv2.remap(self._known_previous, x, y, linear, borderMode=outside) > 0.999
        error = np.abs(self._current - there)
        return np.where(known & self._comparable, error, np.float32(np.nan)).astype(np.float32)

    def _seen_at(self, inverse: Maps) -> tuple[Maps, Maps]:
        """Pixels (x, y) of the earlier picture, [H, W] each; far outside it where depth is unknown."""
        dx, dy, dz = self._displacement
        ahead = 1 + inverse * dz
        sound = np.isfinite(inverse) & (ahead > 0)
        ahead = np.where(sound, ahead, 1)
        x = self._camera.fx * (self._rays[..., 0] + inverse * dx) / ahead + self._camera.cx
        y = self._camera.fy * (self._rays[..., 1] + inverse * dy) / ahead + self._camera.cy
        far = 2.0 * max(self._camera.width, self._camera.height)
        x, y = (np.where(sound, part.clip(-far, far), -far).astype(np.float32) for part in (x, y))
        return x, y


def inverse_at(depth_m: Maps, camera: Camera) -> Maps:
    """Inverse depth float32 at the camera's size; between the pixels of a smaller map it runs straight.

    The inverse depth of a plane does so too, and that of the sky is 0.
    """
    inverse = (1 / np.maximum(depth_m, np.float32(NEAREST_M))).astype(np.float32)
    size = (camera.width, camera.height)
    if inverse.shape == size[::-1]:
        return inverse
    return np.asarray(cv2.resize(inverse, size, interpolation=cv2.INTER_LINEAR), dtype=np.float32)
