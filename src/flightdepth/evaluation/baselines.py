"""Depth on a flight without ground truth, from pairs of fixed baselines: three laws that true depth obeys.

Photometric: the earlier picture, warped by depth and displacement, looks like the current one (see warping.py).
Agreement: one frame has one depth, whichever baseline it is measured over. Slope: a point's depth falls with the
metres flown (see tracked_points.py). Each alone can be had without being right: a constant depth agrees with
itself, what is blurred or has no texture matches anything, and a track ends where its depth leaves a method's
range, which draws the slope of points near that end towards 0. Near the focus of expansion hardly anything moves:
there a method that dares to answer is measured on what it guesses, hence a second slope, of the points alone that
moved by MOVED_PX or more.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import Any

import cv2
import numpy as np

from flightdepth.camera import Camera
from flightdepth.evaluation.baseline_methods import PEER, Answer, Method
from flightdepth.evaluation.baseline_pairs import BaselinePair, Moment, Witness
from flightdepth.evaluation.bootstrap import interval
from flightdepth.evaluation.tracked_points import TrackedPoints
from flightdepth.evaluation.warping import Match, WarpedPair
from flightdepth.levels import Image
from flightdepth.runtimes.arrays import Flags, Maps
from flightdepth.sweep import motion_field

LEAST_SPAN_M = 3.0  # metres flown over which a tracked point must be seen
MOVED_PX = 1.0  # between the two pictures, by the method's own depth
CONSTANT = "best constant"


@dataclass(frozen=True, eq=False)
class Sight:
    """One pair as seen by all methods, for a picture: answers and error maps [H, W] by method."""

    index: int
    current: Image
    pair: BaselinePair
    unmoved: Maps
    answers: dict[str, Answer]
    errors: dict[str, Maps]


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
        self._valid, self._known, self.baselines_m = valid, known, tuple(baselines_m)
        self._matches: dict[tuple[str, float], list[Match]] = defaultdict(list)
        self._measured: dict[tuple[str, float], list[float]] = defaultdict(list)
        self._agreements: dict[tuple[str, float, float], list[tuple[float, ...]]] = defaultdict(list)
        keys = product((m.name for m in self._methods), self.baselines_m, (False, True))
        self._points = {key: TrackedPoints() for key in keys}
        self._forward: dict[float, list[float]] = defaultdict(list)
        self._witnesses: Counter[Witness] = Counter()

    def add(self, moment: Moment) -> tuple[Sight, ...]:
        """Take the next frame; what was seen of each of its pairs."""
        sights = {pair.wanted_m: self._sight(moment, pair) for pair in moment.pairs}
        for method in self._methods:
            self._track(method.name, moment, sights)
        for shorter, longer in combinations(sights.values(), 2):
            self._compare(shorter, longer)
        return tuple(sights.values())

    def result(self) -> dict[str, Any]:
        """All figures; NaN where there is nothing to measure. See `flightdepth evaluate baselines`."""
        return {
            "frames_per_baseline": {f"{b:g}": len(self._forward[b]) for b in self.baselines_m},
            "directions_told_by": {witness.value: self._witnesses[witness] for witness in Witness},
            "photometric": [self._photometric(*key) for key in sorted(self._matches, key=self._order)],
            "agreement": [self._agreement(*key) for key in sorted(self._agreements, key=self._order)],
            "slope": [self._slope(*key) for key in self._points if not key[-1]],
            "slope_of_moved": [self._slope(*key) for key in self._points if key[-1]],
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
        self._witnesses[pair.witness] += 1
        answers = {
            m.name: m.answer(pair.previous, moment.current, pair.displacement, self._camera)
            for m in self._methods
        }
        errors = {name: warp.error_map(answer.depth_m) for name, answer in answers.items()}
        for name, answer in answers.items():
            self._matches[name, pair.wanted_m].append(warp.match(errors[name]))
            self._measured[name, pair.wanted_m].append(float(answer.measured[self._valid].mean()))
        self._matches[CONSTANT, pair.wanted_m].append(warp.best_constant())
        return Sight(moment.index, moment.current, pair, warp.unmoved_map(), answers, errors)

    def _compare(self, shorter: Sight, longer: Sight) -> None:
        """Agreement on all pixels, and on those that the peer measures twice: networks dare more, sky and all."""
        own = (sight.answers.get(PEER) for sight in (shorter, longer))
        masks = [answer.measured for answer in own if answer is not None]
        for name, answer in shorter.answers.items():
            two = answer, longer.answers[name]
            found = *agreement(*two, self._valid), *agreement(*two, np.all([self._valid, *masks], axis=0))
            self._agreements[name, shorter.pair.wanted_m, longer.pair.wanted_m].append(found)

    def _track(self, name: str, moment: Moment, sights: dict[float, Sight]) -> None:
        """Frames without an answer are given too: points are followed from each frame to the next."""
        if moment.flown_m is None:
            return
        for baseline_m, moved in product(self.baselines_m, (False, True)):
            depth_m = np.full(self._known.shape, np.nan, np.float32)
            if baseline_m in sights:
                sight = sights[baseline_m]
                answer = sight.answers[name]
                wanted = answer.measured & self._valid
                if moved:
                    reach = np.hypot(*motion_field(sight.pair.displacement, self._camera))
                    wanted &= reach * self._camera.fx >= MOVED_PX * answer.depth_m
                known_m = np.where(wanted, answer.depth_m, np.nan).astype(np.float32)
                depth_m = np.asarray(cv2.resize(known_m, self._known.shape[::-1]), dtype=np.float32)
            self._points[name, baseline_m, moved].add(moment.current, depth_m, moment.flown_m)

    def _order(self, key: tuple[str, float] | tuple[str, float, float]) -> tuple[float, ...]:
        """Methods as they were given, then by baseline."""
        names = [*(method.name for method in self._methods), CONSTANT]
        return names.index(key[0]), *key[1:]

    def _photometric(self, name: str, baseline_m: float) -> dict[str, Any]:
        matches = self._matches[name, baseline_m]
        return {
            "method": name,
            "baseline_m": baseline_m,
            "error_share": interval([match.error for match in matches]),
            "pixels_inside": float(np.mean([match.inside for match in matches])),
            "pixels_measured": float(np.mean(self._measured.get((name, baseline_m), np.nan))),
        }

    def _agreement(self, name: str, shorter_m: float, longer_m: float) -> dict[str, Any]:
        logs, shares, common, _ = zip(*self._agreements[name, shorter_m, longer_m], strict=True)
        return {
            "method": name,
            "baselines_m": [shorter_m, longer_m],
            "median_log_ratio": interval(logs),
            "measured_by_both": interval(shares),
            "median_log_ratio_where_peer_measures": interval(common),
        }

    def _slope(self, name: str, baseline_m: float, moved: bool) -> dict[str, Any]:
        slopes = self._points[name, baseline_m, moved].slopes(least_span_m=LEAST_SPAN_M)
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
    both = one.measured & other.measured & valid
    if not both.any():
        return float("nan"), 0.0
    ratio = np.abs(np.log(one.depth_m[both] / other.depth_m[both]))
    return float(np.median(ratio)), np.count_nonzero(both) / np.count_nonzero(valid)
