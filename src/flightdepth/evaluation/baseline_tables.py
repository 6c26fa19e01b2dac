"""A study of baselines as tables on the terminal: a row for each method, a column for each baseline or two."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rich.table import Table

from flightdepth.evaluation.baselines import MOVED_PX
from flightdepth.evaluation.network_tables import laid_out

Rows = Sequence[Mapping[str, Any]]
Cells = Mapping[tuple[str, str], str]  # by method and column


def tables(result: Mapping[str, Any]) -> list[tuple[str, Table]]:
    """The tables of a result of `BaselineStudy` in reading order, each with its title."""
    log_ratio, both, by_peer = "median_log_ratio", "measured_by_both", "median_log_ratio_where_peer_measures"
    titled = (
        (
            "difference after the warp, as a share of that without (1: plane at infinity), pixels measured",
            photometric(result["photometric"]),
        ),
        (
            "median |log depth ratio| between baselines, pixels that both measure",
            agreements(result["agreement"], log_ratio, both),
        ),
        (
            "the same, only where the classical peer measures twice",
            agreements(result["agreement"], by_peer),
        ),
        ("slope of depth per metre flown, number of tracked points", slopes(result["slope"])),
        (
            f"the same, of points that moved by {MOVED_PX:g} px or more between the pictures",
            slopes(result["slope_of_moved"]),
        ),
    )
    return [(title, table_of(cells)) for title, cells in titled]


def photometric(rows: Rows) -> Cells:
    """By baseline."""
    cells = {}
    for row in rows:
        measured = "" if math.isnan(row["pixels_measured"]) else f"{row['pixels_measured']:.0%}"
        error = row["error_share"]
        cells[row["method"], f"{row['baseline_m']:g} m"] = f"{spread(error, error['mean'])}  {measured:>4}"
    return cells


def agreements(rows: Rows, figure: str, share: str | None = None) -> Cells:
    """By two baselines, one of a row's figures and, if wanted, the share of the pixels that it is of."""
    cells = {}
    for row in rows:
        column = " / ".join(f"{length:g}" for length in row["baselines_m"]) + " m"
        cell = spread(row[figure], row[figure]["mean"])
        cells[row["method"], column] = cell if share is None else f"{cell}  {row[share]['mean']:4.0%}"
    return cells


def slopes(rows: Rows) -> Cells:
    """By baseline, the ideal first."""
    cells = {("ideal", f"{row['baseline_m']:g} m"): f"{row['ideal']:.2f}" for row in rows}
    for row in rows:
        cells[row["method"], f"{row['baseline_m']:g} m"] = f"{spread(row, row['median'])}  {row['points']:4d}"
    return cells


def spread(ends: Mapping[str, Any], middle: float) -> str:
    """A figure and half of the interval from low to high; a dash where there is none."""
    return "-" if math.isnan(middle) else f"{middle:.2f} +-{(ends['high'] - ends['low']) / 2:.2f}"


def table_of(cells: Cells) -> Table:
    """In the order that rows and columns were given."""
    names, columns = (list(dict.fromkeys(key[i] for key in cells)) for i in (0, 1))
    rows = ([name, *(cells.get((name, column), "-") for column in columns)] for name in names)
    return laid_out(None, ["", *columns], rows)
