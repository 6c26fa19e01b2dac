"""GPMF, the telemetry format of GoPro cameras: key-length-value records, big-endian, padded to 4 bytes.

Layout after GoPro's public description (github.com/gopro/gpmf-parser, README): 4 bytes key, 1 byte type,
1 byte size of a sample, 2 bytes number of samples, then the samples. Type 0 nests: DEVC (a device) holds
STRM (streams), and a stream's last record holds its samples; those before it describe them: SCAL divides,
TYPE gives the layout of type "?", UNIT or SIUN the units.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from flightdepth.motion import Vector

HEADER = struct.Struct(">4sBBH")
NUMBERS = {
    "b": ">i1",
    "B": ">u1",
    "s": ">i2",
    "S": ">u2",
    "l": ">i4",
    "L": ">u4",
    "j": ">i8",
    "J": ">u8",
    "f": ">f4",
    "d": ">f8",
}
TYPE_PART = re.compile(r"([a-zA-Z])(?:\[(\d{1,3})\])?")


class GpmfError(ValueError):
    """Bytes that break the GPMF layout; readers drop the payload and count it."""


@dataclass(frozen=True)
class Record:
    """One record. `data` is size * repeat bytes; a nest (type "\\0") keeps its records in it."""

    key: str
    kind: str
    size: int
    repeat: int
    data: bytes

    def text(self) -> str:
        """The bytes as text, without the padding."""
        return self.data.decode("latin-1").rstrip("\0 ")

    def texts(self) -> list[str]:
        """One text for each sample: the units of a complex record."""
        size = self.size
        return [
            self.data[i * size : (i + 1) * size].decode("latin-1").rstrip("\0 ") for i in range(self.repeat)
        ]

    def numbers(self, layout: str | None = None) -> Vector:
        """Unscaled samples as float64 [repeat, columns]; `layout` is the TYPE record's text for type "?"."""
        dtype = _dtype(self.kind, self.size) if self.kind != "?" else _complex_dtype(self.key, layout)
        if dtype.itemsize != self.size:
            raise GpmfError(f"{self.key}: {self.size} bytes a sample, its type takes {dtype.itemsize}")
        table = np.frombuffer(self.data, dtype=dtype, count=self.repeat)
        names = dtype.names or ()
        with np.errstate(invalid="ignore"):  # damaged bytes may be a signalling NaN
            # The width is told: of no samples, or of samples of no bytes, numpy cannot find it.
            columns = [
                table[name].reshape(self.repeat, *dtype[name].shape).astype(np.float64) for name in names
            ]
        return np.concatenate(columns, axis=1)


@dataclass(frozen=True, eq=False)
class Stream:
    """A sensor's samples in one payload: `values` [n, columns], scaled; a unit a column, "" if unknown.

    `fix`: dimensions that a GPS knows its place in (GPSF: 0, 2, 3), where it says so beside its samples.
    `altitude`: what its heights count from (GPSA: "MSLV" is the sea level), "" where it does not say so.
    `utc`: when the payload began (GPSU: "yymmddhhmmss.sss"), "" where it does not say so.
    """

    device: str
    key: str
    name: str
    units: tuple[str, ...]
    values: Vector
    fix: int | None = None
    altitude: str = ""
    utc: str = ""


def records(data: bytes) -> Iterator[Record]:
    """The records of one nest level; every length is checked against what is really there."""
    offset = 0
    while offset + HEADER.size <= len(data):
        key, kind, size, repeat = HEADER.unpack_from(data, offset)
        if key == b"\0\0\0\0":
            return  # zeros may fill up the end of a payload
        start = offset + HEADER.size
        end = start + size * repeat
        if not re.fullmatch(rb"[\x20-\x7e]{4}", key):
            raise GpmfError(f"key {key!r} at byte {offset}")
        if end > len(data):
            raise GpmfError(f"{key.decode()} at byte {offset} ends after its nest")
        yield Record(key.decode(), chr(kind), size, repeat, data[start:end])
        offset = start + (size * repeat + 3) // 4 * 4
    if any(data[offset:]):
        raise GpmfError(f"{len(data) - offset} bytes are left over")


def streams(payload: bytes, keys: frozenset[str]) -> list[Stream]:
    """The streams of a payload whose samples have one of `keys`, those without samples left out."""
    found: list[Stream] = []
    for device in records(payload):
        if device.key != "DEVC" or device.kind != "\0":
            raise GpmfError(f"{device.key} where a device was expected")
        found.extend(_device_streams(device, keys))
    return found


def _device_streams(device: Record, keys: frozenset[str]) -> Iterator[Stream]:
    name = ""
    for record in records(device.data):
        if record.key == "DVNM":
            name = record.text()
        elif record.key == "STRM" and record.kind == "\0":
            yield from _stream(name, record, keys)


def _stream(device: str, nest: Record, keys: frozenset[str]) -> Iterator[Stream]:
    described: dict[str, Record] = {}
    for record in records(nest.data):
        described[record.key] = record
        if record.key in keys and record.data:
            values = _scaled(record, described)
            name = described["STNM"].text() if "STNM" in described else record.key
            units = _units(described, values.shape[1])
            altitude, utc = (described[key].text() if key in described else "" for key in ("GPSA", "GPSU"))
            yield Stream(device, record.key, name, units, values, _fix(described), altitude, utc)


def _scaled(record: Record, described: dict[str, Record]) -> Vector:
    values = record.numbers(described["TYPE"].text() if "TYPE" in described else None)
    if "SCAL" not in described:
        return values
    divisors = described["SCAL"].numbers().ravel()
    if len(divisors) not in (1, values.shape[1]) or not np.isfinite(divisors).all() or not divisors.all():
        raise GpmfError(f"{record.key}: SCAL {divisors.tolist()} for {values.shape[1]} columns")
    return np.asarray(values / divisors)


def _units(described: dict[str, Record], columns: int) -> tuple[str, ...]:
    record = described.get("SIUN") or described.get("UNIT")
    units = record.texts() if record else []
    if len(units) == 1:
        units *= columns
    return tuple(units) if len(units) == columns else ("",) * columns


def _fix(described: dict[str, Record]) -> int | None:
    told = described["GPSF"].numbers().ravel() if "GPSF" in described else np.zeros(0)
    return int(told[0]) if told.size and np.isfinite(told[0]) else None


def _dtype(kind: str, size: int) -> np.dtype[np.void]:
    number = np.dtype(_number(kind))
    return np.dtype([("c0", number, (size // number.itemsize,))])


def _complex_dtype(key: str, layout: str | None) -> np.dtype[np.void]:
    """Layout such as "Lffffff" or "f[8]L" as a numpy record type."""
    if not layout or not re.fullmatch(f"(?:{TYPE_PART.pattern})+", layout):
        raise GpmfError(f"{key}: TYPE {layout!r}")
    parts = TYPE_PART.findall(layout)
    return np.dtype([(f"c{i}", _number(kind), (int(count or 1),)) for i, (kind, count) in enumerate(parts)])


def _number(kind: str) -> str:
    if kind not in NUMBERS:
        raise GpmfError(f"type {kind!r} is not a number")
    return NUMBERS[kind]
