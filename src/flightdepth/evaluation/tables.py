"""Results as tables on the terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rich.table import Table

WHO = ("network", "classical", "constant")


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


def depth_table(result: Mapping[str, Any]) -> Table:
    """Mean error per range of true depth."""
    rows = {who: result[who]["depth_bins"] for who in WHO}
    table = Table(title="L1 in metres per depth", box=None)
    for heading in ("depth m", "pixels", *WHO):
        table.add_column(heading, justify="right")
    for parts in zip(*rows.values(), strict=True):
        first = parts[0]
        span = f"{first['from_m']:g} to {first['to_m']:g}"
        table.add_row(span, f"{first['pixels']:,.0f}", *(number(part["l1_m"], 2) for part in parts))
    return table


def angle_table(result: Mapping[str, Any]) -> Table:
    """Mean error per angle between the optical axis and the direction of travel."""
    rows = {who: result[who]["travel_angles"] for who in WHO}
    table = Table(title="L1 in metres per angle of travel (0 = forward)", box=None)
    for heading in ("degrees", "pictures", *WHO):
        table.add_column(heading, justify="right")
    for parts in zip(*rows.values(), strict=True):
        first = parts[0]
        span = f"{first['from_deg']:g} to {first['to_deg']:g}"
        table.add_row(span, f"{first['pictures']:.0f}", *(number(part["l1_m"], 2) for part in parts))
    return table


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
    first = (metrics_table(result), depth_table(result), angle_table(result))
    return (*first, spread_table(result)) if "spread" in result else first


def number(value: float | None, digits: int) -> str:
    """A figure for a table; a dash where there is none."""
    return "-" if value is None or not math.isfinite(value) else f"{value:.{digits}f}"
