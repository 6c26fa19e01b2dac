"""One trial over one sequence: the estimator as in flight, and what is measured of it."""

from __future__ import annotations

import base64
import time
from collections.abc import Sequence as Several
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from flightdepth.camera import Camera
from flightdepth.evaluation.flight_errors import RANGES, DepthRange, FlightErrors
from flightdepth.evaluation.ranges_measures import Coverage, Reliability, flicker
from flightdepth.evaluation.ranges_peers import FixedShift, least_relative_m
from flightdepth.evaluation.ranges_sequences import SPEED_M_S, STEP_S, Sequence, log_of
from flightdepth.evaluation.ranges_trials import CONSTANT, Trial
from flightdepth.flight.records import VelocityFrame
from flightdepth.levels import AnyImage, Image, jpeg
from flightdepth.motion import Vector
from flightdepth.outputs.encoding import centimetres_from_depth, png
from flightdepth.ranges import DepthNetwork, MultiRangeEstimator
from flightdepth.ranges.estimator import MAX_RANGES
from flightdepth.ranges.fusion import Fusion
from flightdepth.ranges.memory_limit import MemoryLimit
from flightdepth.ranges.network import AtSource
from flightdepth.ranges.view import View
from flightdepth.runtimes.arrays import Flags, Maps
from flightdepth.runtimes.grid import NetworkGrid
from flightdepth.runtimes.prediction import Prediction
from flightdepth.weights.card import NetworkCard

MEASURED_FROM = 31  # frames: before, a metre was not flown yet, and long displacements can't be had
ALL = DepthRange("all", 0.0, float("inf"))


@dataclass(frozen=True)
class AsTheyAre:
    """Maps that stay at the output's size; scaling them up is done for the time it takes."""

    depth_m: Maps
    at_source: AtSource

    def __call__(self, map_hw: Maps, /) -> Maps:
        """A copy of the map [h, w], NaN where depth is."""
        self.at_source(map_hw)
        return np.where(np.isnan(self.depth_m), np.float32(np.nan), map_hw)

    def marks(self, map_hw: Maps, /) -> Maps:
        """A copy of the map [h, w]."""
        self.at_source.marks(map_hw)
        return map_hw.copy()


class Watched:
    """A network that notes how much processor time its predictions take."""

    def __init__(self, network: DepthNetwork) -> None:
        self._network = network
        self.card = network.card
        self.predict_ms: list[float] = []

    def grid(self, camera: Camera, /) -> NetworkGrid:
        """As the network's own."""
        return self._network.grid(camera)

    def predict(
        self,
        previous_n: Several[Image],
        current: Image,
        displacements_n3: Vector,
        camera: Camera,
        valid: Flags | None = None,
        /,
    ) -> Prediction:
        """As the network's own."""
        started = time.process_time()
        found = self._network.predict(previous_n, current, displacements_n3, camera, valid)
        self.predict_ms.append((time.process_time() - started) * 1e3)
        return found


class AtNetworkSize(View):
    """Where maps stay at the size of the network's output."""

    def at_source(self, depth_m: Maps, image: AnyImage) -> AsTheyAre:
        """The maps as they are."""
        return AsTheyAre(depth_m, super().at_source(depth_m, image))


class ManyRanges(MultiRangeEstimator):
    """The estimator with more ranges than the paper's system has, and maps at the network's size.

    The study asks whether they help, and has the truth at that size.
    """

    VIEW = AtNetworkSize

    def __init__(
        self, network: DepthNetwork, camera: Camera, *, ranges: int, fusion: Fusion, derotate: bool
    ) -> None:
        allowed = min(ranges, MAX_RANGES)
        super().__init__(network, camera, ranges=allowed, fusion=fusion, derotate=derotate)
        self._ranges, self._memory = ranges, MemoryLimit(ranges + 1)


