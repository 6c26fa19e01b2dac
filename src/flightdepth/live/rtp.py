"""RTP packets to whole pictures, each given when its last packet is there.

FFmpeg's parser gives a picture when the next one begins: a thirtieth of a second late at 30 frames/s, here measured
as 35 ms. The marker bit of RTP says which packet is a picture's last, so nothing has to be waited for.
RTP: RFC 3550; H.264 in it: RFC 6184; H.265: RFC 7798. Pure: bytes and times come in, units go out.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass

from flightdepth.flight.records import NS_PER_S

CLOCK_HZ = 90_000
NTP_UNIX_S = 2_208_988_800  # from 1900, where NTP begins, to 1970
START_CODE = b"\x00\x00\x00\x01"
MOST_HELD = 16  # packets that wait for one before them
MOST_BYTES = 64 << 20  # of one picture; a sender that marks no picture's end would fill the memory
LONGEST_HELD_NS = 40_000_000
MAX_DROPOUT, MAX_MISORDER = 3000, 100  # packets lost, and late, of one sender: RFC 3550, A.1
MAX_STEP_NS = 2 * NS_PER_S  # a stream's time that steps back, or ahead of our clock, by more is another's
H264_AGGREGATE, H264_FRAGMENT = 24, 28  # STAP-A, FU-A
H265_AGGREGATE, H265_FRAGMENT = 48, 49


@dataclass(frozen=True)
class RtpPacket:
    """One packet: its place, its picture's time (90 kHz, 32 bits), whether it is that picture's last."""

    source: int
    kind: int
    sequence: int
    timestamp: int
    marker: bool
    payload: bytes

    @classmethod
    def parse(cls, data: bytes) -> RtpPacket | None:
        """RFC 3550, 5.1; None for what is none."""
        if len(data) < 12 or data[0] >> 6 != 2:
            return None
        first, second, sequence, timestamp, source = struct.unpack_from(">BBHII", data)
        start, end = 12 + 4 * (first & 15), len(data)
        if first & 0x10:  # an extension
            if end < start + 4:
                return None
            start += 4 + 4 * int(struct.unpack_from(">H", data, start + 2)[0])
        if first & 0x20:  # padding, whose last byte says how much
            end -= data[-1]
        if start >= end:
            return None
        return cls(source, second & 127, sequence, timestamp, bool(second & 128), data[start:end])


@dataclass(frozen=True)
class SenderReport:
    """RTCP: what the sender's wall clock (ns since 1970) said at a time of the stream (90 kHz, 32 bits)."""

    source: int
    wall_ns: int
    timestamp: int

    @classmethod
    def parse(cls, data: bytes) -> SenderReport | None:
        """RFC 3550, 6.4.1, the first of a compound packet; None for anything else."""
        if len(data) < 28 or data[0] >> 6 != 2 or data[1] != 200:
            return None
        source, seconds, fraction, timestamp = struct.unpack_from(">IIII", data, 4)
        wall_ns = (seconds - NTP_UNIX_S) * NS_PER_S + (fraction * NS_PER_S >> 32)
        return cls(source, wall_ns, timestamp)


@dataclass(frozen=True)
class Unit:
    """A picture as Annex B bytes, its time (90 kHz, unwrapped), when its first packet came; None: not whole."""

    data: bytes | None
    ticks: int
    came_ns: int


class Continuity:
    """Tells a sender that began anew, with the same source number: its packets go on anywhere (RFC 3550, A.1).

    Numbers alone would not do: one in twenty restarts lands within MAX_DROPOUT.
    """

    def __init__(self) -> None:
        self._newest: tuple[RtpPacket, int] | None = None
        self._stray: RtpPacket | None = None
        self._strays = 0

    def strays(self, packet: RtpPacket, now_ns: int) -> int:
        """How many in a row do not go on from those before, this the last: 0 for one that does, 2 for a new stream."""
        if not self._goes_on(packet, now_ns):
            follows = self._stray is not None and packet.sequence == (self._stray.sequence + 1) & 0xFFFF
            self._stray, self._strays = packet, self._strays + 1 if follows else 1
            return self._strays
        self._stray, self._strays = None, 0
        return 0

    def _goes_on(self, packet: RtpPacket, now_ns: int) -> bool:
        before, before_ns = self._newest or (packet, now_ns)
        step = ((packet.sequence - before.sequence + 0x8000) & 0xFFFF) - 0x8000
        ticks = ((packet.timestamp - before.timestamp + 2**31) & 0xFFFFFFFF) - 2**31
        own_ns = ticks * NS_PER_S // CLOCK_HZ
        if not -MAX_MISORDER < step < MAX_DROPOUT:
            return False
        if own_ns < -MAX_STEP_NS or own_ns - (now_ns - before_ns) > MAX_STEP_NS:
            return False
        if self._newest is None or step > 0:
            self._newest = packet, now_ns
        return True


