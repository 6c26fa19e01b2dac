"""Whether the log's speed holds: is a point as far away as half a second ago, less what was flown since?

All depth is as wrong as the length of its pair. A speed that is always wrong by the same share shows in no picture.
But one that is now too high and now too low makes the depth of the same points waver, and that shows. What they waver
by is in each error bar then, as a deviation that the log tells is (`ranges/motion_error.py`).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from flightdepth.motion import Vector
from flightdepth.ranges.displacement import Trajectory
from flightdepth.ranges.fusion import LEAST_SIGMA, WORST_SIGMA, Fused
from flightdepth.ranges.network import Map
from flightdepth.ranges.pairs import Pair, same_way
from flightdepth.ranges.reprojection import Reprojection, Step, looked_up, step_between
from flightdepth.ranges.seen_turns import SeenTurns

LOOK_BACK_S = 0.5  # errors of a receiver go together for a second: what is nearer wavers little
LONGEST_S = 1.0  # by then too little of the picture may be left, and the network's own error changes
EVERY_S = 0.1
USUAL = 0.01  # of the depth: what a network's own error wavers by where the log is right (docs/log.md)
MOST = 0.33  # of the depth; a velocity that is less sure gives no pair where a log tells it
MEMORY_S = 3.0
FEWEST = 100  # pixels that both frames know


@dataclass(frozen=True)
class _Kept:
    stamp_ns: int
    depth_m: Map
    share: Map  # its error bar, of the depth
    speed_m_s: float
    pair: Pair


class Wavering:
    """How far the log's speed is off in this flight, as far as depth that wavers tells.

    Where the log tells no attitude, `turns` do.
    """

    def __init__(self, trajectory: Trajectory, turns: SeenTurns) -> None:
        self._trajectory, self._turns = trajectory, turns
        self._kept: deque[_Kept] = deque()
        self._variance = self._weight = 0.0  # the last seconds' sum, (m/s)^2, and what it is to be divided by
        self._learnt_ns = 0

    @property
    def sigma_m_s(self) -> float:
        """The deviation of the log's speed that was seen, m/s."""
        return math.sqrt(max(self._variance, 0.0) / self._weight) if self._weight else 0.0

    def forget(self) -> None:
        """Compare what comes with nothing before: that may be of another lens. What was learnt stays."""
        self._kept.clear()

    def widened(self, stamp_ns: int, pairs: Iterable[Pair]) -> tuple[Pair, ...]:
        """The frame's pairs, each length as unsure as it was seen to be, where the log does not say more."""
        return tuple(replace(pair, length_sigma_m=self._seen_m(stamp_ns, pair)) for pair in pairs)

    def _seen_m(self, stamp_ns: int, pair: Pair) -> float:
        drift_m = self.sigma_m_s * _seconds(pair, stamp_ns)
        return max(pair.length_sigma_m, min(drift_m, MOST * pair.length_m))

    def learn(self, stamp_ns: int, fused: Fused, pair: Pair, reprojection: Reprojection) -> None:
        """What a frame's depth, as it is told, says beside that of half a second ago.

        `pair` is one of the frame's. Without error bars, or where nobody tells how the camera turns, nothing is learnt.
        """
        told = pair.directed and self._trajectory.knows_attitude
        if fused.sigma_m is None or not (told or (pair.seen and self._turns.goes_on(stamp_ns))):
            return
        if self._kept and stamp_ns - self._kept[-1].stamp_ns < EVERY_S * 1e9:
            return
        with np.errstate(invalid="ignore"):
            share = np.maximum(fused.sigma_m / fused.depth_m, np.float32(LEAST_SIGMA))
        new = _Kept(stamp_ns, fused.depth_m, share, pair.length_m / _seconds(pair, stamp_ns), pair)
        while self._kept and stamp_ns - self._kept[0].stamp_ns > LONGEST_S * 1e9:
            self._kept.popleft()
        old_enough = (old for old in reversed(self._kept) if stamp_ns - old.stamp_ns >= LOOK_BACK_S * 1e9)
        old = next(old_enough, None)
        self._kept.append(new)
        if old is not None:
            self._compare(new, old, reprojection)

    def _compare(self, new: _Kept, old: _Kept, reprojection: Reprojection) -> None:
        step = self._step(new, old)
        if step is None:
            return
        x, y, ahead_m = reprojection.seen_before(new.depth_m, step)
        ratio = changed(ahead_m, new.share, looked_up(old.depth_m, x, y), looked_up(old.share, x, y))
        if ratio is None:
            return
        kept = math.exp((self._learnt_ns - new.stamp_ns) * 1e-9 / MEMORY_S)
        slower_m_s = min(new.speed_m_s, old.speed_m_s)  # whose error is the larger share
        wavered = (ratio**2 - USUAL**2) * slower_m_s**2
        self._variance = kept * self._variance + wavered
        self._weight = kept * self._weight + 1
        self._learnt_ns = new.stamp_ns

    def _step(self, new: _Kept, old: _Kept) -> Step | None:
        """From one frame to another; where a direction was seen, only if the flight was straight meanwhile."""
        stamps_ns = old.stamp_ns, new.stamp_ns
        if new.pair.directed:
            return step_between(self._trajectory, stamps_ns, None)
        turns, known = self._turns.since(np.array([old.stamp_ns]), new.stamp_ns)
        ways_m = [
            self._flown(since_ns, new.stamp_ns) for since_ns in (old.stamp_ns, new.pair.previous.stamp_ns)
        ]
        if not (known[0] and same_way(ways_m[0][None], ways_m[1])[0]):
            return None
        return step_between(
            self._trajectory, stamps_ns, new.pair.displacement_m / new.pair.length_m, turns[0]
        )

    def _flown(self, since_ns: int, stamp_ns: int) -> Vector:
        positions_m = self._trajectory.at(np.array([since_ns, stamp_ns], dtype=np.int64)).position_m
        return np.asarray(positions_m[1] - positions_m[0])


def _seconds(pair: Pair, stamp_ns: int) -> float:
    return (stamp_ns - pair.previous.stamp_ns) * 1e-9


def changed(now_m: Map, now_share: Map, before_m: Map, before_share: Map) -> float | None:
    """log(before / now) of depths [h, w] of the same points, the median of the half whose bars are the smaller.

    The bars are shares of the depths. None where both are known of too few.
    """
    known = np.isfinite(now_m) & np.isfinite(before_m) & (now_m > 0)
    known &= (now_share < WORST_SIGMA) & (before_share < WORST_SIGMA)
    if known.sum() < FEWEST:
        return None
    log_ratio = np.log(before_m[known] / now_m[known])
    bars = np.hypot(now_share[known], before_share[known])
    return float(np.median(log_ratio[bars <= np.median(bars)]))
