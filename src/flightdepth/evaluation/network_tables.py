"""Errors of a network beside those of its peers, as tables on the terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from rich.table import Table

WHO = ("network", "classical", "constant")

PLACE_COLUMNS = ("pixels", "of the network's error", "its abs rel")


class Parts(NamedTuple):
    """What the parts of a range are called in a result of `evaluate_network`."""

    least: str
    most: str
    counted: str


PARTS = {  # of true depths, and of angles between the optical axis and the direction of travel
    "depth_bins": Parts("from_m", "to_m", "pixels"),
    "travel_angles": Parts("from_deg", "to_deg", "pictures"),
}


def metrics_table(result: Mapping[str, Any]) -> Table:
    """A row each for the network, the classical peer and the best constant of `evaluate_network`."""
    table = Table(title=f"{result['name']} on {result['set']}, {result['pairs']} pairs", box=None)
    for heading in ("", "L1 m", "RMSE m", "abs rel", "< 1.25", "L1 of network / this"):
        table.add_column(heading, justify="left" if heading == "" else "right")
    for who in WHO:
        errors = result[who]
        row = [number(errors[key], 3) for key in ("l1_m", "rmse_m", "abs_rel", "delta")]
        table.add_row(who, *row, number(result["l1_ratios"].get(who), 2))
    return table


def parts_table(result: Mapping[str, Any], parts: str, title: str, heading: str) -> Table:
    """Mean error in each of the PARTS."""
    table = Table(title=title, box=None)
    for name in (heading, PARTS[parts].counted, *WHO):
        table.add_column(name, justify="right")
    for cells in part_rows(result, parts, joint=" to "):
        table.add_row(*cells)
    return table


def part_rows(result: Mapping[str, Any], parts: str, *, joint: str) -> list[list[str]]:
    """A row for each of the PARTS: its ends, what was counted in it, and the L1 of each of WHO in metres."""
    names = PARTS[parts]
    several = zip(*(result[who][parts] for who in WHO), strict=True)
    return [
        [
            f"{each[0][names.least]:g}{joint}{each[0][names.most]:g}",
            f"{each[0][names.counted]:,.0f}",
            *(number(errors["l1_m"], 2) for errors in each),
        ]
        for each in several
    ]


def places_table(result: Mapping[str, Any]) -> Table:
    """Mean error in each of `places.PLACES`."""
    table = Table(title="where the error sits, L1 in metres", box=None)
    for name in ("", *PLACE_COLUMNS, *WHO):
        table.add_column(name, justify="right" if name else "left")
    for cells in place_rows(result):
        table.add_row(*cells)
    return table


def place_rows(result: Mapping[str, Any]) -> list[list[str]]:
    """A row for each of `places.PLACES`: the PLACE_COLUMNS, and the L1 of each of WHO in metres."""
    return [
        [
            row["place"],
            percent(row["share"]),
            percent(row["network"]["of_error"]),
            number(row["network"]["abs_rel"], 3),
            *(number(row[who]["l1_m"], 2) for who in WHO),
        ]
        for row in result["places"]
    ]


def spread_table(result: Mapping[str, Any]) -> Table:
    """The error bar beside the error, in ten groups of rising sigma."""
    spread = result["spread"]
    title = f"error bar: {inside(spread)}"
    table = Table(title=title, box=None)
    for heading in ("sigma m", "L1 m", "inside one"):
        table.add_column(heading, justify="right")
    for group in spread["by_sigma"]:
        table.add_row(number(group["sigma_m"], 2), number(group["l1_m"], 2), f"{group['inside_one']:.0%}")
    return table


def inside(spread: Mapping[str, Any]) -> str:
    """The shares of errors that are inside."""
    believed = spread["believed"]
    own = "none" if believed["inside_one"] is None else f"{believed['inside_one']:.1%}"
    return (
        f"{spread['inside_one']:.1%} of errors inside one sigma, {spread['inside_two']:.1%} inside two;"
        f" of what flights believe ({believed['share']:.0%}) {own} inside one"
    )


def tables(result: Mapping[str, Any]) -> Sequence[Table]:
    """All tables of a result, in reading order."""
    first = (
        metrics_table(result),
        parts_table(result, "depth_bins", "L1 in metres per depth", "depth m"),
        parts_table(result, "travel_angles", "L1 in metres per angle of travel (0 = forward)", "degrees"),
        places_table(result),
    )
    return (*first, spread_table(result)) if "spread" in result else first


def percent(value: float | None) -> str:
    """A share as a whole percentage; a dash where there is none."""
    return "-" if value is None or not math.isfinite(value) else f"{100 * value:.0f} %"


def number(value: float | None, digits: int) -> str:
    """A figure for a table; a dash where there is none."""
    return "-" if value is None or not math.isfinite(value) else f"{value:.{digits}f}"
