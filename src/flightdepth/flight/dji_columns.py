"""The rows of DJI flight records that were decoded to CSV, whoever did it, as numbers in one set of units.

`dji_header` knows the columns. Rows of another number of cells than the header are left out and counted: what stands
in the wrong column would pass for a number.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flightdepth.flight.dji_header import (
    ALTITUDE,
    BODY,
    DATE,
    GIMBAL,
    GIMBAL_MODE,
    HEIGHT,
    METRES,
    METRES_A_SECOND,
    PLACE,
    RECORDING,
    SECONDS,
    SPEEDS,
    TIME,
    UNIVERSAL,
    WALL_CLOCK,
    Column,
    Header,
    cells_of,
    header_and_rows,
)
from flightdepth.flight.order import rising_counted
from flightdepth.flight.records import NS_PER_S
from flightdepth.flight.universal_time import utc_of_iso
from flightdepth.motion import Stamps, Vector

CLOCK = re.compile(r"(\d{1,2}):(\d{2}):(\d{2}(?:[.,]\d{1,9})?)(?:\s*([ap])\.?\s?m\b)?", re.IGNORECASE)
IS_RECORDING = frozenset({"1", "1.0", "true", "yes", "recording", "start", "starting"})
# A clock is taken instead of the time in flight where that stands still in more than this share of the rows.
STANDING_SHARE = 0.05
HALF_DAY_S = 43_200.0


@dataclass(frozen=True, eq=False)
class FlightTable:
    """The rows of a flight record whose times rise; NaN where a cell tells no number.

    stamps_ns [n]  on the record's own clock
    places_deg     latitude and longitude [n, 2]
    heights_m      [n], above where the drone took off, or above the sea
    altitudes_m    [n], above the sea
    speeds         x, y, z as they are written, m/s [n, 3]
    body_deg, gimbal_deg  yaw, pitch, roll in degrees [n, 3]
    recording      whether a video is recorded [n]; None where no column tells
    follows        whether the gimbal's mode says that it follows the drone's heading; None where no column tells
    moments        pairs of a stamp and its UTC, both ns, at the rows where the latter moves on
    """

    maker: str
    stamps_ns: Stamps
    places_deg: Vector
    heights_m: Vector
    altitudes_m: Vector
    speeds: Vector
    body_deg: Vector
    gimbal_deg: Vector
    recording: NDArray[np.bool_] | None
    follows: bool | None
    moments: list[tuple[int, int]]


def flight_table(text: str, counts: Counter[str]) -> FlightTable:
    """All rows of a file whose header `is_record`; those that cannot be used are counted."""
    header, lines = header_and_rows(text)
    rows = _whole_rows(header, lines, counts)
    times_s = _times(header, rows)
    known = np.flatnonzero(np.isfinite(times_s) & (np.abs(times_s) < 1e9))
    counts["rows without a time"] += len(rows) - len(known)
    stamps_ns = np.round(times_s[known] * NS_PER_S).astype(np.int64)
    risen = rising_counted(stamps_ns.tolist(), counts, "rows")
    kept = [rows[index] for index in known[risen].tolist()]

    def table(names: Sequence[Sequence[str]], units: Mapping[str, float] | None = None) -> Vector:
        return np.stack([_numbers(header, kept, header.column(each, units)) for each in names], axis=1)

    return FlightTable(
        header.maker,
        stamps_ns[risen],
        table(PLACE),
        table([HEIGHT], METRES)[:, 0],
        table([ALTITUDE], METRES)[:, 0],
        table(SPEEDS, METRES_A_SECOND),
        table(BODY),
        table(GIMBAL),
        _recording(header, kept),
        _follows(header, kept),
        _moments(header, kept, stamps_ns[risen].tolist()),
    )


def _whole_rows(header: Header, lines: list[str], counts: Counter[str]) -> list[list[str]]:
    """The cells of the lines that have as many as the header; empty ones beyond do not matter."""
    if lines and not lines[-1].endswith(("\n", "\r")):
        counts["last lines without an end: cut off"] += 1
        lines = lines[:-1]
    width, rows = len(header.names), [cells_of(line, header.separator) for line in lines]
    whole = [row for row in rows if len(row) >= width and not any(row[width:])]
    counts["rows of another number of cells than the header"] += len(rows) - len(whole)
    return whole


def _times(header: Header, rows: Sequence[Sequence[str]]) -> Vector:
    """Seconds [n] of the flight's own time, or of the wall clock where the former stands still on the ground."""
    flown = _numbers(header, rows, header.column(TIME, SECONDS))
    clock = np.full(len(rows), math.nan)
    if (column := header.column(WALL_CLOCK)) is not None:
        clock = np.array([_of_clock(row[column.at]) for row in rows])
        known = np.isfinite(clock)
        # A clock falls by a day at midnight, by half a day after 12:59 where AM and PM are left out.
        clock[known] = np.unwrap(clock[known], period=HALF_DAY_S)
    lost = len(rows) * STANDING_SHARE
    return clock if len(_distinct(clock)) > len(_distinct(flown)) + lost else flown


