"""Protocol buffers without their description: fields by their numbers.

Layout after protobuf.dev ("Encoding"): each field is a varint (number * 8 + kind) and its value. What is 0 or empty is
mostly not written at all.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

VARINT, FIXED_64, BYTES, FIXED_32 = 0, 1, 2, 5
LONGEST_VARINT = 10
Value = int | bytes  # a varint, or the bytes of any other kind
Message = dict[int, Value]


class ProtobufError(ValueError):
    """Bytes that break the layout."""


def message_of(value: Value | None) -> Message:
    """The fields of a nested message by their numbers, the last of each; none where there is none.

    Raises:
        ProtobufError: the bytes break the layout.
    """
    return dict(_fields(value)) if isinstance(value, bytes) else {}


def signed(value: Value | None) -> int:
    """An int32 or int64 as protocol buffers write them: two's complement of 64 bits; 0 where it is not written."""
    if not isinstance(value, int):
        return 0
    return value - (1 << 64) if value >> 63 else value


def real(value: Value | None) -> float:
    """A float or double; 0 where it is not written."""
    if not isinstance(value, bytes) or len(value) not in (4, 8):
        return 0.0
    number: float = struct.unpack("<f" if len(value) == 4 else "<d", value)[0]
    return number


def _fields(message: bytes) -> Iterator[tuple[int, Value]]:
    """Numbers and values in their order; every length is checked against what is there."""
    offset = 0
    while offset < len(message):
        tag, offset = _varint(message, offset)
        number, kind = tag >> 3, tag & 7
        if kind == VARINT:
            value, offset = _varint(message, offset)
            yield number, value
            continue
        if kind == BYTES:
            size, offset = _varint(message, offset)
        elif kind in (FIXED_64, FIXED_32):
            size = 8 if kind == FIXED_64 else 4
        else:
            raise ProtobufError(f"kind {kind} at byte {offset}")
        if offset + size > len(message):
            raise ProtobufError(f"field {number} ends after its message")
        yield number, message[offset : offset + size]
        offset += size


def _varint(data: bytes, offset: int) -> tuple[int, int]:
    """Seven bits a byte, the lowest first; and where the next value begins."""
    value = 0
    for place, byte in enumerate(data[offset : offset + LONGEST_VARINT]):
        value |= (byte & 0x7F) << (7 * place)
        if byte < 0x80:
            return value & ((1 << 64) - 1), offset + place + 1
    raise ProtobufError(f"a number without an end at byte {offset}")
