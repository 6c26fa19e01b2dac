"""What the paper claims of several ranges, held against the study."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from flightdepth.evaluation.bootstrap import interval
from flightdepth.evaluation.ranges_trials import (
    CLAMPED,
    CONSTANT,
    DEPTHNET,
    FLOW,
    MOTION,
    NOISE_RAD,
    NOISES_RAD,
    TINY,
    Trial,
)

Parts = Mapping[Trial, Sequence[Mapping[str, Any]]]

HOLDS, FAILS, OPEN = "holds", "does not hold", "not decided"
# With fewer scenes than this even all of them on one side are chance at 95 % (sign test), and a bootstrap says nothing.
LEAST_SCENES = 6


@dataclass(frozen=True)
class Comparison:
    """Says that `better` has less error than `worse` over the true depths named `span`."""

    said: str
    better: Trial
    worse: Trial
    span: str = "all"


SEVERAL = "several ranges beat one (paper, IV.B)"
SMALL = "Tiny Clamped with noise beats DepthNet with one range (paper, IV.C)"
CLAMPING = "clamping helps far objects under noise (paper, IV.C)"
ADAPTING = "a shift chosen for the depth beats a fixed one (paper, IV.A)"
BEYOND = "beyond the paper"

COMPARISONS = (
    *(
        Comparison(SEVERAL, Trial(method, n), Trial(method, 1))
        for method in (DEPTHNET, CLAMPED, TINY, MOTION)
        for n in range(2, 7)
    ),
    *(Comparison(SMALL, Trial(TINY, n), Trial(DEPTHNET, 1)) for n in (1, 2, 3, 4)),
    *(Comparison(SMALL, Trial(TINY, 1), Trial(DEPTHNET, 1), span) for span in ("near", "middle")),
    *(
        Comparison(SMALL, Trial(TINY, 1, noise_rad=noise), Trial(DEPTHNET, 1, noise_rad=noise))
        for noise in NOISES_RAD
        if noise != NOISE_RAD
    ),
    *(
        Comparison(CLAMPING, Trial(clamped, 1, noise_rad=noise), Trial(DEPTHNET, 1, noise_rad=noise), "far")
        for clamped in (CLAMPED, TINY)
        for noise in NOISES_RAD
    ),
    *(
        Comparison(ADAPTING, Trial(method, n), Trial(method, 0))
        for method in (DEPTHNET, TINY, MOTION, FLOW)
        for n in (1, 2)
    ),
    Comparison(BEYOND, Trial(MOTION, 2), Trial(DEPTHNET, 2)),
    Comparison(BEYOND, Trial(MOTION, 2), Trial(FLOW, 2)),
    Comparison(BEYOND, Trial(DEPTHNET, 2), Trial(FLOW, 2)),
    Comparison(BEYOND, Trial(DEPTHNET, 2), Trial(CONSTANT, 0)),
    Comparison(BEYOND, Trial(MOTION, 2), Trial(CONSTANT, 0)),
)


def claims(parts: Parts) -> list[dict[str, Any]]:
    """A row for each comparison whose two trials were flown: ratio of errors, difference over scenes, verdict."""
    known = [each for each in COMPARISONS if each.better in parts and each.worse in parts]
    return [judged(each, parts) for each in known]


def judged(comparison: Comparison, parts: Parts) -> dict[str, Any]:
    """One comparison on the same sequences. `difference`: of relative errors, better less worse, paired."""
    better, worse = (
        [_error(part, comparison.span) for part in parts[trial]]
        for trial in (comparison.better, comparison.worse)
    )
    both = [(b, w) for b, w in zip(better, worse, strict=True) if math.isfinite(b - w)]
    difference = interval([b - w for b, w in both])
    total = sum(w for _, w in both)
    return {
        "claim": comparison.said,
        "better": comparison.better.label,
        "worse": comparison.worse.label,
        "noise_rad": comparison.better.noise_rad,
        "span": comparison.span,
        "ratio": sum(b for b, _ in both) / total if total else math.nan,
        "difference": {key: difference[key] for key in ("mean", "low", "high")},
        "scenes": len(both),
        "scenes_better": sum(b < w for b, w in both),
        "verdict": verdict(difference["low"], difference["high"], len(both)),
    }


def verdict(low: float, high: float, scenes: int) -> str:
    """From the interval, over some scenes, of a difference that should be below 0."""
    if scenes < LEAST_SCENES:
        return OPEN
    if high < 0:
        return HOLDS
    return FAILS if low > 0 else OPEN


def _error(part: Mapping[str, Any], span: str) -> float:
    value = part["errors"][span]["abs_rel"]
    return math.nan if value is None else float(value)
