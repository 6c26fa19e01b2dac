"""What the estimator says about one frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flightdepth.ranges.network import Map
from flightdepth.ranges.seen_turns import SeenOrientation


@dataclass(frozen=True)
class RangedDepth:
    """Depth of one frame, fused from n pairs; H, W of the source image, h, w of the network's output.

    depth_m          [H, W]     z-depth in metres, NaN = unknown
    confidence       [H, W]     0..1, 0 = do not use (depth NaN). With sigma_m: the chance that depth is right within
                                a quarter. Without: the best range's weight as a share of the largest possible
    sigma_m          [H, W]     standard deviation in metres, or None where the network does not tell
    range_depths_m   [n, h, w]  each range's depth before fusion, ends of its range included
    shifts           [n]        frames between current and previous, shortest first
    displacements_m  [n]        lengths really flown between them, metres
    centroids_m      [n]        depths that chose these pairs; NaN at start-up, when there are none
    farther_than_m   [H, W]     where depth is NaN: it is at least this; NaN where no bound is known
    nearer_than_m    [H, W]     where depth is NaN: it is at most this; NaN where no bound is known
    latency_ms                  time spent in `add_frame`
    reason                      why there is no depth at all, None when there is
    notes                       assumptions behind this depth, a line each; mostly empty
    doubt                       what the pictures say against the log's motion, None where they do not
    moved_m          [n, 3]     the displacements as vectors in the current camera's axes (right, down,
                                forward); None where their direction is unknown
    aside_rad      [n]          standard deviations of the directions of moved_m, in the least sure way; None with it
    orientation                 of the camera since an earlier frame, as turns in the pictures add up; None where the
                                log tells its attitude, or nothing is known
    network                     name of the one that gave this depth; empty where there is none

    n is the number of ranges, less where two chose the same frame, one more when a scout looks beyond them.
    """

    depth_m: Map
    confidence: Map
    sigma_m: Map | None
    range_depths_m: Map
    shifts: NDArray[np.int64]
    displacements_m: NDArray[np.float64]
    centroids_m: NDArray[np.float64]
    farther_than_m: Map
    nearer_than_m: Map
    latency_ms: float
    reason: str | None = None
    notes: tuple[str, ...] = ()
    doubt: str | None = None
    moved_m: NDArray[np.float64] | None = None
    aside_rad: NDArray[np.float64] | None = None
    orientation: SeenOrientation | None = None
    network: str = ""

    def __post_init__(self) -> None:
        size, n = self.depth_m.shape, len(self.shifts)
        maps = [self.confidence, self.farther_than_m, self.nearer_than_m]
        if len(size) != 2 or any(m.shape != size for m in maps):
            raise ValueError(f"expected maps of one size [H, W], got {[size, *(m.shape for m in maps)]}")
        if not n == len(self.displacements_m) == len(self.centroids_m) == len(self.range_depths_m):
            raise ValueError(f"expected {n} of each per-range entry")
        if self.moved_m is not None and self.moved_m.shape != (n, 3):
            raise ValueError(f"expected moved_m [{n}, 3], got {self.moved_m.shape}")
        if (n == 0) != (self.reason is not None):
            raise ValueError("expected a reason where there is no depth, and only there")

    @classmethod
    def unknown(cls, height: int, width: int, reason: str, latency_ms: float) -> RangedDepth:
        """No depth anywhere, and why."""
        nothing = np.full((height, width), np.nan, dtype=np.float32)
        return cls(
            depth_m=nothing,
            confidence=np.zeros((height, width), dtype=np.float32),
            sigma_m=None,
            range_depths_m=np.empty((0, 0, 0), dtype=np.float32),
            shifts=np.empty(0, dtype=np.int64),
            displacements_m=np.empty(0),
            centroids_m=np.empty(0),
            farther_than_m=nothing.copy(),
            nearer_than_m=nothing.copy(),
            latency_ms=latency_ms,
            reason=reason,
        )
