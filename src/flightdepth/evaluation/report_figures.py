"""The plots of the multi-range report, from the figures of `ranges_result`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from flightdepth.evaluation.ranges_trials import (
    CLAMPED,
    CONSTANT,
    DEPTHNET,
    FLOW,
    MOTION,
    NOISY_SPEED_M_S,
    TINY,
    Telemetry,
    Trial,
    default_fusion,
    derotated,
    figure,
    orientation_noise,
    peers,
    trial_of,
    wrong_speed,
)

Rows = Mapping[Trial, Mapping[str, Any]]

COLOURS = {
    DEPTHNET: "#2f6db3",
    CLAMPED: "#8a63b8",
    TINY: "#e0861a",
    MOTION: "#12946b",
    FLOW: "#6d7681",
    CONSTANT: "#a9b0b8",
}
SPANS = ("near", "middle", "far")
FONT = {"family": "system-ui, sans-serif", "size": 13, "color": "#222b36"}
GRID = "#e6e9ed"


def rows_of(found: Mapping[str, Any]) -> dict[Trial, Mapping[str, Any]]:
    """The rows of a result by their trial."""
    return {trial_of(row["trial"]): row for row in found["trials"]}


def plots(found: Mapping[str, Any]) -> dict[str, go.Figure]:
    """Every plot that the result has figures for, by its place on the page."""
    rows = rows_of(found)
    drawn: dict[str, Callable[[Rows], go.Figure]] = {
        "time": time_plot,
        "spans": span_plot,
        "noise": noise_plot,
        "pairs": pair_plot,
        "telemetry": telemetry_plot,
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
    for trial in (*figure(), *peers()):
        if trial in rows and trial.method != CONSTANT:
            lines.setdefault((trial.method, trial.telemetry.directed), []).append(trial)
    for (method, directed), trials in lines.items():
        name = method if directed else f"{method}, direction estimated"
        symbol = "circle" if directed and method != FLOW else "diamond" if directed else "circle-open"
        line = _line([rows[trial] for trial in trials], name, method, "all")
        line.update(x=[rows[trial]["predict_ms"] for trial in trials], mode="lines+markers+text")
        line.update(text=[f"{trial.ranges}" for trial in trials], textposition="bottom left")
        line.update(marker={"symbol": symbol, "size": 11, "color": COLOURS[method]})
        line.update(line={"color": COLOURS[method], "dash": "solid" if directed else "dot"})
        line.update(hovertemplate="n = %{text}: %{y:.1f} %<br>%{x:.1f} ms")
        plot.add_trace(line)
    constant = Trial(CONSTANT, 0)
    if constant in rows and lines:
        longest = max(rows[trial]["predict_ms"] for trials in lines.values() for trial in trials)
        level = rows[constant]["errors"]["all"]["abs_rel"]["mean"]
        line = go.Scatter(name=rows[constant]["label"], x=[0, longest], y=[100 * level] * 2, mode="lines")
        plot.add_trace(line.update(line={"dash": "dot", "color": COLOURS[CONSTANT]}))
    plot.update_xaxes(title="network, ms of processor time a frame (one core)", rangemode="tozero")
    plot.update_yaxes(title="|error| / true depth, %", rangemode="tozero")
    return plot


def span_plot(rows: Rows) -> go.Figure:
    """Relative error near, in the middle and far."""
    plot = go.Figure()
    for trial in (*figure(), *peers()):
        if trial not in rows:
            continue
        errors = [rows[trial]["errors"][span]["abs_rel"] for span in SPANS]
        label = rows[trial]["label"]
        opacity = (0.4 + 0.15 * trial.ranges) if trial.telemetry.directed else 0.3
        bar = go.Bar(name=label, x=["near, 0-15 m", "middle, 15-50 m", "far, 50-150 m"])
        bar.update(y=_percent(errors), error_y=_whiskers(errors))
        bar.update(marker={"color": COLOURS[trial.method], "opacity": opacity})
        bar.update(hovertemplate="%{y:.1f} %")
        plot.add_trace(bar)
    plot.update_layout(barmode="group")
    plot.update_yaxes(title="|error| / true depth, %")
    return plot


def noise_plot(rows: Rows) -> go.Figure:
    """Error over orientation noise, all depths and far ones."""
    spans = ("all", "far")
    plot = make_subplots(cols=2, subplot_titles=["all depths", "far, 50-150 m"])
    lines: dict[str, list[Trial]] = {}
    for trial in (*orientation_noise(), *derotated()):
        if trial in rows and trial.fusion == "paper":
            lines.setdefault(trial.label, []).append(trial)
    lines = {label: trials for label, trials in lines.items() if len(trials) > 1}
    for column, span in enumerate(spans, start=1):
        for label, trials in lines.items():
            line = _line([rows[t] for t in trials], label, trials[0].method, span)
            line.update(line={"color": COLOURS[trials[0].method], "dash": _dash(trials[0])})
            line.update(x=[f"{t.noise_rad:g}" for t in trials], showlegend=column == 1)
            line.update(legendgroup=line.name, hovertemplate="N0 = %{x}: %{y:.1f} %")
            plot.add_trace(line, row=1, col=column)
    plot.update_xaxes(title="orientation noise N0, rad", type="category")
    plot.update_yaxes(title="|error| / true depth, %", rangemode="tozero", col=1)
    return plot


def pair_plot(rows: Rows) -> go.Figure:
    """How pairs are chosen: a fixed shift, the optimal one, clusters."""
    plot = go.Figure()
    names = {0: "fixed shift", 1: "optimal shift (n = 1)"}
    for method in (DEPTHNET, TINY, MOTION):
        trials = [Trial(method, n) for n in range(5) if Trial(method, n) in rows]
        if Trial(method, 0) not in trials:
            continue
        errors = [rows[trial]["errors"]["all"]["abs_rel"] for trial in trials]
        bar = go.Bar(name=method, x=[names.get(t.ranges, f"clusters, n = {t.ranges}") for t in trials])
        bar.update(y=_percent(errors), error_y=_whiskers(errors), marker={"color": COLOURS[method]})
        bar.update(hovertemplate="%{y:.1f} %")
        plot.add_trace(bar)
    plot.update_layout(barmode="group")
    plot.update_yaxes(title="|error| / true depth, %")
    return plot


def telemetry_plot(rows: Rows) -> go.Figure:
    """Error over a wrong speed: noise, bias, rate."""
    told: tuple[tuple[str, str, Callable[[Telemetry], bool]], ...] = (
        ("noise_m_s", "noise of a sample, m/s (20 Hz)", lambda log: not log.bias and log.rate_hz == 20),
        ("bias", "bias, share of the speed", lambda log: not log.noise_m_s),
        ("rate_hz", f"samples a second (noise {NOISY_SPEED_M_S:g} m/s)", _noisy),
    )
    plot = make_subplots(cols=3, shared_yaxes=True)
    trials = [trial for trial in wrong_speed() if trial in rows]
    for column, (name, title, belongs) in enumerate(told, start=1):
        chosen = sorted({getattr(t.telemetry, name): t for t in trials if belongs(t.telemetry)}.items())
        if len(chosen) < 2:
            continue
        line = _line([rows[t] for _, t in chosen], "motion-tiny, n = 2", MOTION, "all")
        line.update(x=[value for value, _ in chosen], showlegend=column == 1)
        line.update(hovertemplate="%{x}: %{y:.1f} %")
        plot.add_trace(line, row=1, col=column)
        plot.update_xaxes(title=title, col=column)
    plot.update_yaxes(title="|error| / true depth, %", rangemode="tozero", col=1)
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
            points.update(marker={"color": COLOURS[method], "size": 10}, hovertemplate="%{y:.0f} frames")
            plot.add_trace(points)
    plot.update_yaxes(title="shift, frames (0.033 m each)", rangemode="tozero")
    return plot


def fusion_plot(rows: Rows) -> go.Figure:
    """What the default fusion leaves out, and how right the rest is, beside the paper's."""
    plot = go.Figure()
    for trial in default_fusion():
        pair = [each for each in (replace(trial, fusion="paper"), trial) if each in rows]
        if len(pair) < 2:
            continue
        errors = [rows[each]["errors"]["all"] for each in pair]
        points = go.Scatter(name=rows[trial]["label"], mode="lines+markers")
        points.update(x=[100 * each["known"]["mean"] for each in errors])
        points.update(y=[100 * each["abs_rel"]["mean"] for each in errors])
        points.update(text=["paper", "default"], hovertemplate="%{text}: %{y:.1f} % on %{x:.0f} % of pixels")
        points.update(marker={"symbol": ["circle-open", "circle"], "size": 11})
        points.update(line={"color": COLOURS[trial.method], "dash": "dot", "width": 1})
        plot.add_trace(points)
    plot.update_xaxes(title="pixels with a depth, %", range=[0, 104])
    plot.update_yaxes(title="|error| / true depth of those, %", rangemode="tozero")
    return plot


