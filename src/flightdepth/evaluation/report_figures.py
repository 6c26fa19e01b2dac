"""The plots of the multi-range report, from the figures of `ranges_result`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import plotly.graph_objects as go

from flightdepth.evaluation.ranges_trials import (
    CONSTANT,
    DEPTHNET,
    FLOW,
    MOTION,
    TINY,
    Trial,
    as_flown,
    default_fusion,
    figure,
    side_by_side,
    trial_of,
)
from flightdepth.evaluation.report_marks import COLOURS, Rows, colour_of, line, percent, whiskers
from flightdepth.evaluation.report_sweeps import noise_plot, pair_plot, range_plot, rate_plot, speed_plot

SPANS = ("near", "middle", "far")
PLACES_TOLD = {
    "inside": ("truth inside some range", "#5b8fc7"),
    "nearer": ("truth nearer than every range", "#d9822b"),
    "beyond": ("truth beyond or between them", "#a9b0b8"),
}
FONT = {"family": "system-ui, sans-serif", "size": 13, "color": "#222b36"}
GRID = "#e6e9ed"


def plots(found: Mapping[str, Any]) -> dict[str, go.Figure]:
    """Every plot that the result has figures for, by its place on the page."""
    rows = {trial_of(row["trial"]): row for row in found["trials"]}
    drawn: dict[str, Callable[[Rows], go.Figure]] = {
        "time": time_plot,
        "spans": span_plot,
        "coverage": coverage_plot,
        "pairs": pair_plot,
        "ranges": range_plot,
        "noise": noise_plot,
        "speed": speed_plot,
        "telemetry": rate_plot,
        "shifts": shift_plot,
        "fusion": fusion_plot,
        "flicker": flicker_plot,
        "confidence": confidence_plot,
    }
    figures = {name: draw(rows) for name, draw in drawn.items()}
    return {name: dressed(each) for name, each in figures.items() if each.data}


def time_plot(rows: Rows) -> go.Figure:
    """The paper's last figure: relative error against the network's time, a line for each method."""
    plot = go.Figure()
    lines: dict[tuple[str, bool], list[Trial]] = {}
    for trial in side_by_side(rows):
        if trial.method != CONSTANT:
            lines.setdefault((trial.method, trial.telemetry.directed), []).append(trial)
    for (method, directed), trials in lines.items():
        name = method if directed else f"{method}, direction estimated"
        symbol = "circle" if directed and method != FLOW else "diamond" if directed else "circle-open"
        drawn = line([rows[trial] for trial in trials], name, method, "all")
        drawn.update(x=[rows[trial]["predict_ms"] for trial in trials], mode="lines+markers+text")
        drawn.update(text=[f"{trial.ranges}" for trial in trials], textposition="bottom left")
        drawn.update(marker={"symbol": symbol, "size": 11, "color": colour_of(method)})
        drawn.update(line={"color": colour_of(method), "dash": "solid" if directed else "dot"})
        drawn.update(hovertemplate="n = %{text}: %{y:.1f} %<br>%{x:.1f} ms")
        plot.add_trace(drawn)
    constant = Trial(CONSTANT, 0)
    times_ms = [rows[trial]["predict_ms"] for trials in lines.values() for trial in trials]
    longest_ms = max((ms for ms in times_ms if ms is not None), default=None)
    if constant in rows and longest_ms is not None:
        level = percent([rows[constant]["errors"]["all"]["abs_rel"]])
        across = go.Scatter(name=rows[constant]["label"], x=[0, longest_ms], y=level * 2, mode="lines")
        plot.add_trace(across.update(line={"dash": "dot", "color": COLOURS[CONSTANT]}))
    plot.update_xaxes(title="network, ms of processor time a frame (one core)", rangemode="tozero")
    plot.update_yaxes(title="|error| / true depth, %", rangemode="tozero")
    return plot


def span_plot(rows: Rows) -> go.Figure:
    """Relative error near, in the middle and far."""
    plot = go.Figure()
    for trial in side_by_side(rows):
        errors = [rows[trial]["errors"][span]["abs_rel"] for span in SPANS]
        label = rows[trial]["label"]
        opacity = (0.4 + 0.15 * trial.ranges) if trial.telemetry.directed else 0.3
        bar = go.Bar(name=label, x=["near, 0-15 m", "middle, 15-50 m", "far, 50-150 m"])
        bar.update(y=percent(errors), error_y=whiskers(errors))
        # A legend does not look at a marker's opacity.
        bar.update(marker={"color": f"{colour_of(trial.method)}{round(255 * opacity):02x}"})
        bar.update(hovertemplate="%{y:.1f} %")
        plot.add_trace(bar)
    plot.update_layout(barmode="group")
    plot.update_yaxes(title="|error| / true depth, %")
    return plot


def coverage_plot(rows: Rows) -> go.Figure:
    """The mean relative error of each trial, split by where the truth lay among its pairs' ranges."""
    trials = [t for t in side_by_side(rows) if t.telemetry.directed and rows[t]["coverage"]]
    plot = go.Figure()
    for place, (told, colour) in PLACES_TOLD.items():
        found = [rows[trial]["coverage"][place] for trial in trials]
        if not found:
            break
        bar = go.Bar(
            name=told, x=[rows[t]["label"] for t in trials], y=[100 * each["part"] for each in found]
        )
        bar.update(marker={"color": colour}, customdata=[[100 * each["share"]] for each in found])
        bar.update(hovertemplate="%{y:.1f} points from %{customdata[0]:.0f} % of the pixels")
        plot.add_trace(bar)
    best = [100 * (rows[trial]["best_abs_rel"]["all"]["mean"] or 0) for trial in trials]
    if best:
        marks = go.Scatter(name="the best of its ranges at each pixel, in hindsight", mode="markers", y=best)
        marks.update(x=[rows[t]["label"] for t in trials], hovertemplate="%{y:.1f} %")
        plot.add_trace(marks.update(marker={"symbol": "line-ew-open", "size": 22, "color": "#222b36"}))
    plot.update_layout(barmode="stack")
    plot.update_yaxes(title="|error| / true depth, %", rangemode="tozero")
    return plot


