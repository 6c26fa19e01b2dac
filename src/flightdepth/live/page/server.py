"""The page's web server: the standard library's, one thread a connection, a bounded number of them.

Pictures are polled, each after the one before has arrived, so a slow browser gets fewer of them and nobody waits for
it: neither a sink nor the estimator ever touches a socket. A connection has SOCKET_TIMEOUT_S to ask, however often it
sends a byte, and as long to take an answer; where all places are taken, the one that has been asking longest goes.
"""

from __future__ import annotations

import json
import os
import re
import socket
import threading
import time
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from types import TracebackType
from typing import Any, ClassVar
from urllib.parse import parse_qs, urlsplit

from flightdepth.errors import BadInput
from flightdepth.live.metrics import CONTENT_TYPE, prometheus
from flightdepth.live.obstacle_sender import ObstacleFeed
from flightdepth.live.obstacles import Sectors
from flightdepth.live.page.pictures import Pictures
from flightdepth.live.page.state import Json, scale, state
from flightdepth.live.status import LiveResult, StatusSource
from flightdepth.outputs.palette import DepthScale

ADDRESS = re.compile(r"(?P<host>[^:]+|\[[0-9a-fA-F:]+\]):(?P<port>\d{1,5})")
# All addresses of this machine, and one of them that its browser can open.
ANY_ADDRESS = {"0.0.0.0": "127.0.0.1", "::": "::1"}
OWN_NAME = re.compile(r"(127\.0\.0\.1|localhost|\[::1\])?(:\d+)?")
MOST_REQUESTS = 24  # at a time: four browsers that take all they can
SOCKET_TIMEOUT_S = 5.0
LEAVE_S = 0.5  # a connection that was ended gives its place back at once, unless the machine stands still
NEWER_WITHIN_S = 1.0
STATIC = {
    "/": ("index.html", "text/html; charset=utf-8"),
    "/page.js": ("page.js", "text/javascript; charset=utf-8"),
    "/fan.js": ("fan.js", "text/javascript; charset=utf-8"),
    "/page.css": ("page.css", "text/css; charset=utf-8"),
}
PICTURES = {"/input.jpg": "input", "/depth.jpg": "depth"}
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self';"
    " img-src 'self' blob: data:",
    "X-Content-Type-Options": "nosniff",
}


class Page:
    """What is shown: a sink for results (`take`), and the engine's state whenever somebody looks."""

    def __init__(self, status: StatusSource, obstacles: ObstacleFeed | None = None) -> None:
        self._status, self._obstacles = status, obstacles
        self._scale = DepthScale(far_m=100.0)
        self.pictures = Pictures(self._scale)

    def take(self, result: LiveResult) -> None:
        """A sink: keep the newest result."""
        self.pictures.put(result)

    def state(self) -> Json:
        """What /state.json says."""
        return state(self._status(), self.pictures.result, self._obstacles)

    def scale(self) -> Json:
        """What /scale.json says."""
        return scale(self._scale)

    def metrics(self) -> str:
        """What /metrics says."""
        status, feed = self._status(), self._obstacles
        if feed is None:
            return prometheus(status)
        fresh = feed.fresh(status.stamp_ns)
        return prometheus(status, Sectors.unknown() if fresh is None else fresh.sectors)


