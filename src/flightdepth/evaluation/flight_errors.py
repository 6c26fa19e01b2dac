"""Errors over a flight whose true depth is known, per range of depth, for several estimators side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from flightdepth.evaluation.metrics import DepthErrors, depth_errors, depth_sums
from flightdepth.evaluation.network_tables import number, percent
from flightdepth.runtimes.arrays import Flags, Maps


@dataclass(frozen=True)
class DepthRange:
    """True depths from `from_m` on, below `to_m`."""

    name: str
    from_m: float
    to_m: float

    @property
    def label(self) -> str:
        """Its name, where it has one, and its ends: "near, 0-15 m"."""
        ends = f"{self.from_m:g}-{self.to_m:g} m"
        return f"{self.name}, {ends}" if self.name else ends


RANGES = (
    DepthRange("near", 0.0, 15.0),
    DepthRange("middle", 15.0, 50.0),
    DepthRange("far", 50.0, 150.0),
)


class FlightErrors:
    """Sums errors frame by frame, so that no flight has to be kept in memory."""

    def __init__(self, ranges: Sequence[DepthRange] = RANGES) -> None:
        self.ranges = tuple(ranges)
        self._sums: dict[str, NDArray[np.float64]] = {}

    def add(self, estimator: str, depth_m: Maps, truth_m: Maps) -> tuple[DepthErrors, ...]:
        """Count one frame of `estimator`: maps [H, W] in metres, NaN = unknown (not counted in the truth).

        Returns the errors of this frame alone, of each range.
        """
        if depth_m.shape != truth_m.shape:
            raise ValueError(f"expected depth {truth_m.shape}, got {depth_m.shape}")
        inside = (within(truth_m, depth_range) for depth_range in self.ranges)
        of_frame = np.stack([depth_sums(depth_m, truth_m, each) for each in inside])
        sums = self._sums.setdefault(estimator, np.zeros_like(of_frame))
        sums += of_frame
        return tuple(map(depth_errors, of_frame))

    def result(self) -> Mapping[str, tuple[DepthErrors, ...]]:
        """Per estimator, in the order they were first added, the errors of each range."""
        return {name: tuple(map(depth_errors, sums)) for name, sums in self._sums.items()}

    def table(self) -> Table:
        """Relative error, L1 and coverage per range, estimators side by side."""
        result = self.result()
        table = Table("true depth", box=None, pad_edge=False)
        for name in result:
            for heading in ("rel. error", "L1 m", "known"):
                table.add_column(f"{name}\n{heading}", justify="right")
        for index, depth_range in enumerate(self.ranges):
            cells = [cell for errors in result.values() for cell in cells_of(errors[index])]
            table.add_row(depth_range.label, *cells)
        return table


def within(truth_m: Maps, depth_range: DepthRange) -> Flags:
    """Which true depths are in a range; those that are NaN, 0 or less are in none."""
    return np.asarray((truth_m >= depth_range.from_m) & (truth_m < depth_range.to_m) & (truth_m > 0))


def cells_of(errors: DepthErrors) -> tuple[str, str, str]:
    """Relative error, L1 and coverage as text, dashes where there is nothing."""
    return percent(errors.abs_rel), number(errors.l1_m, 1), percent(errors.known)