def shift_plot(rows: Rows) -> go.Figure:
    """Which shifts the ranges used: median and quartiles."""
    plot = go.Figure()
    for method in (DEPTHNET, TINY, MOTION):
        labels, values, low, high = [], [], [], []
        for trial in (t for t in figure() if t.method == method and t in rows):
            for first, middle, third in rows[trial]["shifts"]["quartiles"]:
                labels.append(rows[trial]["label"])
                values.append(middle)
                low.append(middle - first)
                high.append(third - middle)
        if labels:
            points = go.Scatter(name=method, x=labels, y=values, mode="markers")
            points.update(error_y={"array": high, "arrayminus": low, "thickness": 1.5})
            points.update(marker={"color": colour_of(method), "size": 10}, hovertemplate="%{y:.0f} frames")
            plot.add_trace(points)
    plot.update_yaxes(title="shift, frames (0.033 m each)", rangemode="tozero")
    return plot


def fusion_plot(rows: Rows) -> go.Figure:
    """What the default fusion leaves out, and how right the rest is, beside the paper's; then with n ranges."""
    plot = go.Figure()
    for trial in default_fusion():
        pair = [each for each in (replace(trial, fusion="paper"), trial) if each in rows]
        if len(pair) == 2:
            points = known_and_error(rows, pair, ["paper", "default"], name=rows[trial]["label"])
            points.update(marker={"symbol": ["circle-open", "circle"], "size": 11})
            points.update(line={"color": colour_of(trial.method), "dash": "dot", "width": 1})
            plot.add_trace(points)
    flown = [trial for trial in as_flown() if trial in rows]
    if flown:
        told = [f"n = {trial.ranges}" for trial in flown]
        points = known_and_error(rows, flown, told, name="motion as run flies it")
        plot.add_trace(points.update(line={"color": COLOURS[MOTION]}, marker={"size": 9}))
    plot.update_xaxes(title="pixels with a depth, %", range=[0, 104])
    plot.update_yaxes(title="|error| / true depth of those, %", rangemode="tozero")
    return plot


