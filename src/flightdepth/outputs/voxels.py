"""Thinning: of all points in a cube of space, their mean."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flightdepth.errors import BadInput
from flightdepth.motion import Vector

BITS = 21  # of each axis in a voxel's key: a million voxels either way
MERGE_LEAST = 50_000  # rows: fewer are not worth a sort


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points in metres [N, 3], their colours uint8 RGB [N, 3], their confidence [N] 0..1.

    seen  how many points each stands for [N]; None where nobody counted
    """

    points_m: Vector
    colours: NDArray[np.uint8]
    confidence: NDArray[np.float32]
    seen: NDArray[np.int64] | None = None

    def __len__(self) -> int:
        return len(self.points_m)


class VoxelGrid:
    """Sums points by voxel; a point's confidence is its weight."""

    def __init__(self, voxel_m: float) -> None:
        self._voxel_m = voxel_m
        self._keys = [np.empty(0, np.int64)]
        self._sums = [np.empty((0, 8))]  # weight, weighted x y z r g b, number
        self._waiting = 0  # rows after the first, merged array

    def add(self, points_m: Vector, colours: NDArray[np.uint8], confidence: NDArray[np.float32]) -> None:
        """Points [N, 3] with colours [N, 3] and confidence [N], above 0."""
        weight = confidence.astype(np.float64)[:, None]
        parts = [weight, weight * points_m, weight * colours, np.ones_like(weight)]
        keys, sums = _merged(self._key(points_m), np.concatenate(parts, axis=1))
        self._keys.append(keys)
        self._sums.append(sums)
        self._waiting += len(keys)
        # All is sorted again only when it has grown by half: else the work goes with the square of the flight's length.
        if self._waiting > max(len(self._keys[0]) // 2, MERGE_LEAST):
            self._merge()

    def cloud(self) -> Cloud:
        """One point a voxel."""
        self._merge()
        sums = self._sums[0]
        mean = sums[:, 1:7] / sums[:, :1]
        colours = np.clip(np.rint(mean[:, 3:]), 0, 255).astype(np.uint8)
        confidence = (sums[:, 0] / sums[:, 7]).astype(np.float32)
        return Cloud(mean[:, :3], colours, confidence, seen=sums[:, 7].astype(np.int64))

    def _key(self, points_m: Vector) -> NDArray[np.int64]:
        cells = np.floor(points_m / self._voxel_m).astype(np.int64) + (1 << (BITS - 1))
        if len(cells) and (cells.min() < 0 or cells.max() >= 1 << BITS):
            reach = self._voxel_m * (1 << (BITS - 1))
            raise BadInput("--voxel", expected="larger voxels", got=f"a flight that leaves {reach:.0f} m")
        return np.asarray((cells[:, 0] << 2 * BITS) | (cells[:, 1] << BITS) | cells[:, 2])

    def _merge(self) -> None:
        keys, sums = _merged(np.concatenate(self._keys), np.concatenate(self._sums))
        self._keys, self._sums, self._waiting = [keys], [sums], 0


def _merged(keys: NDArray[np.int64], rows: Vector) -> tuple[NDArray[np.int64], Vector]:
    """Each key once, with the sum of its rows."""
    found, place = np.unique(keys, return_inverse=True)
    sums = [np.bincount(place, column, minlength=len(found)) for column in rows.T]
    return found, np.stack(sums, axis=1)
