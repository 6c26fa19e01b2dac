"""n depth maps of the same frame, seen through n displacements, to one (paper, section IV.B)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from flightdepth.ranges.network import Map
from flightdepth.runtimes.arrays import Flags
from flightdepth.weights.card import NetworkCard

BETA_MIN = 0.1
BETA_MEAN = 0.4
BETA_MAX = 0.9
EPSILON = 1e-3
# How near to the lower end of its range an output counts as lying at it: an L1-trained network
# approaches its clip values without reaching them. At the upper end BETA_MAX serves.
LOWER_MARGIN = 0.02
SWEPT_BETA_MEAN = 0.13  # its relative error is least where points move by 3 pixels and more (docs/log.md)
SWEPT_MARGIN = 0.01  # nearer than this the point moved by more than the widest hypothesis of full size
# A network that sweeps compares parts of a pixel: from this share of its largest depth on a point moved by less than
# two thirds of one, which a rotation of a tenth of a degree that no one reported does too.
SWEPT_BETA_MAX = 0.6
# Two ranges contradict each other when no depth is within this factor of what both say.
TOLERANCE = 1.5
# An output of a clamped network this little above its lower end still lies at it where a shorter pair saw the point so
# near: things too near for the longer pair come out up to 0.05 above the end (docs/log.md).
TOO_NEAR = 0.1
# A range whose own error bar is this share of its depth or more knows nothing: it is as likely wrong by a quarter
# as right. Sky that a network is not sure of would else ask for ever longer displacements.
WORST_SIGMA = 0.4
LEAST_SIGMA = 0.01  # no depth is better known than that, whatever a network says
# Confidence, where error bars are known: how likely depth is right to within this share.
RIGHT_WITHIN = 0.25
# Two in three errors of scale b are within 1.148 b (Laplace), as two in three are within sigma.
LAPLACE_68 = 1.148
# Depth beyond this is told as a bound: it hangs on hundredths of a pixel, and the files hold no larger one.
FARTHEST_TOLD_M = 655.34

# paper: each output is a measurement; saturation: one at an end of the range is a bound, and ranges that contradict
# each other know nothing.
Fusion = Literal["saturation", "paper"]


@dataclass(frozen=True)
class Fused:
    """Maps [h, w] at the network's output size, metres, NaN = unknown.

    depth_m         weighted mean of the ranges that measured the pixel
    confidence      0..1: the largest weight among the ranges, as a share of the largest possible. 1: one
                    range saw the pixel at beta_mean, where the network is best; near 0: all saw it near an
                    end of their range; exactly 0: no range measured it, and depth is NaN. With error bars: the
                    chance that depth is right within RIGHT_WITHIN, by sigma_m.
    farther_than_m  where depth is NaN: largest "at least" of the ranges that say so
    nearer_than_m   where depth is NaN: smallest "at most" of the ranges that say so
    sigma_m         weighted mean of the ranges' deviations, each at least LEAST_SIGMA of its depth but in the
                    paper's fusion; None where the network does not tell. The ranges share the current frame, so
                    their errors are taken as fully correlated.
    """

    depth_m: Map
    confidence: Map
    farther_than_m: Map
    nearer_than_m: Map
    sigma_m: Map | None


@dataclass(frozen=True)
class Said:
    """What each range says of each pixel, bool [n, h, w]; where all three are False it says nothing."""

    at_most: Flags
    measured: Flags
    at_least: Flags

    @classmethod
    def of(cls, beta: Map, usable: Flags, lower: float, upper: float) -> Said:
        """From the outputs [n, h, w], of which `usable` ones count."""
        at_most, at_least = usable & (beta <= lower), usable & (beta >= upper)
        return cls(at_most, usable & ~at_most & ~at_least, at_least)

    def where(self, kept: Flags) -> Said:
        """The same, and nothing where `kept` [n, h, w] or [h, w] is False."""
        return Said(self.at_most & kept, self.measured & kept, self.at_least & kept)


def weight(beta: Map) -> Map:
    """f of the paper: 0 up to beta_min, rises to 1 at beta_mean, falls to 0 at beta_max. Any shape."""
    rising = (beta - np.float32(BETA_MIN)) / np.float32(BETA_MEAN - BETA_MIN)
    falling = (np.float32(BETA_MAX) - beta) / np.float32(BETA_MAX - BETA_MEAN)
    return np.asarray(np.clip(np.minimum(rising, falling), 0, 1), dtype=np.float32)


def fuse(
    beta: Map,
    displacements_m: NDArray[np.float64],
    card: NetworkCard,
    *,
    fusion: Fusion = "saturation",
    sigma_m: Map | None = None,
    seen: Flags | None = None,
) -> Fused:
    """Fuse beta [n, h, w], 0..1, of pairs `displacements_m` [n] apart (D*, really flown, metres).

    zeta_i = alpha D*_i beta_i; w_i = epsilon + f(beta_i); depth = sum_i w_i zeta_i / sum_i w_i (paper,
    equations 5 and 6). With saturation an output at an end of the network's range has weight 0 and
    becomes a bound, and where the ranges contradict each other nothing is known; where the network tells
    `sigma_m`, w_i = 1 / sigma_i^2, and a range with too large a sigma knows nothing. `seen` [n, h, w] marks
    what both frames of the pair show; elsewhere the weight is 0.
    """
    usable = np.isfinite(beta) if seen is None else np.isfinite(beta) & seen
    reach_m = (card.alpha * displacements_m).astype(np.float32)[:, None, None]
    depths_m = reach_m * beta
    lower, upper = ends(card) if fusion == "saturation" else (-np.inf, np.inf)
    said = Said.of(beta, usable, lower, upper)
    told = sigma_m if fusion == "saturation" else None
    if told is None:
        trust = np.float32(EPSILON) + weight(beta)
    else:
        told = np.maximum(told, np.float32(LEAST_SIGMA) * depths_m)
        said = said.where(~said.measured | (told < np.float32(WORST_SIGMA) * depths_m))
        trust = 1 / np.square(np.maximum(told, np.float32(1e-6)))
    if fusion == "saturation":
        if card.beta_min > 0:
            said = said.where(_in_reach(said, depths_m, np.float32(card.beta_min + TOO_NEAR) * reach_m))
        said = said.where(_agree(said, depths_m, np.float32(lower) * reach_m, np.float32(upper) * reach_m))
    w = np.where(said.measured, trust, np.float32(0))
    total = w.sum(axis=0)
    unknown = total == 0
    share = np.asarray(w / np.where(unknown, np.float32(1), total), dtype=np.float32)
    depth = _mean(share, np.where(said.measured, depths_m, np.float32(0)), unknown)
    sigma = None
    if sigma_m is not None:
        sigma_m = sigma_m if told is None else told
        sigma = _mean(share, np.where(said.measured, sigma_m, np.float32(0)), unknown)
    best = np.asarray(w.max(axis=0) / np.float32(1 + EPSILON), dtype=np.float32)
    confidence = best if sigma is None else chance(depth, sigma)
    farther, nearer = _bounds(said, reach_m, unknown, (lower, upper))
    return Fused(depth, confidence, farther, nearer, sigma)


def within_reach(fused: Fused) -> Fused:
    """Depth beyond FARTHEST_TOLD_M as a bound, "farther than" that: most of it is sky that seemed to move."""
    far = fused.depth_m > FARTHEST_TOLD_M  # NaN is not
    nothing = np.float32(np.nan)
    return Fused(
        depth_m=np.where(far, nothing, fused.depth_m),
        confidence=np.where(far, np.float32(0), fused.confidence),
        farther_than_m=np.where(far, np.float32(FARTHEST_TOLD_M), fused.farther_than_m),
        nearer_than_m=fused.nearer_than_m,
        sigma_m=None if fused.sigma_m is None else np.where(far, nothing, fused.sigma_m),
    )


def chance(depth_m: Map, sigma_m: Map) -> Map:
    """How likely the error is below RIGHT_WITHIN of the depth, if errors are Laplace's; 0 where depth is NaN."""
    right = 1 - np.exp(
        np.float32(-LAPLACE_68 * RIGHT_WITHIN) * depth_m / np.maximum(sigma_m, np.float32(1e-6))
    )
    return np.asarray(np.nan_to_num(right, nan=0.0), dtype=np.float32)


