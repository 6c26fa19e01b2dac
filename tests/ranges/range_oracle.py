"""A network that knows the truth: beta from the scene's depth and the way really flown between two frames."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from flightdepth.camera import Camera
from flightdepth.ranges import MultiRangeEstimator, RangedDepth
from flightdepth.runtimes.grid import NetworkGrid
from flightdepth.runtimes.prediction import Prediction
from flightdepth.weights.card import NetworkCard
from tests_networks import difference_card

FRAME_NS = 33_366_667
CAMERA = Camera.from_fov(128, 128, 90)

Depth = Callable[[np.ndarray, Camera], np.ndarray]


def card(depth_max_m: float = 100.0, D0_m: float = 0.3, depth_min_m: float = 0.0) -> NetworkCard:
    return difference_card(
        name="oracle", D0_m=D0_m, depth_min_m=depth_min_m, depth_max_m=depth_max_m, focal_px=64
    )


CLAMPED = card(60.0, 0.5, 10.0)


def picture(index: int, camera: Camera = CAMERA) -> np.ndarray:
    """A frame of one colour that spells its index, whatever it is resized to, and is as bright as all others."""
    red, blue = divmod(index, 100)
    green = round((100 - 0.299 * red - 0.114 * blue) / 0.587)  # ITU-R BT.601
    image = np.zeros((camera.height, camera.width, 3), dtype=np.uint8)
    image[:] = red, green, blue
    return image


class Oracle:
    """`depth(position, camera) -> [h, w]` is the scene, `position(index)` the flight; both in camera axes."""

    def __init__(
        self, depth: Depth, position: Callable[[int], np.ndarray], card: NetworkCard = CLAMPED
    ) -> None:
        self.card = card
        self.batches: list[tuple[int, ...]] = []
        self.displacements: list[np.ndarray] = []
        self._depth, self._position = depth, position

    def grid(self, camera: Camera) -> NetworkGrid:
        return NetworkGrid(camera, self.card.focal_px)

    def predict(self, previous_n, current, displacements_n3, camera, valid=None) -> Prediction:
        indices = [_index(image) for image in previous_n]
        self.batches.append(tuple(indices))
        self.displacements.append(displacements_n3)
        here = self._position(_index(current))
        small = camera.resized(camera.width // 4, camera.height // 4)
        truth = self._depth(here, small)
        flown = np.array([np.linalg.norm(here - self._position(i)) for i in indices])[:, None, None]
        beta = np.clip(truth / (self.card.alpha * flown), self.card.beta_min, 1).astype(np.float32)
        lengths = np.linalg.norm(displacements_n3, axis=1)[:, None, None].astype(np.float32)
        valid = np.ones(truth.shape, dtype=np.bool_)
        return Prediction(beta, np.float32(self.card.alpha) * lengths * beta, None, valid)


def _index(image: np.ndarray) -> int:
    return int(image[0, 0, 0]) * 100 + int(image[0, 0, 2])


def wall(distance_m: float) -> Depth:
    """A wall across the view, `distance_m` ahead of the origin."""
    return lambda position, camera: np.full((camera.height, camera.width), distance_m - position[2])


def ground_and_sky(height_m: float) -> Depth:
    """Flat ground `height_m` below; above the horizon nothing."""

    def depth(position: np.ndarray, camera: Camera) -> np.ndarray:
        down = camera.rays()[..., 1]
        with np.errstate(divide="ignore"):
            return np.where(down > 0, (height_m - position[1]) / np.maximum(down, 0), np.inf)

    return depth


def two_walls(near_m: float, far_m: float) -> Depth:
    """The left half of the picture at one depth, the right half at another, however far one flies."""

    def depth(position: np.ndarray, camera: Camera) -> np.ndarray:
        left = np.arange(camera.width) < camera.width / 2
        return np.broadcast_to(np.where(left, near_m, far_m), (camera.height, camera.width))

    return depth


def straight(velocity: tuple[float, float, float]) -> Callable[[int], np.ndarray]:
    """The position at each frame of a flight at one velocity (m/s)."""
    return lambda index: np.array(velocity) * (index * FRAME_NS * 1e-9)


def fly(
    estimator: MultiRangeEstimator,
    velocity: tuple[float, float, float],
    frames: range,
    camera: Camera = CAMERA,
) -> list[RangedDepth]:
    """One velocity sample and one frame at each frame time."""
    results = []
    for index in frames:
        estimator.add_velocity(index * FRAME_NS, velocity)
        results.append(estimator.add_frame(index * FRAME_NS, picture(index, camera)))
    return results
