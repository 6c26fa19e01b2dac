"""Depth on a flight without ground truth, from pairs of fixed baselines: three laws that true depth obeys.

Photometric: the earlier picture, warped by depth and displacement, looks like the current one (see warping.py).
Agreement: one frame has one depth, whichever baseline it is measured over. Slope: a point's depth falls with the
metres flown (see tracked_points.py). Each alone can be had without being right: a constant depth agrees with
itself, and what is blurred or has no texture matches anything.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.evaluation.baseline_pairs import BaselinePair, Moment
from flightdepth.evaluation.metrics import pooled
from flightdepth.evaluation.peer import BLIND_PX, ClassicalPeer
from flightdepth.evaluation.tracked_points import BOOTSTRAPS, TrackedPoints
from flightdepth.evaluation.warping import Match, WarpedPair
from flightdepth.ranges.fusion import BETA_MAX, LOWER_MARGIN
from flightdepth.runtimes.network import Network
from flightdepth.sweep import FIELD_SCALE, motion_field
from flightdepth.weights.card import NetworkCard

Image = NDArray[np.uint8]
Map = NDArray[np.float32]
Flags = NDArray[np.bool_]
Vector = NDArray[np.float64]

LEAST_SPAN_M = 3.0  # metres flown over which a tracked point must be seen
CONSTANT, INFINITY = "best constant depth", "plane at infinity"


@dataclass(frozen=True, eq=False)
class Answer:
    """Depth of a frame in metres, float32 [h, w], and where it is a measurement, not an end of the range."""

    depth_m: Map
    measured: Flags


class Method(Protocol):
    """What gives depth from a pair on the network's grid."""

    @property
    def name(self) -> str:
        """Unique among the methods of a study."""

    def answer(self, previous: Image, current: Image, displacement: Vector, camera: Camera) -> Answer:
        """Depth of `current`, at a quarter of the pictures' size; displacement (3,), metres."""


@dataclass(frozen=True)
class NetworkMethod:
    """A network, one pair at a time."""

    network: Network

    @property
    def name(self) -> str:
        """As on its card."""
        return self.network.card.name

    def answer(self, previous: Image, current: Image, displacement: Vector, camera: Camera) -> Answer:
        """See `Method`. An output counts as an end of the range as it does in the fusion of ranges."""
        found = self.network.predict([previous], current, displacement[None], camera)
        beta = found.beta[0]
        return Answer(
            found.depth_m[0], (beta > self.network.card.beta_min + LOWER_MARGIN) & (beta < BETA_MAX)
        )


