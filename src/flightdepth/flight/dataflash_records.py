"""The records of ArduPilot's DataFlash log (.bin), each by its own layout.

A log describes itself: each record is A3 95, a type, and fields that a record of type FMT has announced
(https://ardupilot.org/copter/docs/logmessages.html). The meaning of the field letters comes from pymavlink.
The records are walked here, because pymavlink's reader prints what it skips and counts nothing.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from flightdepth.errors import MissingExtra
from flightdepth.flight.autopilot import DAMAGED_BYTES

MAGIC = b"\xa3\x95"
FMT = 0x80
FMT_LAYOUT = struct.Struct("<BB4s16s64s")  # type, length, name, letters of the fields, names of the fields
Fields = dict[str, float]
Letters = dict[str, tuple[str, float | None]]


@dataclass(frozen=True)
class Layout:
    """How one type of record is packed: texts are left out, `columns` are its numbers.

    `factors` are by which some of them, by index, are scaled to the unit of the docs (c: hundredths, ...).
    """

    name: str
    length: int
    packed: struct.Struct
    columns: tuple[str, ...]
    factors: tuple[tuple[int, float], ...]

    def fields(self, body: bytes) -> Fields:
        """The numbers of a record by name."""
        numbers = list(self.packed.unpack(body))
        for index, factor in self.factors:
            numbers[index] *= factor
        return dict(zip(self.columns, numbers, strict=True))


def field_letters(path: Path) -> Letters:
    """The struct code and the factor of each field letter; texts are skipped, as padding is."""
    try:
        from pymavlink.DFReader import FORMAT_TO_STRUCT
    except ModuleNotFoundError as error:
        raise MissingExtra(f"reading the DataFlash log {path.name}", "ardupilot") from error
    return {
        letter: (code.replace("s", "x"), factor) for letter, (code, factor, _) in FORMAT_TO_STRUCT.items()
    }


def wanted_rows(
    data: bytes, letters: Letters, wanted: frozenset[str], counts: Counter[str]
) -> Iterator[tuple[Layout, bytes]]:
    """Layout and body of the records of the wanted names, in the order of the log."""
    layouts: dict[int, Layout] = {FMT: Layout("FMT", 3 + FMT_LAYOUT.size, FMT_LAYOUT, (), ())}
    for kind, body in bodies(data, layouts, counts):
        if kind == FMT:
            announce(body, letters, layouts, counts)
        elif layouts[kind].name in wanted:
            yield layouts[kind], body


def bodies(data: bytes, layouts: dict[int, Layout], counts: Counter[str]) -> Iterator[tuple[int, bytes]]:
    """Type and body of each record. After damage, only what another record or the end follows is one."""
    at, in_step = 0, True
    while at < len(data):
        known = len(data) >= at + 3 and data.startswith(MAGIC, at)
        layout = layouts.get(data[at + 2]) if known else None
        end = at + (layout.length if layout else 0)
        if layout and end <= len(data) and (in_step or end == len(data) or data.startswith(MAGIC, end)):
            yield data[at + 2], data[at + 3 : end]
            at, in_step = end, True
        else:
            found = data.find(MAGIC, at + 1)
            next_at = found if found >= 0 else len(data)
            counts[DAMAGED_BYTES] += next_at - at
            at, in_step = next_at, False


def announce(
    body: bytes,
    letters: Letters,
    layouts: dict[int, Layout],
    counts: Counter[str],
) -> None:
    """Take the layout that a FMT record announces, if it agrees with itself."""
    kind, length, *texts = FMT_LAYOUT.unpack(body)
    name, codes, columns = (text.split(b"\0")[0].decode("ascii", "replace") for text in texts)
    names = tuple(columns.split(",")) if columns else ()
    known = all(code in letters for code in codes) and len(codes) == len(names)
    packed = struct.Struct("<" + "".join(letters[code][0] for code in codes if code in letters))
    if kind == FMT:
        return
    if not known or packed.size + 3 != length:
        counts["damaged announcements of a layout"] += 1
        return
    fields = zip(names, (letters[code] for code in codes), strict=True)
    numbers = [(column, factor) for column, (code, factor) in fields if not code.endswith("x")]
    factors = tuple((index, factor) for index, (_, factor) in enumerate(numbers) if factor is not None)
    layouts[kind] = Layout(name, length, packed, tuple(column for column, _ in numbers), factors)
