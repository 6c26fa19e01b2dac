"""Depth that holds still: each frame's is averaged with the one before, moved by the known motion.

A network's errors change from frame to frame, though less than they would by chance, so an average flickers much
less and errs a little less. What does not agree (edges, things that move, a depth that was wrong) starts anew.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flightdepth.ranges.displacement import Trajectory
from flightdepth.ranges.fusion import Fused, chance
from flightdepth.ranges.network import Map
from flightdepth.ranges.pairs import Pair
from flightdepth.ranges.reprojection import Reprojection, Step, looked_up, step_between
from flightdepth.ranges.seen_turns import SeenTurns

GAIN = 0.4  # weight of the new frame
AGREE_WITHIN = 1.25  # ratio of two depths of one point beyond which they are of different things


class HeldStill:
    """A flight's depth, averaged over its frames, each moved as its trajectory or else its own pictures tell."""

    def __init__(self, average: TemporalAverage, trajectory: Trajectory, turns: SeenTurns) -> None:
        self._average, self._trajectory, self._turns = average, trajectory, turns
        self._last_ns: int | None = None  # of the last depth that the average holds

    def forget(self) -> None:
        """Begin anew: the last depth may be of damaged pictures."""
        self._last_ns = None

    def add(self, stamp_ns: int, fused: Fused, pair: Pair, *, sees_direction: bool) -> Fused:
        """A frame's depth averaged with those before, as far as the motion since the last one is known.

        `pair` is one of the frame's; with `sees_direction` its displacement points the right way, whoever told it.
        """
        step = None
        if self._last_ns is not None and (pair.directed or sees_direction):
            unit = None if pair.directed else pair.displacement_m / pair.length_m
            turns, _ = self._turns.since(np.array([self._last_ns]), stamp_ns)
            step = step_between(self._trajectory, (self._last_ns, stamp_ns), unit, turns[0])
        self._last_ns = stamp_ns
        return self._average.add(fused, step)


class TemporalAverage:
    """The running average over one flight of fused maps on the network's output grid."""

    def __init__(self, reprojection: Reprojection) -> None:
        self._reprojection = reprojection
        self._last: Fused | None = None

    def add(self, fused: Fused, step: Step | None) -> Fused:
        """The frame's maps averaged with those before; as they are where `step` is None or nothing agrees."""
        if self._last is not None and step is not None:
            fused = self._averaged(fused, self._last, step)
        self._last = fused
        return fused

    def _averaged(self, new: Fused, last: Fused, step: Step) -> Fused:
        """depth + (1 - GAIN) (last depth of the same point, moved - depth), where the two agree."""
        x, y, ahead_m = self._reprojection.seen_before(new.depth_m, step)
        before_m = looked_up(last.depth_m, x, y)
        with np.errstate(invalid="ignore", divide="ignore"):
            # Both depths of the earlier camera; their difference is that of the present one's for a small turn.
            off_m = before_m - ahead_m
            ratio = (new.depth_m + off_m) / new.depth_m
            agrees = (ratio < AGREE_WITHIN) & (ratio * AGREE_WITHIN > 1)
        share = np.where(agrees, np.float32(1 - GAIN), np.float32(0))
        depth_m = new.depth_m + share * np.where(agrees, off_m, np.float32(0))
        if new.sigma_m is None or last.sigma_m is None:
            confidence = _mixed(new.confidence, looked_up(last.confidence, x, y), share)
            return replace(new, depth_m=depth_m, confidence=confidence)
        sigma_m = _mixed(new.sigma_m, looked_up(last.sigma_m, x, y), share)
        return replace(new, depth_m=depth_m, confidence=chance(depth_m, sigma_m), sigma_m=sigma_m)


def _mixed(new: Map, last: Map, share: Map) -> Map:
    """Errors of consecutive frames go together, so their deviations are averaged, not reduced."""
    return np.where(share > 0, new + share * (last - new), new)
