"""The multi-range study as one HTML page that needs nothing else: verdicts, plots, pictures, table, settings."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

from plotly.offline import get_plotlyjs

from flightdepth.evaluation.report_figures import plots
from flightdepth.evaluation.report_pictures import gallery
from flightdepth.evaluation.report_style import STYLE
from flightdepth.evaluation.report_text import PLOT_TEXTS, lead, settings, table, verdicts

PLOT_SETTINGS = {"displayModeBar": False, "responsive": True}  # its buttons would lie over the legend


def page(found: Mapping[str, Any]) -> str:
    """HTML of a result of `ranges_result`; the plots' library is inside, so the file opens anywhere."""
    figures = {
        name: plot.to_html(
            full_html=False, include_plotlyjs=False, div_id=f"plot-{name}", config=PLOT_SETTINGS
        )
        for name, plot in plots(found).items()
    }
    drawn = "".join(_section(*PLOT_TEXTS[name], html) for name, html in figures.items())
    parts = [
        f"<header>{lead(found)}</header>",
        _section("What holds", "", verdicts(found)),
        drawn,
        _section("Pictures", "The last frame of some sequences, n = 2, noise N0 = 0.001.", gallery(found)),
        _section("All figures", "Means over scenes; hover the headings.", table(found)),
        _section("Settings", "", settings(found)),
    ]
    title = "flightdepth: several ranges"
    return (
        f"<!doctype html><html lang='en'><head><meta charset='utf-8'><title>{escape(title)}</title>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<link rel='icon' href='data:,'><style>{STYLE}</style><script>{get_plotlyjs()}</script></head>"
        f"<body><main>{''.join(parts)}</main></body></html>"
    )


def _section(title: str, text: str, body: str) -> str:
    said = f"<p>{escape(text)}</p>" if text else ""
    return f"<section><h2>{escape(title)}</h2>{said}{body}</section>" if body else ""