@dataclass(frozen=True)
class PeerMethod:
    """Optical flow and triangulation, clipped to the widest range of the networks that it stands beside."""

    cards: tuple[NetworkCard, ...]
    name: str = "classical peer"

    def answer(self, previous: Image, current: Image, displacement: Vector, camera: Camera) -> Answer:
        """See `Method`. Means of inverse depth over 4x4 pixels; what could not have moved is not measured."""
        length_m = float(np.linalg.norm(displacement))
        cards = [card.at_focal(camera.fx) for card in self.cards]
        least_m = length_m * min(card.alpha * card.beta_min for card in cards)
        most_m = length_m * max(card.alpha for card in cards)
        depth_m = ClassicalPeer(least_m, most_m).depth(previous, current, displacement, camera)
        shape = (camera.height // FIELD_SCALE, camera.width // FIELD_SCALE)
        depth_m = 1 / pooled(1 / np.maximum(depth_m, np.float32(1e-3)), shape)
        reach = np.hypot(*motion_field(displacement, camera)) * camera.fx
        inside = (depth_m > least_m) & (depth_m < BETA_MAX * most_m)
        return Answer(depth_m, inside & (reach >= BLIND_PX * most_m / 10))


@dataclass(frozen=True, eq=False)
class Sight:
    """One pair as seen by all methods, for a picture: answers and error maps [H, W] by method."""

    index: int
    current: Image
    pair: BaselinePair
    unmoved: Map
    answers: dict[str, Answer]
    errors: dict[str, Map]


class BaselineStudy:
    """Asks every method about every pair and sums up; `valid` [h, w] marks the map's pixels inside the picture."""

    def __init__(
        self,
        methods: Sequence[Method],
        camera: Camera,
        valid: Flags,
        known: Flags,
        baselines_m: Sequence[float],
    ) -> None:
        self._methods, self._camera = tuple(methods), camera
        self._valid, self._known, self._baselines_m = valid, known, tuple(baselines_m)
        self._matches: dict[tuple[str, float], list[Match]] = defaultdict(list)
        self._agreements: dict[tuple[str, float, float], list[tuple[float, float]]] = defaultdict(list)
        self._points = {(m.name, b): TrackedPoints() for m in self._methods for b in self._baselines_m}
        self._forward: dict[float, list[float]] = defaultdict(list)
        self._from_log: list[bool] = []

    def add(self, moment: Moment) -> tuple[Sight, ...]:
        """Take the next frame; what was seen of each of its pairs."""
        sights = {pair.wanted_m: self._sight(moment, pair) for pair in moment.pairs}
        for method in self._methods:
            answers = {b: sight.answers[method.name] for b, sight in sights.items()}
            for a, b in combinations(sorted(answers), 2):
                self._agreements[method.name, a, b].append(agreement(answers[a], answers[b], self._valid))
            self._track(method.name, moment, answers)
        return tuple(sights.values())

    def result(self) -> dict[str, Any]:
        """All figures; NaN where there is nothing to measure. See `flightdepth evaluate baselines`."""
        return {
            "frames_per_baseline": {f"{b:g}": len(self._forward[b]) for b in self._baselines_m},
            "pairs_with_direction_from_log": sum(self._from_log),
            "pairs_with_direction_from_pictures": len(self._from_log) - sum(self._from_log),
            "photometric": [self._photometric(*key) for key in self._matches],
            "agreement": [self._agreement(*key) for key in self._agreements],
            "slope": [self._slope(*key) for key in self._points],
        }

    def _sight(self, moment: Moment, pair: BaselinePair) -> Sight:
        warp = WarpedPair(
            pair.previous,
            moment.current,
            pair.displacement,
            self._camera,
            known_previous=pair.known,
            known_current=self._known,
        )
        self._forward[pair.wanted_m].append(float(pair.displacement[2] / np.linalg.norm(pair.displacement)))
        self._from_log.append(pair.from_log)
        answers = {
            m.name: m.answer(pair.previous, moment.current, pair.displacement, self._camera)
            for m in self._methods
        }
        for name, answer in answers.items():
            self._matches[name, pair.wanted_m].append(warp.match(answer.depth_m))
        self._matches[CONSTANT, pair.wanted_m].append(warp.best_constant())
        errors = {name: warp.error_map(answer.depth_m) for name, answer in answers.items()}
        return Sight(moment.index, moment.current, pair, warp.unmoved_map(), answers, errors)

    def _track(self, name: str, moment: Moment, answers: dict[float, Answer]) -> None:
        """Frames without an answer are given too: points are followed from each frame to the next."""
        if moment.flown_m is None:
            return
        for baseline_m in self._baselines_m:
            depth_m = np.full(self._known.shape, np.nan, np.float32)
            if baseline_m in answers:
                answer = answers[baseline_m]
                known_m = np.where(answer.measured & self._valid_for(answer), answer.depth_m, np.nan)
                size = self._known.shape[::-1]
                depth_m = np.asarray(cv2.resize(known_m.astype(np.float32), size), dtype=np.float32)
            self._points[name, baseline_m].add(moment.current, depth_m, moment.flown_m)

    def _valid_for(self, answer: Answer) -> Flags:
        return self._valid if answer.depth_m.shape == self._valid.shape else self._known

    def _photometric(self, name: str, baseline_m: float) -> dict[str, Any]:
        matches = self._matches[name, baseline_m]
        share = interval([match.error for match in matches])
        inside = float(np.mean([match.inside for match in matches]))
        return {"method": name, "baseline_m": baseline_m, "error_share": share, "pixels_inside": inside}

    def _agreement(self, name: str, shorter_m: float, longer_m: float) -> dict[str, Any]:
        logs, shares = zip(*self._agreements[name, shorter_m, longer_m], strict=True)
        return {
            "method": name,
            "baselines_m": [shorter_m, longer_m],
            "median_log_ratio": interval(logs),
            "measured_by_both": interval(shares),
        }

    def _slope(self, name: str, baseline_m: float) -> dict[str, Any]:
        slopes = self._points[name, baseline_m].slopes(least_span_m=LEAST_SPAN_M)
        forward = self._forward[baseline_m]
        return {
            "method": name,
            "baseline_m": baseline_m,
            "ideal": -float(np.mean(forward)) if forward else float("nan"),
            "median": slopes.median,
            "low": slopes.low,
            "high": slopes.high,
            "points": len(slopes.slopes),
        }


def agreement(one: Answer, other: Answer, valid: Flags) -> tuple[float, float]:
    """Median |log(depth / depth)| over the pixels [h, w] that both measure, NaN with none; and their share."""
    if one.depth_m.shape != valid.shape:
        valid = np.ones(one.depth_m.shape, np.bool_)
    both = one.measured & other.measured & valid
    if not both.any():
        return float("nan"), 0.0
    ratio = np.abs(np.log(one.depth_m[both] / other.depth_m[both]))
    return float(np.median(ratio)), np.count_nonzero(both) / np.count_nonzero(valid)


def interval(values: Sequence[float]) -> dict[str, float | int]:
    """Mean of the finite values, one a frame, with its 95 % bootstrap interval over frames (seeded).

    Frames that follow each other look alike, so the interval is somewhat too narrow.
    """
    known = np.array([value for value in values if np.isfinite(value)])
    if not known.size:
        return {"mean": float("nan"), "low": float("nan"), "high": float("nan"), "frames": 0}
    drawn = np.random.default_rng(0).choice(known, (BOOTSTRAPS, known.size)).mean(axis=1)
    low, high = np.percentile(drawn, [2.5, 97.5])
    return {"mean": float(known.mean()), "low": float(low), "high": float(high), "frames": int(known.size)}
