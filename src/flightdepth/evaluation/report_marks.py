"""What the report's plots share: colours, lines with intervals."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from colorsys import hls_to_rgb
from typing import Any
from zlib import crc32

import plotly.graph_objects as go

from flightdepth.evaluation.ranges_trials import CLAMPED, CONSTANT, DEPTHNET, FLOW, MOTION, TINY, Trial

Rows = Mapping[Trial, Mapping[str, Any]]

COLOURS = {
    DEPTHNET: "#2f6db3",
    CLAMPED: "#8a63b8",
    TINY: "#e0861a",
    MOTION: "#12946b",
    FLOW: "#6d7681",
    CONSTANT: "#a9b0b8",
}


def colour_of(method: str) -> str:
    """The same for a method in every plot: #rrggbb; of a network that the user names a hue by its name."""
    parts = hls_to_rgb(crc32(method.encode()) / 2**32, 0.42, 0.5)
    return COLOURS.get(method, "#" + "".join(f"{round(255 * part):02x}" for part in parts))


def line(rows: Sequence[Mapping[str, Any]], name: str, method: str, span: str) -> go.Scatter:
    """Relative error of a method's rows over a span of true depths, %; x is still to be given."""
    errors = [row["errors"][span]["abs_rel"] for row in rows]
    drawn = go.Scatter(name=name, y=percent(errors), error_y=whiskers(errors), mode="lines+markers")
    return drawn.update(line={"color": colour_of(method)}, marker={"size": 9})


def percent(values: Iterable[Mapping[str, Any]]) -> list[float | None]:
    """Means as percentages."""
    return [None if value["mean"] is None else 100 * value["mean"] for value in values]


def whiskers(values: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """95 % intervals as error bars."""
    ends = [(value["low"] or 0, value["mean"] or 0, value["high"] or 0) for value in values]
    arrays = {
        "array": [100 * (high - mean) for _, mean, high in ends],
        "arrayminus": [100 * (mean - low) for low, mean, _ in ends],
    }
    return arrays | {"thickness": 1, "width": 3}
