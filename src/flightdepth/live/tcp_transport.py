"""A TCP connection to an autopilot or a router: bytes in and out.

pymavlink's own waits two minutes for a host that does not answer, and for ever for one that went without a word, as
where the radio between is lost.
"""

from __future__ import annotations

import select
import socket
import time

OPEN_S, SILENT_S = 5.0, 5.0  # an autopilot's heartbeat comes each second
WAITING_BYTES = 4096  # what waits in a connection is old when it arrives


class TcpTransport:
    """Connected to `host` and `port` from birth to `close`; what fails raises OSError."""

    def __init__(self, host: str, port: int) -> None:
        self._socket = socket.create_connection((host, port), timeout=OPEN_S)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, WAITING_BYTES)
        self._heard_s = time.monotonic()

    def select(self, timeout_s: float) -> bool:
        """Whether something can be received; TimeoutError where nothing was for SILENT_S."""
        ready = bool(select.select([self._socket], [], [], timeout_s)[0])
        now_s = time.monotonic()
        if ready:
            self._heard_s = now_s
        elif now_s - self._heard_s > SILENT_S:
            raise TimeoutError(f"nothing came for {SILENT_S:g} s")
        return ready

    def recv(self, most: int) -> bytes:
        """At most so many bytes of those that came."""
        data = self._socket.recv(most)
        if not data:
            raise ConnectionError("the peer closed the connection")
        return data

    def write(self, data: bytes) -> None:
        """Send all of it, or raise: half a message would be lost without a word."""
        if self._socket.send(data) < len(data):
            raise BlockingIOError("the peer takes no more")

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()
