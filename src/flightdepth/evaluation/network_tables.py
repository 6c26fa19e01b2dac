"""Errors of a network beside those of its peers, as tables on the terminal."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from rich.table import Table

WHO = ("network", "classical", "constant")

ERROR_COLUMNS = ("L1 m", "RMSE m", "abs rel", "< 1.25")
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
    title = f"{result['name']} on {result['set']}, {result['pairs']} pairs"
    rows = ([who, *error_cells(result, who)] for who in WHO)
    return laid_out(title, ("", *ERROR_COLUMNS, "L1 of network / this"), rows)


def error_cells(result: Mapping[str, Any], who: str) -> list[str]:
    """The ERROR_COLUMNS of one of WHO, and the network's L1 over its."""
    figures = [number(result[who][key], 3) for key in ("l1_m", "rmse_m", "abs_rel", "delta")]
    return [*figures, number(result["l1_ratios"].get(who), 2)]


def parts_table(result: Mapping[str, Any], parts: str, title: str, heading: str) -> Table:
    """Mean error in each of the PARTS."""
    rows = part_rows(result, parts, joint=" to ")
    return laid_out(title, (heading, PARTS[parts].counted, *WHO), rows)


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
    headings = ("", *PLACE_COLUMNS, *WHO)
    return laid_out("where the error sits, L1 in metres", headings, place_rows(result))


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
    rows = (
        [number(group["sigma_m"], 2), number(group["l1_m"], 2), f"{group['inside_one']:.0%}"]
        for group in spread["by_sigma"]
    )
    return laid_out(f"error bar: {inside(spread)}", ("sigma m", "L1 m", "inside one"), rows)


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


def laid_out(
    title: str | None, headings: Iterable[str], rows: Iterable[Sequence[str]], *, names: str = ""
) -> Table:
    """A table of figures; the column headed `names` holds names."""
    table = Table(title=title, box=None)
    for heading in headings:
        table.add_column(heading, justify="left" if heading == names else "right")
    for cells in rows:
        table.add_row(*cells)
    return table


def percent(value: float | None) -> str:
    """A share as a whole percentage; a dash where there is none."""
    return "-" if value is None or not math.isfinite(value) else f"{100 * value:.0f} %"


def number(value: float | None, digits: int) -> str:
    """A figure for a table; a dash where there is none."""
    return "-" if value is None or not math.isfinite(value) else f"{value:.{digits}f}"
