"""Results of the multi-range study without a network: each trial errs by a factor that the test knows."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from flightdepth.camera import Camera
from flightdepth.evaluation.ranges_flight import MEASURED_FROM, Tally, fly
from flightdepth.evaluation.ranges_peers import flow_card
from flightdepth.evaluation.ranges_sequences import STEP_S, Sequence, Sequences
from flightdepth.evaluation.ranges_trials import CONSTANT, Trial

FRAMES = MEASURED_FROM + 2
CAMERA = Camera.from_fov(64, 64, 90)
MACHINE = "a <machine> & more"


def sequence(number: int = 0) -> Sequence:
    """A still camera before a wall that leans: 5 to 80 m, the same in each frame."""
    truth_m = np.geomspace(5, 80, 16 * 16).reshape(16, 16).astype(np.float32) * (1 + 0.1 * number)
    images = np.random.default_rng(number).integers(0, 256, (FRAMES, 64, 64, 3), dtype=np.uint8)
    stamps = np.arange(FRAMES, dtype=np.int64) * round(STEP_S * 1e9)
    return Sequence(number, CAMERA, images, np.stack([truth_m] * FRAMES), np.zeros((FRAMES, 3)), stamps)


def part(trial: Trial, number: int, factor: float) -> dict:
    """What the study writes of a trial whose depth is `factor` times the truth."""
    flown = sequence(number)
    head = {"sequence": number, "trial": trial.facts, "commit": "c0ffee", "runtime": "", "machine": MACHINE}
    if trial.method == CONSTANT:
        return head | fly(trial, None, flown)
    tally = Tally(flown, flow_card(CAMERA.fx))
    for frame in range(MEASURED_FROM, FRAMES):
        sure = np.full_like(flown.truth_m[frame], 0.85)
        depth_m, shifts = (
            flown.truth_m[frame] * np.float32(factor),
            [3 * k + 3 for k in range(trial.ranges)],
        )
        tally.add(frame, depth_m, sure, shifts)
        tally.add_ranges(frame, depth_m, depth_m[None], np.array([0.5]))
    return (
        head
        | tally.result()
        | {"predict_ms": 10.0 * max(trial.ranges, 1), "whole_ms": 11.0 * max(trial.ranges, 1)}
    )


class Flown:
    """A finished study, as `ranges_result.result` takes it; `factors` of its trials."""

    missing = ("clamped-256",)
    weights: Mapping[str, str] = {}

    def __init__(self, factors: Mapping[Trial, float], *, scenes: int = 2) -> None:
        self.scenes = scenes
        self.sequences = Sequences(FRAMES, width=64)
        self._factors = factors

    def parts(self) -> list[dict]:
        known = {trial: factor for trial, factor in self._factors.items() if trial.method not in self.missing}
        return [part(trial, k, factor) for k in range(self.scenes) for trial, factor in known.items()]
