"""Errors of a network beside those of its peers: figures for a page too, and as tables on the terminal."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from rich.table import Table

WHO = ("network", "classical", "constant")


class Words(NamedTuple):
    """What figures are called where they are shown: each of WHO, the ratio of errors, what joins a range's ends."""

    who: Mapping[str, str]
    ratio: str
    joint: str


class Figures(NamedTuple):
    """A table, to be laid out on a terminal or on a page."""

    headings: Sequence[str]
    rows: Sequence[Sequence[str]]


ON_TERMINAL = Words({who: who for who in WHO}, "L1 of network / this", " to ")


def figures(result: Mapping[str, Any], words: Words) -> tuple[Figures, Figures, Figures, Figures]:
    """Of `evaluate_network`'s result: errors, and L1 in metres by true depth, by angle of travel and by place."""
    return (
        errors(result, words),
        by_part(result, words, "depth_bins", ("depth m", "from_m", "to_m", "pixels")),
        by_part(result, words, "travel_angles", ("degrees", "from_deg", "to_deg", "pictures")),
        by_place(result, words),
    )


def errors(result: Mapping[str, Any], words: Words) -> Figures:
    """A row for each of WHO, with the network's L1 over its."""
    rows = [
        [
            words.who[who],
            *(number(result[who][key], 3) for key in ("l1_m", "rmse_m", "abs_rel", "delta")),
            number(result["l1_ratios"].get(who), 2),
        ]
        for who in WHO
    ]
    return Figures(("", "L1 m", "RMSE m", "abs rel", "< 1.25", words.ratio), rows)


def by_part(result: Mapping[str, Any], words: Words, key: str, names: tuple[str, str, str, str]) -> Figures:
    """A row for each part of a range: its ends, what was counted in it, and the L1 of each of WHO in metres.

    names   what the range is called here; its ends and what was counted, in the result
    """
    heading, least, most, counted = names
    rows = [
        [
            f"{each[0][least]:g}{words.joint}{each[0][most]:g}",
            f"{each[0][counted]:,.0f}",
            *(number(part["l1_m"], 2) for part in each),
        ]
        for each in zip(*(result[who][key] for who in WHO), strict=True)
    ]
    return Figures((heading, counted, *words.who.values()), rows)


def by_place(result: Mapping[str, Any], words: Words) -> Figures:
    """A row for each of `places.PLACES`."""
    rows = [
        [
            row["place"],
            percent(row["share"]),
            percent(row["network"]["of_error"]),
            number(row["network"]["abs_rel"], 3),
            *(number(row[who]["l1_m"], 2) for who in WHO),
        ]
        for row in result["places"]
    ]
    return Figures(("", "pixels", "of the network's error", "its abs rel", *words.who.values()), rows)


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
    titles = (
        f"{result['name']} on {result['set']}, {result['pairs']} pairs",
        "L1 in metres per depth",
        "L1 in metres per angle of travel (0 = forward)",
        "where the error sits, L1 in metres",
    )
    shown = zip(titles, figures(result, ON_TERMINAL), strict=True)
    first = [laid_out(title, *each) for title, each in shown]
    return [*first, spread_table(result)] if "spread" in result else first


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
