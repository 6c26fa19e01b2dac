"""How exact the depth of a flight's folder is, where the truth of some of its frames is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flightdepth.evaluation.depth_ratios import Ratios
from flightdepth.evaluation.flight_errors import DepthRange, FlightErrors, within
from flightdepth.evaluation.metrics import DepthErrors
from flightdepth.evaluation.true_depth import at_centres
from flightdepth.files import without_nan
from flightdepth.outputs.encoding import UNIT_M
from flightdepth.outputs.read import FlightFolder
from flightdepth.ranges.fusion import RIGHT_WITHIN
from flightdepth.runtimes.arrays import Flags, Maps

DEPTH = "depth"
LEAST_SURE = (0.9, 0.75, 0.5)  # confidences
QUARTILES = {"low": 0.25, "median": 0.5, "high": 0.75}


@dataclass(frozen=True)
class FrameMaps:
    """What a flight's folder says of a frame, at the truth's pixels [h, w]; NaN = not told, None = nowhere told."""

    depth_m: Maps
    confidence: Maps
    sigma_m: Maps | None
    farther_than_m: Maps | None
    nearer_than_m: Maps | None

    @classmethod
    def of(cls, folder: FlightFolder, index: int, shape: tuple[int, int]) -> FrameMaps:
        """Those of the frame with this index, at the size `shape` = (h, w)."""

        def sampled(map_hw: Maps | None) -> Maps | None:
            return None if map_hw is None else at_centres(map_hw, shape)

        return cls(
            at_centres(folder.depth_m(index), shape),
            at_centres(folder.confidence(index), shape),
            sampled(folder.sigma_m(index)),
            sampled(folder.farther_than_m(index)),
            sampled(folder.nearer_than_m(index)),
        )


@dataclass(frozen=True)
class FrameErrors:
    """One frame, over all ranges together.

    pixels   with a true depth there
    known    share of them with a depth; the others are over these, NaN without any
    abs_rel  mean |depth - truth| / truth
    ratio    median of depth / truth
    """

    index: int
    pixels: int
    known: float
    abs_rel: float
    ratio: float


class Tally:
    """Pixels that were asked about something, and those of which it holds."""

    def __init__(self) -> None:
        self.asked = self.held = 0

    def add(self, asked: Flags, held: Flags) -> None:
        """Count the pixels [h, w] of one frame."""
        self.asked += int(np.count_nonzero(asked))
        self.held += int(np.count_nonzero(asked & held))

    @property
    def share(self) -> float:
        """Share of which it holds; NaN where none was asked about."""
        return self.held / self.asked if self.asked else float("nan")

    def figures(self) -> dict[str, Any]:
        """As they stand in a JSON file."""
        return {"pixels": self.asked, "share": self.share}


class FlightTruth:
    """Sums errors frame by frame, so that no flight has to be kept in memory.

    ranges   of true depth, and in the end all of them together
    """

    def __init__(self, ranges: Sequence[DepthRange]) -> None:
        whole = DepthRange("all", ranges[0].from_m, ranges[-1].to_m)
        self.ranges = (*ranges, whole)
        self.errors = FlightErrors(self.ranges)
        self.ratios = [Ratios() for _ in self.ranges]
        self.anywhere = Ratios()  # in no range, too
        self.inside_sigma = [Tally() for _ in self.ranges]
        self.sky_with_depth, self.sky_with_bound, self.beyond = Tally(), Tally(), Tally()
        self.farther, self.nearer = Tally(), Tally()
        self.told_farther, self.told_nearer = Tally(), Tally()
        self.right, self.sure = ({least: Tally() for least in LEAST_SURE} for _ in range(2))
        self.frames: list[FrameErrors] = []

    def add(self, index: int, maps: FrameMaps, truth_m: Maps) -> None:
        """Count one frame; truth [h, w] in metres, NaN unknown, infinite sky."""
        known, told = np.isfinite(maps.depth_m) & (maps.depth_m > 0), truth_m > 0
        whole = self.errors.add(DEPTH, np.where(known, maps.depth_m, np.float32(np.nan)), truth_m)[-1]
        ratio = np.divide(maps.depth_m, truth_m, where=known & told, out=np.full(truth_m.shape, np.nan))
        self._add_ratios(ratio, truth_m)
        self._add_sigma(maps, known, truth_m)
        self._add_bounds(maps, known, told, truth_m)
        for least, right in self.right.items():
            sure = known & told & (maps.confidence >= np.float32(least))
            right.add(sure, np.abs(ratio - 1) <= RIGHT_WITHIN)
            self.sure[least].add(known & told, sure)
        ratios = ratio[within(truth_m, self.ranges[-1]) & known]
        median = float(np.median(ratios)) if len(ratios) else float("nan")
        self.frames.append(FrameErrors(index, whole.pixels, whole.known, whole.abs_rel, median))

    def _add_ratios(self, ratio: NDArray[np.float64], truth_m: Maps) -> None:
        told = np.isfinite(ratio) & (ratio > 0)
        self.anywhere.add(ratio[told])
        for depth_range, ratios in zip(self.ranges, self.ratios, strict=True):
            ratios.add(ratio[told & within(truth_m, depth_range)])

    def _add_sigma(self, maps: FrameMaps, known: Flags, truth_m: Maps) -> None:
        if maps.sigma_m is None:
            return
        told = known & np.isfinite(maps.sigma_m)
        inside = np.less_equal(
            np.abs(maps.depth_m - truth_m), maps.sigma_m, where=told, out=np.zeros_like(told)
        )
        for depth_range, tally in zip(self.ranges, self.inside_sigma, strict=True):
            tally.add(told & within(truth_m, depth_range), inside)

    def _add_bounds(self, maps: FrameMaps, known: Flags, told: Flags, truth_m: Maps) -> None:
        nowhere = np.full_like(truth_m, np.nan)
        farther = nowhere if maps.farther_than_m is None else maps.farther_than_m
        nearer = nowhere if maps.nearer_than_m is None else maps.nearer_than_m
        rounding = np.float32(UNIT_M)
        self.told_farther.add(told, np.isfinite(farther))
        self.farther.add(told & np.isfinite(farther), truth_m >= farther - rounding)
        self.told_nearer.add(told, np.isfinite(nearer))
        self.nearer.add(told & np.isfinite(nearer), truth_m <= nearer + rounding)
        sky = np.isposinf(truth_m)
        self.sky_with_depth.add(sky, known)
        self.sky_with_bound.add(sky, np.isfinite(farther))
        self.beyond.add(told, ~sky & (truth_m >= self.ranges[-1].to_m))

    def range_errors(self) -> tuple[DepthErrors, ...]:
        """Those of each of `ranges`, of the frames so far."""
        return self.errors.result()[DEPTH]

    def worst(self, count: int) -> list[FrameErrors]:
        """The frames of the largest relative error, the worst first."""
        told = [frame for frame in self.frames if np.isfinite(frame.abs_rel)]
        return sorted(told, key=lambda frame: -frame.abs_rel)[:count]

    def figures(self) -> dict[str, Any]:
        """All of it, as it stands in a JSON file; None where there is nothing."""
        found = {
            "ranges": [self._range_figures(i) for i in range(len(self.ranges))],
            "beyond_the_ranges": self.beyond.figures(),
            "sky": {
                "pixels": self.sky_with_depth.asked,
                "with_depth": self.sky_with_depth.share,
                "with_farther_than": self.sky_with_bound.share,
            },
            "farther_than_holds": self.farther.figures(),
            "nearer_than_holds": self.nearer.figures(),
            "confidence": [
                {"at_least": least, "of_depth": self.sure[least].share, "right_within_a_quarter": right.share}
                for least, right in self.right.items()
            ],
            "frames": [asdict(frame) for frame in self.frames],
        }
        return {name: without_nan(value) for name, value in found.items()}

    def _range_figures(self, i: int) -> dict[str, Any]:
        return {
            **asdict(self.ranges[i]),
            **asdict(self.range_errors()[i]),
            "depth_over_truth": {name: self.ratios[i].quantile(share) for name, share in QUARTILES.items()},
            "inside_sigma": self.inside_sigma[i].share,
        }
