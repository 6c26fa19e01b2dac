"""The study's parts summed up: one JSON with every figure, its interval over scenes, and where it came from."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from flightdepth.evaluation.bootstrap import interval
from flightdepth.evaluation.ranges_claims import claims
from flightdepth.evaluation.ranges_flight import MEASURED_FROM
from flightdepth.evaluation.ranges_measures import coverage, reliability
from flightdepth.evaluation.ranges_study import Study
from flightdepth.evaluation.ranges_trials import CONSTANT, Trial, trial_of
from flightdepth.files import without_nan

Part = Mapping[str, Any]
Parts = Mapping[Trial, Sequence[Part]]

EXAMPLES = 3  # sequences whose last frame is shown


def result(study: Study) -> dict[str, Any]:
    """Every figure of a finished study; None stands for what is not defined."""
    parts = by_trial(study.parts())
    flown = [part for several in parts.values() for part in several]
    about = {
        "sequences": study.sequences.facts,
        "scenes": study.scenes,
        "measured_from_frame": MEASURED_FROM,
        "weights_sha256": study.weights,
        "missing_networks": list(study.missing),
        "runtimes": {
            method: each_of("runtime", [part for part in flown if part["trial"]["method"] == method])
            for method in dict.fromkeys(part["trial"]["method"] for part in flown if part.get("runtime"))
        },
        "commit": each_of("commit", flown),
        "machine": each_of("machine", flown),
    }
    rows = [row(trial, several) for trial, several in parts.items()]
    found = {"about": about, "claims": claims(parts), "trials": rows, "examples": examples(parts)}
    return {key: without_nan(value) for key, value in found.items()}


def each_of(fact: str, parts: Sequence[Part]) -> str:
    """All that some parts say of a fact: a study may go on elsewhere."""
    return ", ".join(sorted({part.get(fact) or "unknown" for part in parts}))


def by_trial(parts: Sequence[Part]) -> dict[Trial, list[Part]]:
    """The parts of each trial, a sequence each."""
    found: dict[Trial, list[Part]] = {}
    for part in parts:
        found.setdefault(trial_of(part["trial"]), []).append(part)
    return found


def row(trial: Trial, parts: Sequence[Part]) -> dict[str, Any]:
    """One trial: means over its sequences with 95 % bootstrap intervals, shifts, times, confidence."""
    shifts = [frame for part in parts for frame in part["shifts"]]
    sums = np.sum([part["reliability"] for part in parts], axis=0)
    spans = parts[0]["errors"]
    sums_of_places = [np.array(part["coverage"]) for part in parts if part["coverage"] is not None]
    return {
        "trial": trial.facts,
        "label": trial.label,
        "errors": {name: errors_of(name, parts) for name in spans},
        "best_abs_rel": {name: over_scenes([part["best_abs_rel"][name] for part in parts]) for name in spans},
        "coverage": coverage(sums_of_places) if sums_of_places else None,
        "flicker": over_scenes([part["flicker"] for part in parts]),
        "predict_ms": least([part["predict_ms"] for part in parts]),
        "whole_ms": least([part["whole_ms"] for part in parts]),
        "machine": each_of("machine", parts),
        "frames_without_depth": sum(part["without_depth"] for part in parts),
        "shifts": shift_figures(shifts, trial.ranges),
        "confidence": reliability(sums),
        "constant_m": [part["constant_m"] for part in parts] if trial.method == CONSTANT else None,
    }


def errors_of(name: str, parts: Sequence[Part]) -> dict[str, Any]:
    """Relative error, share within 1.25 and share known of one span of true depth."""
    rows = [part["errors"][name] for part in parts]
    return {key: over_scenes([each[key] for each in rows]) for key in ("abs_rel", "l1_m", "delta", "known")}


def over_scenes(values: Sequence[float | None]) -> dict[str, Any]:
    """Mean and 95 % bootstrap interval over sequences, one value each; those without a value are left out."""
    found = interval([math.nan if value is None else value for value in values])
    return {"mean": found["mean"], "low": found["low"], "high": found["high"], "scenes": found["frames"]}


def shift_figures(shifts: Sequence[Sequence[int]], ranges: int) -> dict[str, Any]:
    """Per range, nearest first, the quartiles of its shift in frames; how often ranges chose the same frame.

    `shifts` tells of each frame its pairs, one for each range, but a scout is one too and is not told apart. Quartiles
    are of the frames with as many pairs as `ranges`; those with fewer, of all frames, are the share `coincide`. So a
    scout keeps its frame out of the quartiles, or stands there for a range that chose another's frame.
    """
    full = np.array([frame for frame in shifts if len(frame) == ranges], dtype=np.float64)
    quartiles = np.percentile(full, [25, 50, 75], axis=0).T.tolist() if full.size else []
    share = len(shifts) or math.nan
    return {
        "quartiles": quartiles,
        "coincide": sum(len(frame) < ranges for frame in shifts) / share,
    }


def least(values: Sequence[float | None]) -> float:
    """The least of the sequences' median times: what else the machine did disturbed it least; NaN of nothing."""
    return min((value for value in values if value is not None), default=math.nan)


def examples(parts: Parts) -> list[dict[str, Any]]:
    """The last frame of a few sequences: picture, truth and each method's depth, as text of image files."""
    constant = next((several for trial, several in parts.items() if trial.method == CONSTANT), [])
    found = []
    for k, part in enumerate(constant[:EXAMPLES]):
        depths = [
            {"trial": trial.facts, "label": trial.label, "depth_png": several[k]["last_depth_png"]}
            for trial, several in parts.items()
            if shown(trial)
        ]
        found.append({"sequence": part["sequence"], **part["view"], "depths": depths})
    return found


def shown(trial: Trial) -> bool:
    """Whether the report shows a trial's depth: the methods side by side, under the paper's noise."""
    plain = Trial(trial.method, trial.ranges, trial.fusion)
    return trial == plain and trial.ranges == 2