def _distinct(times_s: Vector) -> Vector:
    return np.unique(times_s[np.isfinite(times_s)])


def _of_clock(cell: str) -> float:
    """Seconds since midnight of `2018/07/04 09:19:31.701`, `2:22:59,45 PM` or `2:22:59 p. m.`; NaN for others."""
    match = CLOCK.search(cell)
    if match is None:
        return math.nan
    hours = int(match[1])
    if match[4]:
        hours = hours % 12 + (12 if match[4].lower() == "p" else 0)
    return hours * 3600.0 + int(match[2]) * 60 + float(match[3].replace(",", "."))


def _numbers(header: Header, rows: Sequence[Sequence[str]], column: Column | None) -> Vector:
    """The numbers of a column [n]; NaN where there are none, or no such column."""
    found = np.full(len(rows), math.nan)
    if column is None:
        return found
    for index, row in enumerate(rows):
        cell = row[column.at]
        try:
            number = float(cell if header.separator == "," else cell.replace(",", "."))
        except ValueError:
            continue
        if abs(number) < 1e12:  # False for NaN too
            found[index] = number * column.scale
    return found


def _recording(header: Header, rows: Sequence[Sequence[str]]) -> NDArray[np.bool_] | None:
    """Whether each row says that a video is recorded; of several columns the first that ever does."""
    told = None
    for name in RECORDING:
        if (column := header.column([name])) is not None:
            told = np.array([row[column.at].strip().lower() in IS_RECORDING for row in rows], dtype=bool)
            if told.any():
                break
    return told


def _moments(
    header: Header, rows: Sequence[Sequence[str]], stamps_ns: Sequence[int]
) -> list[tuple[int, int]]:
    """Where the column that says UTC moves on: most write whole seconds, so only there it tells the time of a row."""
    column = header.column(DATE, UNIVERSAL)
    if column is None:
        return []
    cells = [row[column.at].strip() for row in rows]
    told = (
        (stamp_ns, utc_of_iso(cell))
        for stamp_ns, cell, before in zip(stamps_ns[1:], cells[1:], cells, strict=False)
        if cell != before
    )
    return [(stamp_ns, utc_ns) for stamp_ns, utc_ns in told if utc_ns is not None]


def _follows(header: Header, rows: Sequence[Sequence[str]]) -> bool | None:
    """Whether most rows that tell the gimbal's mode say `Follow Yaw`, `YawFollow`, or `FPV`, which follows too."""
    column = header.column(GIMBAL_MODE)
    modes = [] if column is None else [row[column.at].strip().lower() for row in rows]
    told = [mode for mode in modes if mode]
    return 2 * sum("follow" in mode or mode == "fpv" for mode in told) > len(told) if told else None
