"""The header of DJI flight records that were decoded to CSV: which column tells what, in which unit.

    maker                                     columns
    AirData                                   time(millisecond), latitude, height_above_takeoff(feet), xSpeed(mph),
                                              compass_heading(degrees), isVideo, gimbal_heading(degrees), ...
    PhantomHelp's viewers (Flight Reader),    OSD.flyTime [s], OSD.latitude, OSD.height [ft], OSD.xSpeed [MPH],
    TXTlogToCSVtool                           OSD.yaw, GIMBAL.yaw, CAMERA.isVideo, CUSTOM.isVideo, ...
    Litchi                                    time(millisecond), latitude, altitude(m), velocityX(mps), yaw(deg),
                                              isTakingVideo, gimbalYawRaw (tenths of a degree), ...

The unit stands in the name, in round or square brackets. A first line `sep=,` is skipped; where a country writes
decimal commas, semicolons or tabs part the columns.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

UNIT = re.compile(r"^(.*?)\s*[(\[]\s*([^)\]]*?)\s*[)\]]$")
SECONDS = {"s": 1.0, "ms": 1e-3, "millisecond": 1e-3}
METRES = {"m": 1.0, "meters": 1.0, "metres": 1.0, "ft": 0.3048, "feet": 0.3048}
METRES_A_SECOND = {"m/s": 1.0, "mps": 1.0, "mph": 0.44704, "km/h": 1 / 3.6, "kph": 1 / 3.6, "kmh": 1 / 3.6}

TIME = ("time", "osd.flytime")
WALL_CLOCK = ("custom.updatetime", "datetime")
DATE, UNIVERSAL = ("datetime",), {"utc": 1.0}
PLACE = (("latitude", "osd.latitude"), ("longitude", "osd.longitude"))
ALTITUDE = ("altitude_above_sealevel", "osd.altitude")
HEIGHT = (
    "height_above_takeoff",
    "osd.height",
    "ascent",
    *ALTITUDE,
    "altitude",
)
SPEEDS = tuple((f"{axis}speed", f"osd.{axis}speed", f"velocity{axis}") for axis in "xyz")
BODY = (("compass_heading", "osd.yaw", "yaw"), ("pitch", "osd.pitch"), ("roll", "osd.roll"))
GIMBAL = (
    ("gimbal_heading", "gimbal.yaw", "gimbalyawraw"),
    ("gimbal_pitch", "gimbal.pitch", "gimbalpitchraw"),
    ("gimbal_roll", "gimbal.roll", "gimbalrollraw"),
)
IN_TENTHS = frozenset({"gimbalyawraw", "gimbalpitchraw", "gimbalrollraw"})
GIMBAL_MODE = ("gimbal.mode",)
RECORDING = ("custom.isvideo", "camera_info.recordstate", "camera.isvideo", "isvideo", "istakingvideo")


class Column(NamedTuple):
    """A column's number, and what turns its numbers into s, m, m/s or degrees."""

    at: int
    scale: float


@dataclass(frozen=True)
class Header:
    """The columns of one file, in its order, names in lower case without their units."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    separator: str

    @classmethod
    def of(cls, line: str) -> Header:
        """Read a header line, whatever parts its columns."""
        separator = max(",;\t", key=line.count)
        cells = cells_of(line, separator)
        parted = [UNIT.match(cell.strip()) for cell in cells]
        names = [match[1] if match else cell.strip() for match, cell in zip(parted, cells, strict=True)]
        units = [match[2].lower() if match else "" for match in parted]
        return cls(tuple(name.lower() for name in names), tuple(units), separator)

    def column(self, names: Sequence[str], units: Mapping[str, float] | None = None) -> Column | None:
        """The first of `names` that is there, in a unit of `units`; without them any unit counts as it is (degrees)."""
        for name in names:
            for at, (other, unit) in enumerate(zip(self.names, self.units, strict=True)):
                if other == name and (units is None or unit in units):
                    scale = 1.0 if units is None else units[unit]
                    return Column(at, scale * 0.1 if name in IN_TENTHS else scale)
        return None

    @property
    def is_record(self) -> bool:
        """Whether it is that of a DJI flight record: a time, a place, and speeds, gimbal or recordings."""
        timed = self.column(TIME, SECONDS) or self.column(WALL_CLOCK)
        telling = [self.column(SPEEDS[0], METRES_A_SECOND), self.column(GIMBAL[0]), self.column(RECORDING)]
        return timed is not None and all(map(self.column, PLACE)) and any(telling)

    @property
    def maker(self) -> str:
        """Whose layout it is, for people."""
        if any(name.startswith("osd.") for name in self.names):
            return "DJI flight record"
        return "Litchi log" if "velocityx" in self.names else "AirData log"


def header_and_rows(text: str) -> tuple[Header, list[str]]:
    """The header of a file, and the lines after it."""
    lines = [line for line in text.splitlines(keepends=True) if line.strip()]
    if lines and lines[0].lstrip('"').lower().startswith("sep="):
        del lines[0]
    return Header.of(lines[0] if lines else ""), lines[1:]


def cells_of(line: str, separator: str) -> list[str]:
    """The cells of one line; none where one is longer than the csv module reads."""
    try:
        return next(csv.reader([line], delimiter=separator), [])
    except csv.Error:
        return []
