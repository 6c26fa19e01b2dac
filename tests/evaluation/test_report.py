"""The report in a real browser: it needs nothing from outside, opens without errors, every plot is drawn."""

import re

import pytest

pytest.importorskip("plotly", reason="needs flightdepth[report]")

from range_parts import Flown

from flightdepth.evaluation.ranges_result import result
from flightdepth.evaluation.ranges_trials import CONSTANT, DEPTHNET, SWEEPS, Trial, all_trials
from flightdepth.evaluation.report import page
from flightdepth.evaluation.report_figures import plots
from flightdepth.evaluation.report_text import PLOT_TEXTS, name_of
from tests_browser import chromium


@pytest.fixture(scope="module")
def found():
    factors = {trial: 1.05 + 0.01 * k for k, trial in enumerate(all_trials(SWEEPS))}
    return result(Flown(factors))


@pytest.fixture(scope="module")
def html(found):
    return page(found)


def test_every_plot_has_its_words_and_the_other_way_round(found):
    assert list(plots(found)) == list(PLOT_TEXTS)


def test_a_plot_shows_the_figures(found):
    line = next(trace for trace in plots(found)["time"].data if trace.name == DEPTHNET)
    rows = [row for row in found["trials"] if row["label"] in (f"{DEPTHNET}, n = 1", f"{DEPTHNET}, n = 2")]
    shown = [100 * row["errors"]["all"]["abs_rel"]["mean"] for row in rows if row["trial"] == _plain(row)]
    assert list(line.y) == pytest.approx(shown)


def test_the_legend_tells_the_numbers_of_ranges_apart(found):
    """Once bars of one method were paler for fewer ranges, and all of them the same in the legend."""
    bars = [trace for trace in plots(found)["spans"].data if "direction estimated" not in trace.name]
    assert len({trace.marker.color for trace in bars}) == len(bars)


def _plain(row):
    return Trial(row["trial"]["method"], row["trial"]["ranges"]).facts


def test_times_and_errors_that_are_not_defined_are_left_out(found):
    """A trial without a predicted frame has neither; the plots ended in a TypeError."""
    row = next(row for row in found["trials"] if row["trial"] == Trial(DEPTHNET, 2).facts)
    nothing = {key: {"mean": None, "low": None, "high": None} for key in ("abs_rel", "delta", "known")}
    empty = row | {"predict_ms": None, "errors": dict.fromkeys(row["errors"], nothing)}
    drawn = plots(found | {"trials": [empty if each is row else each for each in found["trials"]]})
    line = next(trace for trace in drawn["time"].data if trace.name == DEPTHNET)
    assert list(line.x) == [10.0, None]
    constant = next(trace for trace in drawn["time"].data if trace.name == Trial(CONSTANT, 0).label)
    assert constant.x[1] > 10


def test_without_any_time_the_constant_has_no_line(found):
    timeless = [row | {"predict_ms": None} for row in found["trials"]]
    names = [trace.name for trace in plots(found | {"trials": timeless})["time"].data]
    assert DEPTHNET in names
    assert Trial(CONSTANT, 0).label not in names


def test_a_study_without_sweeps_has_the_plots_it_has_figures_for(found):
    quick = {trial.label for trial in all_trials()}
    few = [row for row in found["trials"] if row["trial"] == _plain(row) and row["label"] in quick]
    shown = plots(found | {"trials": few})
    assert {"time", "spans", "shifts", "flicker"} <= set(shown)
    assert not {"noise", "speed", "telemetry", "pairs", "fusion", "confidence"} & set(shown)


def test_every_trial_has_a_name_of_its_own(found):
    names = [name_of(row) for row in found["trials"]]
    assert len(set(names)) == len(names)


def test_nothing_is_fetched_and_text_is_escaped(html):
    outside = re.sub(r"<script.*?</script>", "", html, flags=re.DOTALL)
    assert not re.findall(r"(?:src|href)=['\"](?!data:)", outside)
    assert "a &lt;machine&gt; &amp; more" in outside
    assert "clamped-256" in outside


def test_it_opens_without_errors_and_every_plot_is_drawn(html, tmp_path):
    path = tmp_path / "ranges.html"
    path.write_text(html, encoding="utf-8")
    errors, asked = [], []
    with chromium() as browser:
        tab = browser.new_page(viewport={"width": 1280, "height": 900})
        tab.set_default_timeout(120_000)  # of a busy machine
        tab.on("pageerror", lambda error: errors.append(str(error)))
        tab.on(
            "console", lambda said: errors.append(said.text) if said.type in ("error", "warning") else None
        )
        tab.on("request", lambda request: asked.append(request.url))
        tab.goto(path.as_uri())
        tab.wait_for_function("document.querySelectorAll('.js-plotly-plot .main-svg').length >= 12")
        drawn = tab.evaluate(
            "[...document.querySelectorAll('.js-plotly-plot')].map(p => [p.id, p.querySelectorAll("
            "'.scatterlayer .trace, .barlayer .trace').length, p.getBoundingClientRect().height])"
        )
        pictures = tab.evaluate("[...document.images].every(i => i.complete && i.naturalWidth > 0)")
        wide = tab.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    assert errors == []
    assert [url for url in asked if not url.startswith(("file:", "data:"))] == []
    assert [name for name, _, _ in drawn] == [f"plot-{name}" for name in PLOT_TEXTS]
    assert all(traces > 0 and height > 300 for _, traces, height in drawn)
    assert pictures
    assert wide