class PageServer(ThreadingHTTPServer):
    """Serves a page at HOST:PORT from `start` to `close`; port 0 takes a free one (`address` says which)."""

    daemon_threads = True
    request_queue_size = 4 * MOST_REQUESTS  # beyond, a browser tries again after one second, or three

    def __init__(self, page: Page, address: str = "127.0.0.1:8080") -> None:
        host, port = parsed(address)
        self.allow_reuse_address = os.name == "posix"  # on Windows two programs would then share a port
        self.page = page
        self.closing = threading.Event()
        self.places = threading.BoundedSemaphore(MOST_REQUESTS)
        # Connections whose request is not whole yet, and since when: the longest first.
        self._asking: dict[socket.socket, float] = {}
        self._lock = threading.Lock()
        if ":" in host:
            self.address_family = socket.AF_INET6
        try:
            super().__init__((host, port), Handler)
        except OSError as error:
            got = f"{address} ({error.strerror or error})"
            raise BadInput(
                "--serve", expected="an address of this machine and a free port", got=got
            ) from error
        self._thread = threading.Thread(target=self.serve_forever, args=(0.1,), name="page", daemon=True)

    @property
    def address(self) -> str:
        """The page's URL, for a browser on this machine where it listens on all addresses."""
        host, port = str(self.server_address[0]), self.server_address[1]
        host = ANY_ADDRESS.get(host, host)
        name = f"[{host}]" if ":" in host else host
        return f"http://{name}:{port}/"

    @property
    def everywhere(self) -> bool:
        """Whether it listens on all addresses of this machine."""
        return str(self.server_address[0]) in ANY_ADDRESS

    @property
    def local(self) -> bool:
        """Whether only this machine can reach it."""
        return str(self.server_address[0]) in ("127.0.0.1", "::1")

    def start(self) -> None:
        """Serve on a thread of its own."""
        self._thread.start()

    def close(self) -> None:
        """Stop serving, connections that browsers keep open too; answers in hand end by their timeouts."""
        self.closing.set()
        if self._thread.is_alive():
            self.shutdown()
            self._thread.join(2.0)
        self._end_asking(before_s=time.monotonic())
        self.server_close()

    def __enter__(self) -> PageServer:
        self.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None = None,
        error: BaseException | None = None,
        trace: TracebackType | None = None,
    ) -> None:
        self.close()

    def asks(self, connection: socket.socket) -> None:
        """A request of this connection is awaited."""
        with self._lock:
            self._asking[connection] = time.monotonic()

    def asked(self, connection: socket.socket) -> bool:
        """Its request is whole, or will never be; False where the connection was ended meanwhile."""
        with self._lock:
            return self._asking.pop(connection, None) is not None

    def service_actions(self) -> None:
        """Ten times a second: end the connections that have been asking for too long."""
        self._end_asking(before_s=time.monotonic() - SOCKET_TIMEOUT_S)

    def _end_asking(self, *, before_s: float, most: int = MOST_REQUESTS) -> None:
        """End so many connections that have been asking since before a time, the longest first."""
        with self._lock:
            for connection, since_s in list(self._asking.items())[:most]:
                if since_s < before_s:
                    del self._asking[connection]
                    with suppress(OSError):  # it is gone already
                        connection.shutdown(socket.SHUT_RDWR)

    def process_request(self, request: Any, client_address: Any) -> None:
        """A thread for the connection; where there are too many, one that asks goes, else this one is closed."""
        if not self.places.acquire(blocking=False):
            self._end_asking(before_s=time.monotonic(), most=1)
            if not self.places.acquire(timeout=LEAVE_S):
                self.shutdown_request(request)
                return
        try:
            super().process_request(request, client_address)
        except BaseException:
            self.places.release()
            raise

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """The thread of one connection."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self.asked(request)
            self.places.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that went away is nobody's error."""


class Handler(BaseHTTPRequestHandler):
    """GET and HEAD of the page's own paths."""

    server: PageServer
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "flightdepth", ""
    timeout: ClassVar[float] = SOCKET_TIMEOUT_S

    def handle_one_request(self) -> None:
        """Read one request, and answer it."""
        self.server.asks(self.connection)
        super().handle_one_request()

    def do_HEAD(self) -> None:
        """As GET, without the body."""
        self.do_GET()

    def do_GET(self) -> None:
        """Answer one request."""
        if not self.server.asked(self.connection) or self.server.closing.is_set():
            self.close_connection = True
            return
        if not self._of_this_page():
            self._answer(HTTPStatus.FORBIDDEN, b"this page answers to its own address only\n", "text/plain")
            return
        asked = urlsplit(self.path)
        page = self.server.page
        if asked.path in STATIC:
            name, content_type = STATIC[asked.path]
            self._answer(HTTPStatus.OK, (files(__package__) / name).read_bytes(), content_type)
        elif asked.path in PICTURES:
            self._picture(PICTURES[asked.path], parse_qs(asked.query))
        elif asked.path == "/state.json":
            self._json(page.state())
        elif asked.path == "/scale.json":
            self._json(page.scale())
        elif asked.path == "/metrics":
            self._answer(HTTPStatus.OK, page.metrics().encode(), CONTENT_TYPE)
        else:
            self._answer(HTTPStatus.NOT_FOUND, b"no such page\n", "text/plain")

    def _of_this_page(self) -> bool:
        """Whether it was asked by its own name: a foreign site's name that leads here reads nothing."""
        if not self.server.local:
            return True
        return OWN_NAME.fullmatch(self.headers.get("Host", "")) is not None

    def _picture(self, name: str, query: dict[str, list[str]]) -> None:
        asked = query.get("after", ["0"])[0]
        after = int(asked) if re.fullmatch(r"\d{1,15}", asked) else 0
        found = self.server.page.pictures.jpeg(name, after, NEWER_WITHIN_S)
        if found is None:
            self._answer(HTTPStatus.NO_CONTENT, b"", None)
            return
        self._answer(HTTPStatus.OK, found[1], "image/jpeg", {"X-Number": str(found[0])})

    def _json(self, value: Json) -> None:
        self._answer(HTTPStatus.OK, json.dumps(value, allow_nan=False).encode(), "application/json")

    def _answer(
        self, status: HTTPStatus, body: bytes, content_type: str | None, more: dict[str, str] | None = None
    ) -> None:
        self.send_response(status)
        for name, value in {**HEADERS, **(more or {})}.items():
            self.send_header(name, value)
        if content_type is not None:
            self.send_header("Content-Type", content_type)
            self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    def log_message(self, format: str, *args: object) -> None:
        """Requests are not logged."""


def parsed(address: str) -> tuple[str, int]:
    """Host and port."""
    found = ADDRESS.fullmatch(address)
    if found is None or int(found["port"]) > 65535:
        raise BadInput("--serve", expected="HOST:PORT, like 127.0.0.1:8080", got=repr(address))
    return found["host"].strip("[]"), int(found["port"])
