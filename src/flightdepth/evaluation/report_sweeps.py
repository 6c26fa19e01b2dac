"""The plots of what the study varies: noise, speed, rate of the log, how pairs are chosen, how many ranges."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from flightdepth.evaluation.ranges_trials import (
    CONSTANT,
    DEPTHNET,
    FIGURE,
    FLOW,
    MOTION,
    NOISES_RAD,
    NOISY_SPEED_M_S,
    TINY,
    Telemetry,
    Trial,
    log_rates,
    orientation_noise,
    wrong_speed,
)
from flightdepth.evaluation.report_marks import COLOURS, Rows, line, percent, whiskers

ERROR = "|error| / true depth, %"


def noise_plot(rows: Rows) -> go.Figure:
    """Error over orientation noise, all depths and far ones."""
    plot = make_subplots(cols=2, subplot_titles=["all depths", "far, 50-150 m"])
    lines: dict[str, list[Trial]] = {}
    for trial in (t for t in orientation_noise() if t in rows):
        lines.setdefault(_flown(trial), []).append(trial)
    lines = {name: trials for name, trials in lines.items() if len(trials) > 1}
    for column, span in enumerate(("all", "far"), start=1):
        for name, trials in lines.items():
            drawn = line([rows[t] for t in trials], name, trials[0].method, span)
            drawn.update(x=[f"{t.noise_rad:g}" for t in trials], showlegend=column == 1, legendgroup=name)
            drawn.update(hovertemplate="N0 = %{x}: %{y:.1f} %")
            drawn.update(line={"dash": "dot" if trials[0].derotate else "solid"})
            plot.add_trace(drawn, row=1, col=column)
        _add_constant(plot, column, rows, span)
    plot.update_xaxes(title="orientation noise N0, rad", type="category")
    plot.update_yaxes(title=ERROR, rangemode="tozero", col=1)
    plot.update_yaxes(rangemode="tozero", col=2)
    return plot


def _add_constant(plot: go.Figure, column: int, rows: Rows, span: str) -> None:
    """The best constant depth, which no noise touches, across a panel that shows something."""
    row, noises = rows.get(Trial(CONSTANT, 0)), [f"{noise:g}" for noise in NOISES_RAD]
    shown = {x for trace in plot.data for x in trace.x}
    if row is None or not shown:
        return
    level = percent([row["errors"][span]["abs_rel"]])[0]
    across = go.Scatter(name=row["label"], x=[x for x in noises if x in shown], mode="lines")
    across.update(y=[level] * len(across.x), showlegend=column == 1, legendgroup=CONSTANT)
    across.update(line={"dash": "dot", "color": COLOURS[CONSTANT]}, hovertemplate="%{y:.1f} %")
    plot.add_trace(across, row=1, col=column)


def _flown(trial: Trial) -> str:
    return f"{trial.label}, default fusion" if trial.fusion != "paper" else trial.label


def pair_plot(rows: Rows) -> go.Figure:
    """How pairs are chosen: a fixed shift, the optimal one, clusters."""
    plot = go.Figure()
    names = {0: "fixed shift", 1: "optimal shift (n = 1)", 2: "k-means ranges (n = 2)"}
    for method in (*FIGURE, FLOW):
        trials = [Trial(method, n) for n in names if Trial(method, n) in rows]
        if Trial(method, 0) not in trials:
            continue
        errors = [rows[trial]["errors"]["all"]["abs_rel"] for trial in trials]
        bar = go.Bar(name=method, x=[names[t.ranges] for t in trials], y=percent(errors))
        bar.update(error_y=whiskers(errors), marker={"color": COLOURS[method]}, hovertemplate="%{y:.1f} %")
        plot.add_trace(bar)
    plot.update_layout(barmode="group")
    plot.update_yaxes(title=ERROR)
    return plot


def range_plot(rows: Rows) -> go.Figure:
    """Error over the number of ranges; dotted, the best of the ranges at each pixel, chosen in hindsight."""
    plot = go.Figure()
    for method in FIGURE:
        trials = [Trial(method, n) for n in range(1, 7) if Trial(method, n) in rows]
        if all(trial.ranges < 4 for trial in trials) or len(trials) < 2:
            continue
        counts = [trial.ranges for trial in trials]
        drawn = line([rows[t] for t in trials], f"{method}, fused", method, "all")
        plot.add_trace(drawn.update(x=counts, hovertemplate="n = %{x}: %{y:.1f} %", legendgroup=method))
        best = go.Scatter(name=f"{method}, best range in hindsight", x=counts, mode="lines+markers")
        best.update(y=percent([rows[t]["best_abs_rel"]["all"] for t in trials]), legendgroup=method)
        best.update(line={"color": COLOURS[method], "dash": "dot"}, hovertemplate="n = %{x}: %{y:.1f} %")
        plot.add_trace(best)
    plot.update_xaxes(title="ranges n", dtick=1)
    plot.update_yaxes(title=ERROR, rangemode="tozero")
    return plot


def speed_plot(rows: Rows) -> go.Figure:
    """Error over a wrong speed: its bias, and its noise."""
    trials = [trial for trial in wrong_speed() if trial in rows]
    plot = make_subplots(cols=2, shared_yaxes=True)
    biased = [trial for trial in trials if not trial.telemetry.noise_m_s]
    noisy = [trial for trial in trials if not trial.telemetry.bias]
    _over(plot, 1, rows, biased, lambda log: 100 * log.bias)
    _over(plot, 2, rows, noisy, lambda log: log.noise_m_s)
    plot.update_xaxes(title="bias of the speed, %", col=1)
    plot.update_xaxes(title="noise of a sample, m/s an axis", col=2)
    plot.update_yaxes(title=ERROR, rangemode="tozero", col=1)
    return plot


def rate_plot(rows: Rows) -> go.Figure:
    """Error over how often a noisy log tells the speed."""
    plot = make_subplots(cols=1)
    _over(plot, 1, rows, [t for t in log_rates() if t in rows], lambda log: log.rate_hz)
    plot.update_xaxes(title=f"samples a second, each with noise {NOISY_SPEED_M_S:g} m/s", type="category")
    plot.update_yaxes(title=ERROR, rangemode="tozero")
    return plot


def _over(
    plot: go.Figure,
    column: int,
    rows: Rows,
    trials: Sequence[Trial],
    setting: Callable[[Telemetry], float],
) -> None:
    """A line for each method over a setting of its log."""
    for method in (DEPTHNET, TINY, MOTION, FLOW):
        own = sorted((t for t in trials if t.method == method), key=lambda t: setting(t.telemetry))
        if len(own) < 2:
            continue
        drawn = line([rows[t] for t in own], f"{method}, n = 1", method, "all")
        drawn.update(x=[setting(t.telemetry) for t in own], showlegend=column == 1, legendgroup=method)
        plot.add_trace(drawn.update(hovertemplate="%{x:g}: %{y:.1f} %"), row=1, col=column)
