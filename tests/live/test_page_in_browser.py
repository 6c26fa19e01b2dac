"""The page in a real browser: no console errors, pictures that change, the fan drawn, health shown."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from page_flights import Flying, page_of

from flightdepth.flight.turn_verdict import TurnVerdict
from flightdepth.flight.turned_focal import TurnedFocal
from flightdepth.live.obstacles import SECTORS
from flightdepth.live.page import PageServer
from flightdepth.live.status import Health, State
from tests_browser import chromium


class Watched:
    """A page in the browser, with what its console said."""

    def __init__(self, flying: Flying, tab) -> None:
        self.flying, self.tab = flying, tab
        self.complaints: list[str] = []
        self.requests: list[str] = []
        tab.on(
            "console",
            lambda message: message.type in ("error", "warning") and self.complaints.append(message.text),
        )
        tab.on("pageerror", lambda error: self.complaints.append(str(error)))
        tab.on("request", lambda request: self.requests.append(request.url))
        tab.goto(flying.server.address)

    def until(self, script: str, timeout_s: float = 10.0) -> None:
        """Fly on until the script is true in the page."""
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            self.flying.fly()
            if self.tab.evaluate(script):
                return
            time.sleep(0.05)
        pytest.fail(f"never became true: {script}")


@pytest.fixture(scope="module")
def browser() -> Iterator:
    with chromium() as started:
        yield started


@pytest.fixture
def watched(browser) -> Iterator[Watched]:
    with Flying() as flying:
        flying.fly()
        tab = browser.new_page(viewport={"width": 1440, "height": 860})
        yield Watched(flying, tab)
        tab.close()


def test_pictures_change_and_nobody_complains(watched):
    for name in ("input", "depth"):
        watched.until(f"document.getElementById('{name}').naturalWidth === 320")
        first = watched.tab.evaluate(f"Number(document.getElementById('{name}').dataset.number)")
        watched.until(f"Number(document.getElementById('{name}').dataset.number) > {first}")
    assert watched.complaints == []


def test_only_its_own_server_is_asked(watched):
    watched.until("document.querySelectorAll('#sectors g').length > 0")
    own = watched.flying.server.address
    assert watched.requests
    assert all(url.startswith((own, f"blob:{own}", "data:")) for url in watched.requests)


def test_the_fan_is_drawn_unknown_unlike_free(watched):
    watched.until(f"document.querySelectorAll('#sectors g').length === {SECTORS}")
    count = "document.querySelectorAll('#sectors g[data-kind={}]').length"
    kinds = {
        kind: watched.tab.evaluate(count.format(kind)) for kind in ("obstacle", "free", "unknown", "clear")
    }
    assert kinds["obstacle"] > 3 and kinds["free"] > 3 and kinds["unknown"] > 40
    fill = "getComputedStyle(document.querySelector('#sectors g[data-kind={}] path')).fill"
    fills = [watched.tab.evaluate(fill.format(kind)) for kind in ("free", "unknown")]
    assert fills[0] != fills[1] and "hatch" in fills[1]
    assert re.fullmatch(r"\d+\.\d m", watched.tab.inner_text("#nearest"))
    assert watched.tab.inner_text("#nearest-where") == "straight ahead"


def test_an_unknown_fan_is_no_fan_without_obstacles(watched):
    """Found in use: nobody told the heading, health told of a slow machine, and the fan said "no obstacle known"."""
    watched.flying.clock_ns += 2_000_000_000  # nothing newer than that
    watched.tab.locator("#nearest-where", has_text="every direction is unknown").wait_for()
    watched.flying.feed.lacking = "obstacles are unknown: nobody tells the drone's heading"
    watched.tab.locator("#nearest-where", has_text=watched.flying.feed.lacking).wait_for()


def test_health_is_shown_with_its_reason(watched):
    watched.until("document.getElementById('state').textContent === 'ok'")
    watched.flying.health = Health(State.DEGRADED, "telemetry is 1.2 s late", 0)
    watched.until("document.getElementById('state').textContent === 'degraded'")
    assert watched.tab.inner_text("#reason") == "telemetry is 1.2 s late"
    assert watched.tab.evaluate("document.body.dataset.state") == "degraded"


def test_figures_are_those_of_the_engine(watched):
    watched.until("document.getElementById('age').textContent === '40 ms'")
    assert watched.tab.inner_text("#age-more") == "95 % under 52 ms, since reception"
    assert watched.tab.inner_text("#ranges-more") == "0.31 m in 3, 1.42 m in 12 frames"
    assert watched.tab.inner_text("#dropped").startswith("2 ")
    assert watched.tab.inner_text("#telemetry") == "30 Hz"


def test_whether_turns_deny_the_lens_is_shown(watched):
    watched.until("document.getElementById('lens').textContent === '–'")
    watched.flying.lens = TurnVerdict(
        TurnedFocal(None), doubt="focal length 390 px, where the turns tell 300"
    )
    watched.until("document.getElementById('lens').textContent === 'denied by its turns'")
    assert watched.tab.get_attribute("#lens", "title").startswith("focal length 390 px")


def test_why_the_senders_clock_is_not_followed_is_shown(watched):
    watched.flying.distrusted = "a wall clock was set by 3.0 s"
    watched.until(
        "document.getElementById('age-more').textContent.endsWith('reception: a wall clock was set by 3.0 s')"
    )


def ended(watched: Watched) -> None:
    """The server is gone, and the page has found out."""
    watched.flying.server.close()
    deadline = time.monotonic() + 15
    while watched.tab.inner_text("#state").lower() != "unreachable" and time.monotonic() < deadline:
        watched.tab.wait_for_timeout(100)
    assert watched.tab.inner_text("#state").lower() == "unreachable"


def test_a_server_that_died_is_said(watched):
    watched.until("document.getElementById('state').textContent === 'ok'")
    ended(watched)


def test_a_server_that_died_leaves_nothing_that_looks_free(watched):
    """Found in use: the fan of the last moment stayed as bright as ever, with free sectors and a nearest obstacle."""
    watched.until("document.querySelectorAll('#sectors g[data-kind=free]').length > 3")
    ended(watched)
    assert watched.tab.locator("#sectors g[data-kind=unknown]").count() == SECTORS
    assert watched.tab.inner_text("#nearest") == "–"
    assert float(watched.tab.evaluate("getComputedStyle(document.querySelector('.tiles')).opacity")) < 0.5


def test_without_obstacles_no_empty_fan_takes_the_pictures_room(browser):
    with PageServer(page_of(Flying.still()), "127.0.0.1:0") as server:
        tab = browser.new_page(viewport={"width": 1440, "height": 860})
        tab.goto(server.address)
        tab.locator("#nearest", has_text="off").wait_for()
        pictures = tab.locator(".pictures").bounding_box()
        shown = tab.locator("#fan").is_visible()
        tab.close()
    assert not shown
    assert pictures["width"] > 1300


def test_one_reason_for_dropped_frames_needs_no_second_count(watched):
    watched.until("document.getElementById('dropped').textContent.startsWith('2 ')")
    assert watched.tab.inner_text("#dropped-more") == "a newer one came first"


def test_several_reasons_for_dropped_frames_have_their_counts(watched):
    watched.flying.dropped = {"a newer one came first": 2, "too late": 7}
    watched.until("document.getElementById('dropped').textContent.startsWith('9 ')")
    assert watched.tab.inner_text("#dropped-more") == "7: too late; 2: a newer one came first"


@pytest.mark.parametrize("scheme", ["dark", "light"])
def test_it_can_be_read_in_the_sun_too(watched, scheme):
    """Light where the browser asks for it; each text four and a half times as light or dark as its ground (WCAG AA)."""
    watched.tab.emulate_media(color_scheme=scheme)
    watched.until("document.querySelectorAll('#fan text').length > 0")
    ground = luminance(watched.tab, "body", "backgroundColor")
    assert ground > 0.8 if scheme == "light" else ground < 0.05
    for text, behind in (("dt", "body"), ("#state", "body"), (".tile h2", ".tile"), ("#fan text", "#fan")):
        shade = luminance(watched.tab, text, "fill" if text == "#fan text" else "color")
        dark, light = sorted((shade, luminance(watched.tab, behind, "backgroundColor")))
        assert (light + 0.05) / (dark + 0.05) > 4.5, text


def luminance(tab, selector: str, colour: str) -> float:
    """Relative luminance 0..1 of a computed colour (WCAG 2)."""
    told = tab.evaluate(f"getComputedStyle(document.querySelector('{selector}')).{colour}")
    red, green, blue = (int(value) / 255 for value in re.findall(r"\d+", told)[:3])
    linear = [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in (red, green, blue)]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_the_lamp_stands_beside_the_first_line(watched):
    """Found in use: beside a reason of three lines it hung below the state's word."""
    watched.flying.health = Health(State.DEGRADED, "the machine is too slow: 4.8 results a second " * 4, 0)
    watched.until("document.getElementById('state').textContent === 'degraded'")
    lamp, state = (watched.tab.locator(name).bounding_box() for name in (".lamp", "#state"))
    assert state["y"] < lamp["y"] and lamp["y"] + lamp["height"] < state["y"] + state["height"]


def test_it_fits_a_telephone(watched, tmp_path: Path):
    watched.tab.set_viewport_size({"width": 400, "height": 800})
    watched.until("document.querySelectorAll('#sectors g').length > 0")
    assert watched.tab.evaluate("document.documentElement.scrollWidth") <= 400


def test_a_long_reason_has_the_width_of_a_telephone(watched):
    """Found in use: it stood in a column of one word a line beside the state, and pushed the page out of the screen."""
    watched.tab.set_viewport_size({"width": 390, "height": 844})
    watched.flying.health = Health(State.DEGRADED, "the machine is too slow: 6.7 results a second of 30", 0)
    watched.until("document.getElementById('state').textContent === 'degraded'")
    assert watched.tab.locator("#reason").bounding_box()["width"] > 300
    ended(watched)
    assert watched.tab.evaluate("document.documentElement.scrollWidth") <= 390