def known_and_error(rows: Rows, trials: Sequence[Trial], told: Sequence[str], *, name: str) -> go.Scatter:
    """A line through some trials: error over the share of pixels that have a depth."""
    errors = [rows[trial]["errors"]["all"] for trial in trials]
    known, error = (percent(each[key] for each in errors) for key in ("known", "abs_rel"))
    points = go.Scatter(name=name, mode="lines+markers", x=known, y=error, text=told)
    return points.update(hovertemplate="%{text}: %{y:.1f} % on %{x:.0f} % of pixels")


def flicker_plot(rows: Rows) -> go.Figure:
    """Change of depth between frames beyond the motion."""
    trials = [*side_by_side(rows), *(t for t in default_fusion() if t in rows)]
    trials = [trial for trial in trials if trial.method != CONSTANT]
    trials.sort(key=lambda t: t.fusion != "paper")
    plot = go.Figure()
    for fusion, opacity in (("paper", 1.0), ("saturation", 0.55)):
        own = [t for t in trials if t.fusion == fusion]
        if own:
            changes = [rows[t]["flicker"] for t in own]
            bar = go.Bar(x=[rows[t]["label"] for t in own], y=percent(changes), error_y=whiskers(changes))
            bar.update(name=f"{fusion} fusion", hovertemplate="%{y:.1f} %")
            bar.update(marker={"color": [colour_of(t.method) for t in own], "opacity": opacity})
            plot.add_trace(bar)
    plot.update_yaxes(title="median change from frame to frame, %")
    return plot


def confidence_plot(rows: Rows) -> go.Figure:
    """How often depth was right within 25 %, over what confidence said."""
    plot = go.Figure()
    dashes = {1: "dot", 2: "solid", 3: "dash", 4: "dash"}
    for trial in (t for t in default_fusion() if t in rows):
        tenths = [tenth for tenth in rows[trial]["confidence"]["tenths"] if tenth]
        curve = go.Scatter(name=rows[trial]["label"], mode="lines+markers")
        curve.update(
            x=[100 * tenth["said"] for tenth in tenths], y=[100 * tenth["right"] for tenth in tenths]
        )
        curve.update(line={"color": colour_of(trial.method), "dash": dashes[trial.ranges]})
        curve.update(hovertemplate="said %{x:.0f} %, right %{y:.0f} %")
        plot.add_trace(curve)
    if plot.data:
        ideal = go.Scatter(x=[0, 100], y=[0, 100], mode="lines", name="keeps its word")
        plot.add_trace(ideal.update(line={"color": "#9aa3ad", "width": 1}, hoverinfo="skip"))
    plot.update_xaxes(title="confidence, %", range=[0, 102])
    plot.update_yaxes(title="right within 25 %, %", range=[0, 102])
    return plot


def dressed(plot: go.Figure) -> go.Figure:
    """The page's look."""
    legend = {"orientation": "h", "y": 1.08, "yanchor": "bottom", "x": 0}
    plot.update_layout(
        template="simple_white",
        font=FONT,
        height=460,
        margin={"l": 64, "r": 16, "t": 24, "b": 56},
        legend=legend,
        paper_bgcolor="rgba(0,0,0,0)",
        plot_bgcolor="rgba(0,0,0,0)",
        hoverlabel={"font": FONT},
    )
    plot.update_yaxes(gridcolor=GRID, showgrid=True, zeroline=False)
    return plot
