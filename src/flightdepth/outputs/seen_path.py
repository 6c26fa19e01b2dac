"""The way of a camera whose log tells only how fast it flies: directions and turns of the pictures, put together.

Nothing tells north, nor how the camera was tilted: where it begins it is taken to look north, level.
"""

from __future__ import annotations

import numpy as np

from flightdepth.motion import NED_FROM_CAMERA, Vector
from flightdepth.ranges.result import RangedDepth

REMEMBERED = 1024  # frames that a pair may reach back


class SeenPath:
    """Where the camera was at each frame; ask `at` in the order of the flight."""

    def __init__(self) -> None:
        self._begun_ns: int | None = None
        self._segment = -1
        self._positions: dict[int, Vector] = {}

    def at(self, index: int, result: RangedDepth) -> tuple[Vector, int, Vector] | None:
        """Position (3,) NED in metres, segment, and attitude (3, 3) NED from camera; None where nothing is seen.

        Of one segment are frames between which pairs tell the way; its origin is its first frame with depth.
        """
        orientation, moved_m = result.orientation, result.moved_m
        if orientation is None or moved_m is None:
            return None
        ned_from_camera = NED_FROM_CAMERA @ orientation.rotation
        ways_m = moved_m @ ned_from_camera.T
        earlier = (index - result.shifts).tolist()
        known = [k for k, frame in enumerate(earlier) if frame in self._positions]
        if known and orientation.begun_ns == self._begun_ns:
            position = (
                self._positions[earlier[known[-1]]] + ways_m[known[-1]]
            )  # the longest: least is added up
        else:
            self._begun_ns, self._segment, position = orientation.begun_ns, self._segment + 1, np.zeros(3)
            self._positions = {frame: -way_m for frame, way_m in zip(earlier, ways_m, strict=True)}
        self._positions[index] = position
        if len(self._positions) > REMEMBERED:
            del self._positions[next(iter(self._positions))]
        return position, self._segment, ned_from_camera