class Tally:
    """What is measured of a trial, frame by frame; from MEASURED_FROM on. `card`: the network's at its focal length."""

    def __init__(self, sequence: Sequence, card: NetworkCard | None = None) -> None:
        self._sequence = sequence
        self._errors = FlightErrors((ALL, *RANGES))
        self._coverage = None if card is None else Coverage(card)
        self._reliability = Reliability()
        self._flickers: list[float] = []
        self._shifts: list[list[int]] = []
        self._before: Maps | None = None
        self.without_depth = 0

    def add(self, frame: int, depth_m: Maps, confidence: Maps, shifts: list[int]) -> None:
        """Depth and confidence [h, w] of a frame."""
        self._reliability.add(depth_m, confidence, self._sequence.truth_m[frame])
        self._shifts.append(shifts)
        self._add(frame, depth_m)

    def add_unknown(self, frame: int) -> None:
        """A frame of which there is no depth at all."""
        self.without_depth += 1
        self._add(frame, np.full_like(self._sequence.truth_m[frame], np.nan))

    def _add(self, frame: int, depth_m: Maps) -> None:
        if self._before is not None:
            step_m = self._sequence.velocity[frame] * STEP_S
            self._flickers.append(flicker(self._before, depth_m, step_m, self._sequence.camera))
        self._errors.add("", depth_m, self._sequence.truth_m[frame])
        self._before = depth_m

    def add_ranges(self, frame: int, depth_m: Maps, range_depths_m: Maps, displacements_m: Vector) -> None:
        """What a frame's pairs [n] could see, and the errors of the best of them at each pixel, in hindsight."""
        if self._coverage is None:
            return
        truth_m = self._sequence.truth_m[frame]
        self._coverage.add(depth_m, truth_m, displacements_m)
        best = np.abs(range_depths_m - truth_m).argmin(axis=0)
        self._errors.add("best", np.take_along_axis(range_depths_m, best[None], axis=0)[0], truth_m)

    def result(self) -> dict[str, Any]:
        """All figures; NaN where there is nothing to measure."""
        errors = self._errors.result()
        best = errors.get("best", errors[""])
        found = zip(self._errors.ranges, errors[""], strict=True)
        known = [value for value in self._flickers if np.isfinite(value)]
        return {
            "errors": {depth_range.name: asdict(errors) for depth_range, errors in found},
            "best_abs_rel": {r.name: each.abs_rel for r, each in zip(self._errors.ranges, best, strict=True)},
            "coverage": None if self._coverage is None else self._coverage.sums.tolist(),
            "flicker": float(np.mean(known)) if known else float("nan"),
            "reliability": self._reliability.sums.tolist(),
            "shifts": self._shifts,
            "without_depth": self.without_depth,
            "last_depth_png": _picture(self._before),
        }


def fly(trial: Trial, network: DepthNetwork | None, sequence: Sequence) -> dict[str, Any]:
    """Measure a trial over a sequence; `network` None for the best constant depth alone."""
    if trial.method == CONSTANT or network is None:
        return _constant(sequence)
    watched = Watched(network)
    estimator = _estimator(trial, watched, sequence.camera)
    card = network.card.at_focal(watched.grid(sequence.camera).camera.fx)
    tally, whole_ms = Tally(sequence, card), []
    log = log_of(sequence, trial.telemetry.rate_hz, trial.telemetry.noise_m_s, trial.telemetry.bias)
    axes: VelocityFrame = "camera" if trial.telemetry.directed else "world"
    for frame, stamp_ns in enumerate(sequence.stamps_ns.tolist()):
        while log and log[0][0] <= stamp_ns:
            estimator.add_velocity(*log.pop(0), frame=axes)
        started = time.process_time()
        found = estimator.add_frame(stamp_ns, sequence.images[frame])
        whole_ms.append((time.process_time() - started) * 1e3)
        if frame < MEASURED_FROM:
            continue
        if found.reason is not None:
            tally.add_unknown(frame)
        else:
            tally.add(frame, found.depth_m, found.confidence, found.shifts.tolist())
            tally.add_ranges(frame, found.depth_m, found.range_depths_m, found.displacements_m)
    return tally.result() | {
        "predict_ms": _median(watched.predict_ms[-len(whole_ms) + MEASURED_FROM :]),
        "whole_ms": _median(whole_ms[MEASURED_FROM:]),
    }


def _estimator(trial: Trial, network: DepthNetwork, camera: Camera) -> ManyRanges | FixedShift:
    if trial.ranges:
        return ManyRanges(network, camera, ranges=trial.ranges, fusion=trial.fusion, derotate=trial.derotate)
    card = network.card.at_focal(camera.fx)
    return FixedShift(network, camera, round(card.D0_m / (SPEED_M_S * STEP_S)))


def _constant(sequence: Sequence) -> dict[str, Any]:
    """One depth for all frames, chosen with the truth in sight."""
    constant_m = least_relative_m(sequence.truth_m[MEASURED_FROM:])
    depth_m = np.full(sequence.truth_m.shape[1:], constant_m, np.float32)
    tally = Tally(sequence)
    for frame in range(MEASURED_FROM, len(sequence.images)):
        tally.add(frame, depth_m, np.zeros_like(depth_m), [])
    view = {"image_jpeg": _jpeg(sequence.images[-1]), "truth_png": _picture(sequence.truth_m[-1])}
    times = {"predict_ms": 0.0, "whole_ms": 0.0}
    return tally.result() | times | {"constant_m": constant_m, "view": view}


def _median(values: list[float]) -> float:
    return float(np.median(values)) if values else float("nan")


def _jpeg(image: Image) -> str:
    """An RGB picture as the text of a JPEG, for the report."""
    return base64.b64encode(jpeg(image, 90)).decode()


def _picture(depth_m: Maps | None) -> str | None:
    """A depth map as the text of a PNG of centimetres, for the report."""
    if depth_m is None:
        return None
    return base64.b64encode(png(centimetres_from_depth(depth_m))).decode()
