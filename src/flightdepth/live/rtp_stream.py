"""Pictures of an RTP stream that is sent to a port of this machine; RTCP comes to the next port."""

from __future__ import annotations

import errno
import ipaddress
import selectors
import socket
import threading
import time
from collections import Counter
from collections.abc import Iterator
from fractions import Fraction
from typing import Any
from urllib.parse import urlsplit

import av

from flightdepth.flight.records import NS_PER_S
from flightdepth.live.backlog import Backlog
from flightdepth.live.picture_clock import PictureClock
from flightdepth.live.rtp import CLOCK_HZ, Continuity, Reorder, RtpPacket, SenderReport, Unit, Units, begins
from flightdepth.live.sound_decoder import SoundDecoder
from flightdepth.live.video_address import codec_of
from flightdepth.live.video_stream import BEHIND, READ_S, Picture, StreamEnded

PAYLOAD_TYPE = 96
BUFFER_BYTES = 1 << 21  # a key frame comes in one burst
BIGGEST = 65_536
CHANGED_NS = NS_PER_S // 2  # another sender is heard when the first was silent for so long
LOOK_S = 0.2
NO_PARAMETERS = (
    "pictures before the first parameter sets, which are to precede each key frame (config-interval=-1)"
)


class RtpStream:
    """An open port; iterate `pictures()` once, then `close()`. What is left out is counted in `counts`.

    `target`: rtp://HOST:PORT[?codec=h265], HOST an address of this machine or a multicast group.
    """

    def __init__(self, target: str, counts: Counter[str]) -> None:
        parts = urlsplit(target)
        codec = codec_of(target)
        self._counts, self._h265 = counts, codec == "hevc"
        self._decoder = SoundDecoder(av.CodecContext.create(codec, "r"), counts)
        self._continuity = Continuity()
        self._reorder, self._units = Reorder(), Units(h265=self._h265)
        self._source: int | None = None
        self._heard_ns = 0
        self._report: tuple[int, int] | None = None
        self._begun = False
        self._backlog, self._waited_ns = Backlog(), 0  # since the last whole picture
        assert parts.port is not None
        host = parts.hostname or "0.0.0.0"
        self._selector = selectors.DefaultSelector()
        self._sockets: list[socket.socket] = []
        try:
            self._data, self._control = self._listen(host, parts.port), self._listen(host, parts.port + 1)
        except (OSError, StreamEnded):
            self.close()
            raise

    def close(self) -> None:
        """Close the ports."""
        self._selector.close()
        for each in self._sockets:
            each.close()

    def pictures(self, clock: PictureClock, stop: threading.Event) -> Iterator[Picture]:
        """Pictures as they come, stamped by `clock`; raises StreamEnded or TimeoutError when it breaks.

        The socket keeps what is not read yet: where it piles up, it is thrown away up to the newest.
        """
        for packet, came_ns, lost in self._packets(stop):
            if lost:
                self._counts["gaps in the RTP packets"] += 1
            for unit in self._units.add(packet, came_ns, lost=lost):
                if self._tell(clock, unit):
                    self._counts[BEHIND] += 1
                    self._decoder.skip_to_key_frame()
                    continue
                for decoded in self._decoded(unit):
                    yield Picture(decoded, *clock.stamp(nanoseconds(decoded.pts)))

    def _decoded(self, unit: Unit) -> Iterator[Any]:
        if unit.data is None:
            self._decoder.damage(unit.ticks)
            return
        self._begun = self._begun or begins(unit.data, h265=self._h265)
        if not self._begun:  # without parameter sets a decoder finds only damage
            self._counts[NO_PARAMETERS] += 1
            return
        packet = av.Packet(unit.data)
        packet.pts = packet.dts = unit.ticks
        packet.time_base = Fraction(1, CLOCK_HZ)
        yield from self._decoder.decode(packet)

    def _packets(self, stop: threading.Event) -> Iterator[tuple[RtpPacket, int, bool]]:
        heard_s = time.monotonic()
        while not stop.is_set():
            asked_ns = time.monotonic_ns()
            ready = [key.fileobj for key, _ in self._selector.select(LOOK_S)]
            now_ns = time.monotonic_ns()
            self._waited_ns += now_ns - asked_ns
            if not ready and time.monotonic() - heard_s > READ_S:
                raise TimeoutError("nothing came in time")
            if self._control in ready:
                self._take_report(self._control.recv(BIGGEST))
            if self._data in ready:
                packet = RtpPacket.parse(self._data.recv(BIGGEST))
                if packet is not None and self._is_ours(packet, now_ns):
                    yield from self._reorder.add(packet, now_ns)
                    heard_s = time.monotonic()

    def _is_ours(self, packet: RtpPacket, now_ns: int) -> bool:
        """The first sender counts, until it was silent for CHANGED_NS and another is heard, or began anew itself."""
        if packet.kind != PAYLOAD_TYPE:
            self._counts[f"RTP packets of payload type {packet.kind}, not {PAYLOAD_TYPE},"] += 1
            return False
        if self._source is None:
            self._source = packet.source
        if packet.source != self._source:
            if now_ns - self._heard_ns > CHANGED_NS:
                raise StreamEnded("another sender began")
            self._counts["RTP packets of another sender"] += 1
            return False
        self._heard_ns = now_ns
        strays = self._continuity.strays(packet, now_ns)
        if strays > 1:  # decoder, order and clock know the stream before it: a new connection has new ones
            raise StreamEnded("the sender began anew")
        if strays:
            self._counts["RTP packets that do not go on from those before"] += 1
        return strays == 0

    def _take_report(self, data: bytes) -> None:
        report = SenderReport.parse(data)
        # The first may come before the pictures.
        if report is not None and self._source in (None, report.source):
            self._report = nanoseconds(self._units.unwrapped(report.timestamp)), report.wall_ns

    def _tell(self, clock: PictureClock, unit: Unit) -> bool:
        """Let the clock hear of a picture; whether it lay in the socket's buffer, and is to be thrown away."""
        own_ns, sender_wall_ns = nanoseconds(unit.ticks), None
        if self._report is not None:
            sender_wall_ns = self._report[1] + own_ns - self._report[0]
        now_ns, self._waited_ns, waited_ns = time.monotonic_ns(), 0, self._waited_ns
        self._backlog.read(now_ns, waited_ns)
        clock.packet(
            own_ns,
            unit.came_ns,
            sender_wall_ns=sender_wall_ns,
            wall_now_ns=time.time_ns() - (now_ns - unit.came_ns),
            queued=self._backlog.hurried,
        )
        return self._backlog.skips(clock.late_ns(own_ns, unit.came_ns))

    def _listen(self, host: str, port: int) -> socket.socket:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        listening = socket.socket(family, kind, protocol)
        self._sockets.append(listening)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
        group = ipaddress.ip_address(address[0])
        if group.is_multicast:  # all who listen hear it; else the last one would take all from the others
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind(address)
        except OSError as error:
            if error.errno != errno.EADDRNOTAVAIL:
                raise
            if not group.is_multicast:
                raise StreamEnded(f"{host} is no address of this machine, where pictures come to") from error
            listening.bind(("", port))  # Windows binds to no group: there all that comes to the port is heard
        if group.is_multicast and group.version == 4:
            request = group.packed + bytes(4)
            listening.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, request)
        self._selector.register(listening, selectors.EVENT_READ)
        return listening


def nanoseconds(ticks: int) -> int:
    """Of a 90 kHz clock."""
    return ticks * NS_PER_S // CLOCK_HZ