def best_beta(card: NetworkCard) -> float:
    """The output that a displacement is chosen for (paper, section IV.B: beta_mean)."""
    if card.best_beta is not None:
        return card.best_beta
    return SWEPT_BETA_MEAN if card.knows_direction else BETA_MEAN


def ends(card: NetworkCard) -> tuple[float, float]:
    """At or beyond these, beta is a bound."""
    if card.knows_direction:
        return card.beta_min + SWEPT_MARGIN, SWEPT_BETA_MAX
    return card.beta_min + LOWER_MARGIN, BETA_MAX


def _in_reach(said: Said, depths_m: Map, nearest_m: Map) -> Flags:
    """Whether a range can see the pixel, bool [n, h, w]: not where it and a shorter one say nearer than `nearest_m`.

    depths_m [n, h, w] and nearest_m [n, 1, 1] of each range, metres.
    """
    # [range asked, range that says so, h, w]
    near = said.measured[None] & (depths_m[None] < nearest_m[:, None])
    n = np.arange(len(depths_m))
    shorter = nearest_m.ravel()[:, None] > nearest_m.ravel()[None, :]
    told = (near & shorter[:, :, None, None]).any(axis=1)
    return np.asarray(~(told & near[n, n]))


def _agree(said: Said, depths_m: Map, lower_m: Map, upper_m: Map) -> Flags:
    """Whether some depth is within `TOLERANCE` of what every range says, bool [h, w].

    Where nothing can be matched (sky, bare walls) a network answers with what is usual, whatever the
    displacement: zeta then grows with D instead of staying the same, and would ask for ever longer ones.
    """
    least_m = np.where(said.measured, depths_m, np.where(said.at_least, upper_m, np.float32(0)))
    most_m = np.where(said.measured, depths_m, np.where(said.at_most, lower_m, np.float32(np.inf)))
    at_least_m = least_m.max(axis=0) / np.float32(TOLERANCE)
    at_most_m = most_m.min(axis=0) * np.float32(TOLERANCE)
    return np.asarray(at_least_m <= at_most_m)


def _mean(share: Map, value: NDArray[Any], unknown: Flags) -> Map:
    mean = np.asarray(np.einsum("nhw,nhw->hw", share, value), dtype=np.float32)
    mean[unknown] = np.nan
    return mean


def _bounds(said: Said, reach_m: Map, unknown: Flags, ends: tuple[float, float]) -> tuple[Map, Map]:
    """Largest "at least" and smallest "at most" where depth is unknown; neither where they contradict."""
    if not unknown.any():
        nothing = np.full(unknown.shape, np.nan, dtype=np.float32)
        return nothing, nothing
    farther = np.where(said.at_least, reach_m * np.float32(ends[1]), np.float32(-np.inf)).max(axis=0)
    nearer = np.where(said.at_most, reach_m * np.float32(ends[0]), np.float32(np.inf)).min(axis=0)
    told = unknown & (farther <= nearer)
    farther = np.where(told & np.isfinite(farther), farther, np.nan).astype(np.float32)
    nearer = np.where(told & np.isfinite(nearer), nearer, np.nan).astype(np.float32)
    return farther, nearer