def flicker_plot(rows: Rows) -> go.Figure:
    """Change of depth between frames beyond the motion."""
    trials = [t for t in (*figure(), *peers(), *default_fusion()) if t in rows and t.method != CONSTANT]
    trials.sort(key=lambda t: t.fusion != "paper")
    plot = go.Figure()
    for fusion, opacity in (("paper", 1.0), ("saturation", 0.55)):
        own = [t for t in trials if t.fusion == fusion]
        if own:
            changes = [rows[t]["flicker"] for t in own]
            bar = go.Bar(x=[rows[t]["label"] for t in own], y=_percent(changes), error_y=_whiskers(changes))
            bar.update(name=f"{fusion} fusion", hovertemplate="%{y:.1f} %")
            bar.update(marker={"color": [COLOURS[t.method] for t in own], "opacity": opacity})
            plot.add_trace(bar)
    plot.update_yaxes(title="median change from frame to frame, %")
    return plot


def confidence_plot(rows: Rows) -> go.Figure:
    """How often depth was right within 25 %, over what confidence said."""
    plot = go.Figure()
    dashes = {1: "dot", 2: "solid", 3: "dash", 4: "dash"}
    for trial in (t for t in default_fusion() if t in rows):
        tenths = [tenth for tenth in rows[trial]["confidence"]["tenths"] if tenth]
        line = go.Scatter(name=rows[trial]["label"], mode="lines+markers")
        line.update(x=[100 * tenth["said"] for tenth in tenths], y=[100 * tenth["right"] for tenth in tenths])
        line.update(line={"color": COLOURS[trial.method], "dash": dashes[trial.ranges]})
        line.update(hovertemplate="said %{x:.0f} %, right %{y:.0f} %")
        plot.add_trace(line)
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


def _line(rows: Sequence[Mapping[str, Any]], name: str, method: str, span: str) -> go.Scatter:
    errors = [row["errors"][span]["abs_rel"] for row in rows]
    line = go.Scatter(name=name, y=_percent(errors), error_y=_whiskers(errors), mode="lines+markers")
    return line.update(line={"color": COLOURS[method]}, marker={"size": 9})


def _percent(values: Iterable[Mapping[str, Any]]) -> list[float | None]:
    return [None if value["mean"] is None else 100 * value["mean"] for value in values]


def _whiskers(values: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """95 % intervals as error bars."""
    ends = [(value["low"] or 0, value["mean"] or 0, value["high"] or 0) for value in values]
    arrays = {
        "array": [100 * (high - mean) for _, mean, high in ends],
        "arrayminus": [100 * (mean - low) for low, mean, _ in ends],
    }
    return arrays | {"thickness": 1, "width": 3}


def _dash(trial: Trial) -> str:
    return "dot" if trial.derotate else "solid"


def _noisy(log: Telemetry) -> bool:
    return log.noise_m_s == NOISY_SPEED_M_S and not log.bias
