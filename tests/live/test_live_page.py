"""The page's server and pictures, without a browser: what is answered, and who never has to wait."""

from __future__ import annotations

import json
import socket
import threading
import urllib.error
import urllib.request
from contextlib import ExitStack, closing, suppress
from http.client import HTTPConnection

import cv2
import numpy as np
import pytest
from live_peers import lasts_s, until
from page_flights import HEIGHT, WIDTH, Flying, page_of

from flightdepth.errors import BadInput
from flightdepth.flight.turn_verdict import TurnVerdict
from flightdepth.flight.turned_focal import TurnedFocal
from flightdepth.live.obstacles import SECTORS
from flightdepth.live.page import PageServer
from flightdepth.live.page.server import MOST_REQUESTS, Handler, parsed


@pytest.fixture
def flying():
    with Flying() as flight:
        yield flight


def get(server: PageServer, path: str, headers: dict[str, str] | None = None):
    request = urllib.request.Request(server.address + path, headers=headers or {})
    with closing(urllib.request.urlopen(request, timeout=5)) as answer:
        return answer.status, dict(answer.headers), answer.read()


def test_pictures_are_of_the_newest_result_and_change(flying):
    flying.fly()
    _, first_headers, first = get(flying.server, "depth.jpg")
    flying.fly()
    _, headers, second = get(flying.server, f"depth.jpg?after={first_headers['X-Number']}")
    assert int(headers["X-Number"]) > int(first_headers["X-Number"]) and first != second
    picture = cv2.imdecode(np.frombuffer(second, np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape == (HEIGHT, WIDTH, 3)


def test_no_newer_picture_is_no_content(flying, monkeypatch):
    monkeypatch.setattr("flightdepth.live.page.server.NEWER_WITHIN_S", 0.05)
    flying.fly()
    number = get(flying.server, "input.jpg")[1]["X-Number"]
    assert get(flying.server, f"input.jpg?after={number}")[0] == 204


def test_state_says_health_ages_counts_and_the_fan(flying):
    flying.fly()
    told = json.loads(get(flying.server, "state.json")[2])
    assert told["health"]["state"] == "ok" and told["age"]["ms"] == 40.0
    assert told["frames"]["dropped"] == {"a newer one came first": 2}
    assert len(told["fan"]["sectors"]) == SECTORS
    kinds = {sector["kind"] for sector in told["fan"]["sectors"]}
    assert kinds == {"obstacle", "free", "unknown"}
    assert all((sector["m"] is None) == (sector["kind"] == "unknown") for sector in told["fan"]["sectors"])


def test_state_says_why_the_senders_clock_is_not_followed(flying):
    assert json.loads(get(flying.server, "state.json")[2])["age"]["distrusted"] is None
    flying.distrusted = "a wall clock was set by 3.0 s"
    assert json.loads(get(flying.server, "state.json")[2])["age"]["distrusted"] == flying.distrusted


def test_state_says_what_turns_say_of_the_lens(flying):
    assert json.loads(get(flying.server, "state.json")[2])["lens"] is None
    flying.lens = TurnVerdict(TurnedFocal(None, share=0.02), off=0.031)
    told = json.loads(get(flying.server, "state.json")[2])["lens"]
    assert told == {"denied": False, "agrees": True, "says": "agrees with its turns within 3%"}


def test_old_sectors_are_unknown_on_the_page_too(flying):
    flying.fly()
    flying.clock_ns += 2_000_000_000
    told = json.loads(get(flying.server, "state.json")[2])
    assert {sector["kind"] for sector in told["fan"]["sectors"]} == {"unknown"}


def test_state_says_why_nothing_is_known_of_obstacles(flying):
    flying.fly()
    assert json.loads(get(flying.server, "state.json")[2])["fan"]["lacking"] is None
    flying.feed.lacking = "obstacles are unknown: nobody tells the drone's heading"
    assert json.loads(get(flying.server, "state.json")[2])["fan"]["lacking"] == flying.feed.lacking


def test_old_sectors_are_in_no_metrics(flying):
    """The last obstacle stood there for ever after the video was lost."""
    flying.fly()
    flying.clock_ns += 2_000_000_000
    told = get(flying.server, "metrics")[2]
    assert b"flightdepth_obstacle_nearest_metres" not in told
    assert b"flightdepth_known_sectors 0\n" in told


def test_before_the_first_result_there_is_a_state_and_no_picture(flying, monkeypatch):
    monkeypatch.setattr("flightdepth.live.page.server.NEWER_WITHIN_S", 0.05)
    assert get(flying.server, "input.jpg")[0] == 204
    told = json.loads(get(flying.server, "state.json")[2])
    assert {sector["kind"] for sector in told["fan"]["sectors"]} == {"unknown"}


def test_on_windows_no_two_programs_share_a_port(flying, monkeypatch):
    """What lets a port be had again at once on Linux lets two servers have it there, and none complains."""
    monkeypatch.setattr("flightdepth.live.page.server.os.name", "nt")
    with closing(PageServer(flying.page, "127.0.0.1:0")) as server:
        assert not server.socket.getsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR)


def test_metrics_are_served(flying):
    flying.fly()
    _, headers, body = get(flying.server, "metrics")
    assert headers["Content-Type"].startswith("text/plain; version=0.0.4")
    assert b"flightdepth_age_seconds 0.04\n" in body and b"flightdepth_obstacle_nearest_metres" in body


def test_nothing_comes_from_elsewhere(flying):
    for path in ("", "page.js", "fan.js", "page.css"):
        _, headers, body = get(flying.server, path)
        assert "default-src 'none'" in headers["Content-Security-Policy"]
        assert b"https://" not in body and b"@import" not in body
        assert b"http://" not in body.replace(b"http://www.w3.org/2000/svg", b"")


def test_other_paths_and_names_are_refused(flying):
    for path, headers, status in (
        ("../pyproject.toml", {}, 404),
        ("server.py", {}, 404),
        ("state.json", {"Host": "evil.example:8080"}, 403),
    ):
        with pytest.raises(urllib.error.HTTPError) as refused:
            get(flying.server, path, headers)
        assert refused.value.code == status
        refused.value.close()


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1:8080", "[::1]:8080", "[::1]"])
def test_its_own_names_are_answered(flying, host):
    """`[::1]`, as a browser names port 80 there, was taken for another's name."""
    assert get(flying.server, "state.json", {"Host": host})[0] == 200


def trickling(server: PageServer) -> socket.socket:
    """A connection whose request never ends."""
    connection = socket.create_connection(server.server_address[:2], timeout=5)
    connection.sendall(b"GET /depth.jpg HTTP/1.1\r\nHost: 127.0.0.1\r\n")
    return connection


def test_browsers_that_never_read_hold_up_nobody(flying):
    """Idle connections took every place, and whoever came then was turned away; results are still taken at once."""
    with ExitStack() as idle:
        for _ in range(MOST_REQUESTS + 4):
            idle.enter_context(trickling(flying.server))
        assert lasts_s(lambda: [flying.fly() for _ in range(8)]) < 3.0
        assert [get(flying.server, "state.json")[0] for _ in range(3)] == [200] * 3


def test_a_browser_that_trickles_its_request_is_ended(flying, monkeypatch):
    """Each byte gave it another five seconds, so it held a thread and a place for ever."""
    monkeypatch.setattr("flightdepth.live.page.server.SOCKET_TIMEOUT_S", 0.3)
    with trickling(flying.server) as connection, pytest.raises(OSError):
        until(lambda: connection.sendall(b"X"), within_s=3)


def test_a_browser_that_never_takes_its_answers_is_ended(flying, monkeypatch):
    monkeypatch.setattr(Handler, "timeout", 0.3)
    flying.fly()
    with socket.create_connection(flying.server.server_address[:2], timeout=5) as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        connection.setblocking(False)

        def ask():
            with suppress(BlockingIOError):
                connection.send(b"GET /depth.jpg HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n" * 100)

        with pytest.raises(ConnectionError):
            until(ask, within_s=3)


@pytest.mark.parametrize("path", ["", "depth.jpg", "state.json", "metrics", "nothing"])
def test_head_is_answered_as_get_without_the_body(flying, path):
    """It was refused: 501, which a monitor takes for a page that is down."""
    flying.fly()
    with closing(HTTPConnection(*flying.server.server_address[:2], timeout=5)) as connection:
        lengths = []
        for method in ("HEAD", "GET"):
            connection.request(method, f"/{path}")
            with connection.getresponse() as answer:
                body = answer.read()
                lengths.append((answer.status, answer.headers["Content-Length"]))
                assert len(body) == (0 if method == "HEAD" else int(answer.headers["Content-Length"]))
    if path != "state.json":  # its times are of another length
        assert lengths[0] == lengths[1]


def test_a_result_costs_nothing_while_nobody_looks(flying, monkeypatch):
    made = []
    monkeypatch.setattr("flightdepth.live.page.pictures.jpeg", lambda *a: made.append(a) or b"")
    flying.fly()
    assert not made


def test_closing_ends_the_thread():
    before = threading.active_count()
    with PageServer(page_of(Flying.still()), "127.0.0.1:0") as server:
        assert get(server, "state.json")[0] == 200
    until(lambda: threading.active_count() <= before, within_s=3)


def test_on_all_addresses_it_tells_one_that_a_browser_can_open(flying):
    """It told http://0.0.0.0:8080/."""
    with PageServer(page_of(Flying.still()), "0.0.0.0:0") as server:
        assert server.address == f"http://127.0.0.1:{server.server_address[1]}/"
        assert server.everywhere and not server.local
        assert get(server, "state.json")[0] == 200
    assert not flying.server.everywhere


@pytest.mark.parametrize("address", ["8080", "localhost", "127.0.0.1:", "127.0.0.1:99999", "a:b:1"])
def test_an_address_is_checked(address):
    with pytest.raises(BadInput, match="--serve"):
        parsed(address)


def test_a_port_in_use_is_one_clear_line(flying):
    host, port = flying.server.server_address[:2]
    with pytest.raises(BadInput, match=r"free port, got 127\.0\.0\.1"):
        PageServer(page_of(Flying.still()), f"{host}:{port}")
