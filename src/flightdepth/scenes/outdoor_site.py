"""Where there is room outdoors: clear of the flight, and of what stands already."""

from __future__ import annotations

import numpy as np

from flightdepth.scenes import chance
from flightdepth.scenes.outdoor_things import Part
from flightdepth.scenes.scene import Floats

MOST_TRIES = 40  # a thing that finds no place is left out


class Site:
    """What was built so far, where the ground is, and where there is room."""

    def __init__(self, path: Floats, checked_path: Floats, clearance_m: float) -> None:
        self.path = path
        self._checked_path = checked_path
        self.parts: list[Part] = []
        self.mounds: list[tuple[float, float, float, float]] = []  # x, z, radius of the sphere, height
        self._clearance_m = clearance_m
        self._taken: list[tuple[float, float, float]] = []  # x, z, radius

    def foot(self, x: float, z: float) -> Floats:
        """The point of the ground at (x, z)."""
        height = 0.0
        for mound_x, mound_z, radius, top in self.mounds:
            square = radius * radius - (x - mound_x) ** 2 - (z - mound_z) ** 2
            if square > 0:
                height = max(height, float(np.sqrt(square)) - radius + top)
        return np.array([x, -height, z])

    def find(
        self, rng: np.random.Generator, distance_m: tuple[float, float], radius: float, height: float
    ) -> Floats | None:
        """A free place ahead of some point of the path, and take it; None when there is none."""
        for _ in range(MOST_TRIES):
            start = self.path[int(rng.integers(len(self.path)))]
            ahead = chance.log_uniform(rng, *distance_m)
            foot = self.foot(start[0] + rng.uniform(-0.9, 0.9) * ahead, start[2] + ahead)
            if self.is_clear(foot, radius, height) and self._is_free(foot, radius):
                self._taken.append((foot[0], foot[2], radius))
                return foot
        return None

    def is_clear(self, foot: Floats, radius: float, height: float) -> bool:
        """Whether an upright cylinder that stands on `foot` keeps clear of the path."""
        path = self._checked_path
        away = np.hypot(path[:, 0] - foot[0], path[:, 2] - foot[2]) - radius
        above = (foot[1] - height) - path[:, 1]
        return bool(np.maximum(away, above).min() >= self._clearance_m)

    def _is_free(self, foot: Floats, radius: float) -> bool:
        return all((foot[0] - x) ** 2 + (foot[2] - z) ** 2 > (radius + r) ** 2 for x, z, r in self._taken)
