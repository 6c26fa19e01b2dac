"""Headers of H.264 and H.265 that a decoder reads and does not pass on: numbers of frames, messages about recovery.

ITU-T H.264: 7.3.1 (units), 7.3.2.1.1 (sequence parameters), 7.3.3 (slice header), D.1.8 (recovery point). ITU-T H.265:
7.3.1, D.2.8. Only what comes before a picture's first slice is read, and that slice's first bytes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

START_CODE = b"\0\0\1"
SLICE, IDR, SEI, SPS = 1, 5, 6, 7  # H.264's types of units
H265_SEI, H265_SLICES, H265_KEYS = 39, range(32), range(16, 24)  # H.265's
RECOVERY_POINT = 6  # a message's type, in both
SLICE_HEAD_BYTES = 32
# Profiles that tell their colours, and scaling lists, before the rest.
HIGH_PROFILES = frozenset({44, 83, 86, 100, 110, 118, 122, 128, 134, 135, 138, 139, 244})


@dataclass(frozen=True)
class FrameNumber:
    """Of one picture: its number, whether others lean on it, and of a refresh that begins here how long it takes.

    number         modulo `modulus`; one more than that of the last reference before it
    recovery       frame numbers until pictures are whole, None where no refresh begins
    may_jump       the stream leaves out numbers as it likes
    """

    number: int
    modulus: int
    is_idr: bool
    is_reference: bool
    recovery: int | None
    may_jump: bool


class SequenceParameters(NamedTuple):
    """What is needed of them, in H.264, to read a frame's number.

    number_bits    how many bits it has
    may_jump       the stream leaves out numbers as it likes
    colours_apart  each colour is coded as a picture of its own
    """

    number_bits: int
    may_jump: bool
    colours_apart: bool


class H264Headers:
    """Reads the packets of one stream in their order; `extradata` is the container's, b"" without any."""

    def __init__(self, extradata: bytes) -> None:
        self._size_bytes = size_bytes(extradata, at=4)
        self._parameters: SequenceParameters | None = None
        for unit in _extradata_units(extradata, self._size_bytes):
            if unit and unit[0] & 31 == SPS:
                self._parameters = _sequence_parameters(unit)

    def read(self, packet: bytes) -> FrameNumber | None:
        """Of the packet's picture; None where that cannot be read."""
        recovery = None
        try:
            for unit in units(packet, self._size_bytes):
                kind = unit[0] & 31
                if kind == SPS:
                    self._parameters = _sequence_parameters(unit)
                elif kind == SEI:
                    message = recovery_point(unit[1:])
                    recovery = recovery if message is None else Bits(message).unsigned()
                elif kind in (SLICE, IDR) and self._parameters is not None:
                    return _frame_number(unit, self._parameters, recovery)
        except (ValueError, IndexError):
            return None  # the decoder tells the damage
        return None


def h265_begins(packet: bytes, length_bytes: int) -> bool:
    """Whether a decoder can begin with an H.265 picture: a key frame, or the first of a refresh, and says so."""
    for unit in units(packet, length_bytes):
        kind = unit[0] >> 1 & 63
        if kind == H265_SEI and recovery_point(unit[2:]) is not None:
            return True
        if kind in H265_SLICES:
            return kind in H265_KEYS
    return False


def size_bytes(extradata: bytes, *, at: int) -> int:
    """In how many bytes each unit's size is told; 0 where start codes part them (Annex B)."""
    return (extradata[at] & 3) + 1 if len(extradata) > at and extradata[0] == 1 else 0


def units(data: bytes, length_bytes: int) -> Iterator[bytes]:
    """The units of a packet, none of them empty."""
    at = 0
    if length_bytes:
        while at + length_bytes < len(data):
            start = at + length_bytes
            at = start + int.from_bytes(data[at:start], "big")
            if at > start:
                yield data[start:at]
        return
    at = data.find(START_CODE)
    while at >= 0:
        end = data.find(START_CODE, at + 3)
        if unit := data[at + 3 : None if end < 0 else end]:
            yield unit
        at = end