class Reorder:
    """Packets in the order of their sequence numbers; waits for a missing one as long as little is held."""

    def __init__(self) -> None:
        self._next: int | None = None
        self._held: dict[int, tuple[RtpPacket, int]] = {}

    def add(self, packet: RtpPacket, now_ns: int) -> Iterator[tuple[RtpPacket, int, bool]]:
        """Those that are due: packet, arrival, whether packets before it were lost."""
        if self._next is None:
            self._next = packet.sequence
        if (packet.sequence - self._next) & 0xFFFF >= 0x8000:
            return  # comes too late, or twice
        self._held[packet.sequence] = packet, now_ns
        lost = False
        while self._held:
            if self._next not in self._held:
                oldest_ns = min(came_ns for _, came_ns in self._held.values())
                if len(self._held) <= MOST_HELD and now_ns - oldest_ns < LONGEST_HELD_NS:
                    return
                lost, after = True, self._next
                self._next = min(self._held, key=lambda number: (number - after) & 0xFFFF)
            yield (*self._held.pop(self._next), lost)
            lost, self._next = False, (self._next + 1) & 0xFFFF


class Units:
    """Pictures out of packets in order; a picture that lacks a packet has no data."""

    def __init__(self, *, h265: bool = False) -> None:
        self._split, self._h265 = h265_parts if h265 else h264_parts, h265
        self._parts: list[bytes] = []
        self._bytes = 0  # of the picture so far
        self._whole = True
        self._ticks: int | None = None
        self._came_ns = 0
        self._open = False

    def add(self, packet: RtpPacket, came_ns: int, *, lost: bool) -> Iterator[Unit]:
        """The picture that this packet ends, and before it one whose end was lost."""
        ticks = self.unwrapped(packet.timestamp)
        self._whole &= not lost
        if self._open and ticks != self._ticks and self._shows():
            yield self._close()
        if not self._open:
            self._open, self._came_ns, self._whole = True, came_ns, not lost
        self._ticks = ticks
        try:
            parts = self._split(packet.payload)
        except (IndexError, ValueError):
            parts = []
        # A fragment that continues nothing: its first one was lost, or never heard.
        self._whole &= bool(parts) and (parts[0] is START_CODE or bool(self._parts))
        self._parts += parts
        self._bytes += sum(map(len, parts))
        if self._bytes > MOST_BYTES:
            self._whole, self._parts = False, []
        if packet.marker and self._shows():
            yield self._close()

    def unwrapped(self, timestamp: int) -> int:
        """The 32 bits of a time, nearest to the last one."""
        if self._ticks is None:
            return timestamp
        return self._ticks + ((timestamp - self._ticks + 2**31) & 0xFFFFFFFF) - 2**31

    def _shows(self) -> bool:
        """Whether there is a picture, or the damage of one, and not only parameter sets, which belong to the next."""
        heads = (self._parts[i + 1][0] for i, part in enumerate(self._parts) if part is START_CODE)
        return not self._whole or any(
            head >> 1 & 63 < 32 if self._h265 else 1 <= head & 31 <= 5 for head in heads
        )

    def _close(self) -> Unit:
        assert self._ticks is not None
        unit = Unit(b"".join(self._parts) if self._whole else None, self._ticks, self._came_ns)
        self._parts, self._bytes, self._open = [], 0, False
        return unit


def h264_parts(payload: bytes) -> list[bytes]:
    """Pieces of an Annex B stream in one payload (RFC 6184, 5.2)."""
    kind = payload[0] & 31
    if kind == H264_FRAGMENT:
        if payload[1] & 0x80:  # the first one
            return [START_CODE, bytes([payload[0] & 0xE0 | payload[1] & 31]), payload[2:]]
        return [payload[2:]]
    if kind == H264_AGGREGATE:
        return aggregated(payload[1:])
    if not 1 <= kind < H264_AGGREGATE:
        raise ValueError(f"expected a single unit, STAP-A or FU-A, got type {kind}")
    return [START_CODE, payload]


def h265_parts(payload: bytes) -> list[bytes]:
    """The same for H.265 (RFC 7798, 4.4), without decoding order numbers."""
    kind = payload[0] >> 1 & 63
    if kind == H265_FRAGMENT:
        if payload[2] & 0x80:
            head = bytes([payload[0] & 0x81 | (payload[2] & 63) << 1, payload[1]])
            return [START_CODE, head, payload[3:]]
        return [payload[3:]]
    if kind == H265_AGGREGATE:
        return aggregated(payload[2:])
    if kind > H265_FRAGMENT:
        raise ValueError(f"expected a single unit, AP or FU, got type {kind}")
    return [START_CODE, payload]


def aggregated(data: bytes) -> list[bytes]:
    """Units that each follow their size, two bytes."""
    parts: list[bytes] = []
    while data:
        size = int.from_bytes(data[:2], "big")
        if not 0 < size <= len(data) - 2:
            raise ValueError(f"expected a unit of 1 to {len(data) - 2} bytes, got {size}")
        parts += [START_CODE, data[2 : 2 + size]]
        data = data[2 + size :]
    return parts


def begins(unit: bytes, *, h265: bool) -> bool:
    """Whether a decoder can begin with this picture: it brings parameter sets (SPS; VPS)."""
    at = 0
    while (at := unit.find(START_CODE[1:], at)) >= 0 and at + 3 < len(unit):
        at += 3
        kind = unit[at] >> 1 & 63 if h265 else unit[at] & 31
        if kind == (32 if h265 else 7):
            return True
    return False
