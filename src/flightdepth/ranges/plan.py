"""What the next frame's pairs shall look at: cluster centroids, a spread to start with, and scouts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from flightdepth.motion import Vector
from flightdepth.ranges.clusters import centroids, wanted_displacements
from flightdepth.ranges.fusion import Fused, best_beta, ends
from flightdepth.ranges.network import Map
from flightdepth.weights.card import NetworkCard

# Below this share of measured pixels their clusters say nothing about the picture.
MIN_MEASURED = 0.01
# What is measured farther away than this asks for no longer pairs: a cloud that drifts would, frame after frame.
FARTHEST_M = 300.0
# Three quarters of the picture may move by at most a quarter of its smaller side, in any direction.
MAX_PICTURE_SHIFT = 0.25
NEAR_QUANTILE = 0.25
# A scout is one more pair, at most this often, when this share of the picture is only bounded.
SCOUT_EVERY_S = 0.25
MIN_NEARER = 0.01
MIN_FARTHER = 0.05


class Planner:
    """Learns from each fused depth, and says which displacements the next frame wants.

    Start-up: until a depth is known, the `ranges` displacements stand in equal ratios strictly between the
    shortest and the longest usable one (one range: their geometric mean).

    Bounds: D <= MAX_PICTURE_SHIFT * smaller side / focal * near depth, the quantile NEAR_QUANTILE of the
    picture's depths ("farther than" counts as infinitely far). Sideways motion by D moves a point at depth Z
    by focal * D / Z pixels, and forward motion hardly more at the edge of a 90-degree view, so no direction
    needs to be known.

    With `saturation` clusters are of log depth, FARTHEST_M at most, and scouts go out: clusters hold measured
    pixels only, so what lies outside every range would never be looked for. When enough of the picture is only
    bounded, one extra pair looks just below the smallest "at most" or just above the largest "at least" so far;
    each scout that finds nothing moves that bound on, until no displacement reaches beyond it and it starts
    over. What a scout finds joins the next clusters; under a sky it finds nothing and changes nothing.

    Turns: with one range and `turns` of 2 or more there are so many clusters, and successive frames look at one
    after the other. What a frame does not know is then taken from the one before.
    """

    def __init__(
        self,
        card: NetworkCard,
        ranges: int,
        *,
        sides: float,
        memory_s: float,
        saturation: bool,
        turns: int = 1,
    ) -> None:
        """`sides`: smaller side of the picture over focal length; `memory_s`: how long a depth counts.

        `ranges` may change between frames; it counts from the next depth that is learnt on.
        """
        self._card, self.ranges, self._saturation = card, ranges, saturation
        self._turns, self._turn = turns, 0
        self._depth_before_m: Map | None = None
        self._shift_per_depth = MAX_PICTURE_SHIFT * sides
        self._memory_ns = round(memory_s * 1e9)
        self._learned_ns = 0
        self._centroids_m: Vector | None = None
        self._limit_m = np.inf
        self._nearer_m: float | None = None
        self._farther_m: float | None = None
        self._scouted_ns: int | None = None
        self._near_next = True
        self._start_over = False

    def look_through(self, card: NetworkCard, sides: float) -> None:
        """The lens changed: the card at the new focal length, and `sides`. What was learnt in metres holds."""
        before, self._shift_per_depth = self._shift_per_depth, MAX_PICTURE_SHIFT * sides
        self._card, self._limit_m = card, self._limit_m * self._shift_per_depth / before
        self._depth_before_m = None  # at other pixels

    def wanted(self, stamp_ns: int, usable_m: Vector) -> tuple[Vector, Vector]:
        """Wanted displacements [m] and the depths [m] that ask for them (NaN at start-up), metres.

        `usable_m` holds the lengths that can be had, at least one.
        """
        if stamp_ns - self._learned_ns > self._memory_ns:
            self._centroids_m, self._nearer_m, self._farther_m = None, None, None
        if self._centroids_m is None:
            self._depth_before_m = None
            shortest, longest = usable_m.min(), usable_m.max()
            spread = np.geomspace(shortest, longest, self.ranges + 2)[1:-1]
            depths, wanted = np.full(self.ranges, np.nan), spread
        else:
            depths = self._looked_at(self._centroids_m)
            wanted = self._displacements(depths)
        scout = self._scout(stamp_ns, usable_m)
        return np.append(wanted, self._displacements(scout)), np.append(depths, scout)

    def learn(self, stamp_ns: int, fused: Fused, valid: NDArray[np.bool_]) -> None:
        """Take the fused maps [h, w] of this frame, of which `valid` [h, w] pixels show the scene."""
        depth_m, nearer, farther = self._of_all_turns(
            fused.depth_m[valid], fused.nearer_than_m[valid], fused.farther_than_m[valid]
        )
        self._learned_ns = stamp_ns
        measured = np.count_nonzero(np.isfinite(depth_m)) >= MIN_MEASURED * depth_m.size
        before, clusters = self._centroids_m, max(self.ranges, self._turns if self.ranges == 1 else 1)
        if before is not None and len(before) != clusters:
            before = None  # so many were asked for until now
        asking_m = np.minimum(depth_m, np.float32(FARTHEST_M)) if self._saturation else depth_m
        self._centroids_m = (
            centroids(asking_m, clusters, before, logarithmic=self._saturation) if measured else None
        )
        self._limit_m = self._shift_per_depth * _near_depth(depth_m, nearer, farther)
        if self._start_over:
            # This frame's bounds are those of a scout that could not be followed; the next frame's are not.
            self._nearer_m, self._farther_m, self._start_over = None, None, False
            return
        self._nearer_m = _tightest(nearer, ~np.isfinite(farther), MIN_NEARER, self._nearer_m, np.min)
        self._farther_m = _tightest(farther, ~np.isfinite(nearer), MIN_FARTHER, self._farther_m, np.max)

    def _looked_at(self, centroids_m: Vector) -> Vector:
        """The clusters that this frame looks at: all, or the one whose turn it is."""
        if self.ranges > 1:
            return centroids_m
        self._turn = (self._turn + 1) % len(centroids_m)
        return centroids_m[self._turn : self._turn + 1]

    def _of_all_turns(self, depth_m: Map, nearer_m: Map, farther_m: Map) -> tuple[Map, Map, Map]:
        """Depth and bounds [k] of this frame, completed by the depth of the one before where turns are taken."""
        before_m, self._depth_before_m = self._depth_before_m, depth_m
        if self._turns == 1 or self.ranges > 1 or before_m is None or before_m.shape != depth_m.shape:
            return depth_m, nearer_m, farther_m
        told = np.isnan(depth_m) & np.isfinite(before_m)
        nothing = np.float32(np.nan)
        return (
            np.where(told, before_m, depth_m),
            np.where(told, nothing, nearer_m),
            np.where(told, nothing, farther_m),
        )

    def _displacements(self, depths_m: Vector) -> Vector:
        return wanted_displacements(depths_m, self._card, self._limit_m)

    def _scout(self, stamp_ns: int, usable_m: Vector) -> Vector:
        """The depth to look for, shape (1,), or nothing, shape (0,). Near and far take turns."""
        rested = self._scouted_ns is None or stamp_ns - self._scouted_ns >= SCOUT_EVERY_S * 1e9
        if not (self._saturation and rested) or (self._nearer_m is None and self._farther_m is None):
            return np.empty(0)
        self._scouted_ns = stamp_ns
        near = self._farther_m is None or (self._near_next and self._nearer_m is not None)
        self._near_next = not near
        return self._scout_near(float(usable_m.min())) if near else self._scout_far(float(usable_m.max()))

    def _scout_near(self, shortest_m: float) -> Vector:
        assert self._nearer_m is not None
        depth_m = np.array([self._nearer_m * best_beta(self._card) / ends(self._card)[1]])
        self._start_over = bool(self._displacements(depth_m)[0] <= shortest_m)
        return depth_m

    def _scout_far(self, longest_m: float) -> Vector:
        assert self._farther_m is not None
        depth_m = np.array([self._farther_m])
        self._start_over = bool(self._displacements(depth_m)[0] >= min(longest_m, self._limit_m))
        return depth_m


def _tightest(
    bound_m: Map,
    alone: NDArray[np.bool_],
    least_share: float,
    last_m: float | None,
    choose: Callable[[NDArray[np.float32]], np.float32],
) -> float | None:
    """The bound that scouts have reached: `choose` of `bound_m` and the last; None where few pixels have one.

    `alone`: the pixel has no bound on the other side. One with both lies between two ranges.
    """
    told = bound_m[np.isfinite(bound_m) & alone]
    if told.size <= least_share * bound_m.size:
        return None
    return float(choose(told if last_m is None else np.append(told, np.float32(last_m))))


def _near_depth(depth_m: Map, nearer_m: Map, farther_m: Map) -> float:
    """The quantile NEAR_QUANTILE of the picture's depths; infinite where most is far or nothing known."""
    picture = np.where(np.isfinite(farther_m), np.inf, np.where(np.isfinite(depth_m), depth_m, nearer_m))
    picture = picture[~np.isnan(picture)]
    if not picture.size:
        return float("inf")
    rank = int(NEAR_QUANTILE * (picture.size - 1))
    return float(np.partition(picture, rank)[rank])