def recovery_point(messages: bytes) -> bytes | None:
    """What a unit of messages (SEI, without its head) says of a recovery point, None where nothing."""
    data, at = unescaped(messages), 0
    while at + 2 <= len(data) and data[at] != 0x80:
        head = []
        for _ in ("type", "size"):
            value = 0
            while at < len(data) - 1 and data[at] == 0xFF:
                value, at = value + 0xFF, at + 1
            head.append(value + data[at])
            at += 1
            if at == len(data):
                return None
        kind, size = head
        if kind == RECOVERY_POINT:
            return data[at : at + size]
        at += size
    return None


def unescaped(data: bytes) -> bytes:
    """A unit without the bytes that keep start codes from appearing in it."""
    return data.replace(b"\0\0\3", b"\0\0")


class Bits:
    """Numbers out of bytes, the highest bit first; ValueError at the end."""

    def __init__(self, data: bytes) -> None:
        self._bits, self._at = bin(int.from_bytes(b"\1" + data, "big"))[3:], 0

    def take(self, count: int) -> int:
        """A number of so many bits, 1 or more."""
        self._at += count
        if self._at > len(self._bits):
            raise ValueError("expected more bits")
        return int(self._bits[self._at - count : self._at], 2)

    def unsigned(self) -> int:
        """An Exp-Golomb number: ue(v), and se(v) where only its length matters."""
        zeros = self._bits.index("1", self._at) - self._at
        self._at += zeros
        return self.take(zeros + 1) - 1


def _extradata_units(extradata: bytes, length_bytes: int) -> Iterator[bytes]:
    if not length_bytes:
        yield from units(extradata, 0)
    elif len(extradata) > 8:  # avcC: the first of its sequence parameters
        yield extradata[8 : 8 + int.from_bytes(extradata[6:8], "big")]


def _sequence_parameters(unit: bytes) -> SequenceParameters | None:
    """Those of a unit, None if damaged."""
    bits = Bits(unescaped(unit[1:]))
    try:
        profile, _ = bits.take(8), bits.take(16)
        bits.unsigned()
        apart = profile in HIGH_PROFILES and _skip_colours(bits)
        number_bits = bits.unsigned() + 4
        if (order := bits.unsigned()) == 0:
            bits.unsigned()
        elif order == 1:
            bits.take(1), bits.unsigned(), bits.unsigned()
            for _ in range(bits.unsigned()):
                bits.unsigned()
        bits.unsigned()
        return SequenceParameters(number_bits, bool(bits.take(1)), apart)
    except ValueError:
        return None


def _skip_colours(bits: Bits) -> bool:
    """Up to the scaling lists' end; whether colours are coded apart."""
    full = bits.unsigned() == 3
    apart = full and bool(bits.take(1))
    bits.unsigned(), bits.unsigned(), bits.take(1)
    if bits.take(1):
        for index in range(12 if full else 8):
            if bits.take(1):
                _skip_scaling_list(bits, 16 if index < 6 else 64)
    return apart


def _skip_scaling_list(bits: Bits, size: int) -> None:
    scale = 8
    for _ in range(size):
        coded = bits.unsigned()
        scale = (scale + (coded + 1) // 2 * (1 if coded % 2 else -1)) % 256
        if scale == 0:
            return


def _frame_number(unit: bytes, parameters: SequenceParameters, recovery: int | None) -> FrameNumber:
    bits = Bits(unescaped(unit[1:SLICE_HEAD_BYTES]))
    for _ in ("first macroblock", "type", "picture parameters"):
        bits.unsigned()
    if parameters.colours_apart:
        bits.take(2)
    return FrameNumber(
        number=bits.take(parameters.number_bits),
        modulus=1 << parameters.number_bits,
        is_idr=unit[0] & 31 == IDR,
        is_reference=bool(unit[0] & 0x60),
        recovery=recovery,
        may_jump=parameters.may_jump,
    )
