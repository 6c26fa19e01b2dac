"""GPX tracks (topografix.com/GPX, 1.0 and 1.1): where a receiver was and when, by apps, converters and loggers.

Read are the points of tracks, <trkpt> with <time>; waypoints and routes are nothing that was flown. Velocity comes
from the positions (positions.py). Speeds beside them are not used: GPX 1.1 has none, and what some write there is none.
Elevations count from the sea level, as the format's <geoidheight> has it.

A file is read by its marks, not as XML: a damaged byte, a logger that stopped before </gpx> or an & in a name costs a
point at most, and no entity is ever expanded.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flightdepth.errors import BadInput
from flightdepth.flight.file_bytes import as_text, log_bytes
from flightdepth.flight.order import rising_counted
from flightdepth.flight.places import SEA_LEVEL
from flightdepth.flight.positions import place_track, velocities_by_fixes
from flightdepth.flight.records import Telemetry, none_of
from flightdepth.flight.universal_time import UniversalTime, utc_of_iso

PREFIX = r"(?:[\w.-]{1,40}:)?"  # of a namespace
ROOT = re.compile(rf"<{PREFIX}gpx[\s>]")
MARK = re.compile(rf"<({PREFIX})(trkseg|trkpt)\b")
END = re.compile(rf"</{PREFIX}gpx\s*>\s*$")
PLACE = re.compile(r"""\b(lat|lon)\s*=\s*["']([^"'<>]{1,60})["']""")
VALUE = re.compile(rf"<({PREFIX})(ele|time|fix)>([^<>]{{1,60}})</")
HIGHEST_M = 1e5
TAIL = 1000  # characters at the end, where the last mark stands
CUT = "tracks that stop before their end: cut off"
DAMAGED = "positions damaged or cut off"
UNTIMED = "positions without a time"
MEND = "A route, or a track drawn on a map, has no times: give one that was recorded."


class Point(NamedTuple):
    """Nanoseconds since 1970; degrees and metres, NaN where they are not told."""

    stamp_ns: int
    latitude_deg: float
    longitude_deg: float
    altitude_m: float


def looks_like_gpx(head: bytes, path: Path) -> bool:
    """Markup with a <gpx> near its beginning."""
    text = as_text(head).lstrip()
    return text.startswith("<") and ROOT.search(text) is not None


def read_gpx(path: Path) -> Telemetry:
    """Read a track: velocities in the world frame, by its positions. Time 0 is the first of them."""
    counts: Counter[str] = Counter()
    segments = _segments(as_text(log_bytes(path)), counts)
    points = [point for segment in sorted(segments, key=_begin_ns) for point in segment]
    kept = rising_counted([point.stamp_ns for point in points], counts, "positions")
    stamps_ns = np.array([points[index].stamp_ns for index in kept], dtype=np.int64)
    places = np.array([points[index][1:] for index in kept], dtype=np.float64).reshape(-1, 3)
    found = velocities_by_fixes(stamps_ns, places[:, :2], places[:, 2], counts)
    if not len(found):
        expected = "a GPX track of two positions or more, with their times"
        raise BadInput(f"telemetry {path}", expected=expected, got=none_of(counts), mend=MEND)
    # Not counted: those that jump have been.
    track = place_track(stamps_ns, places[:, :2], places[:, 2], SEA_LEVEL)
    zero_ns = int(found.stamps_ns[0])
    parts = f", {len(segments)} segments" if len(segments) > 1 else ""
    name = f"GPX {path.name}: {len(found)} velocities from positions{parts}"
    log = Telemetry(name, tuple(found.samples()), dict(+counts), places=track)
    return log.counted_from(zero_ns, UniversalTime.of(zero_ns, "track"))


def _segments(text: str, counts: Counter[str]) -> list[list[Point]]:
    """The points of each segment, none of them empty; those that cannot be used are counted."""
    _, *parts = MARK.split(text)
    segments: list[list[Point]] = [[]]
    for prefix, kind, body in zip(parts[::3], parts[1::3], parts[2::3], strict=True):
        if kind == "trkseg":
            segments.append([])
        elif isinstance(point := _point(prefix, body), Point):
            segments[-1].append(point)
        else:
            counts[point] += 1
    counts[CUT] += END.search(text, max(0, len(text) - TAIL)) is None
    return [segment for segment in segments if segment]


def _begin_ns(segment: list[Point]) -> int:
    return segment[0].stamp_ns


def _point(prefix: str, body: str) -> Point | str:
    """What stands in a <trkpt>, after its name; or why it cannot be used."""
    head, _, rest = body.partition(">")
    if head.endswith("/"):
        return UNTIMED
    inside, end, _ = rest.partition(f"</{prefix}trkpt")  # what follows may be a waypoint with its own time
    if not end:
        return DAMAGED
    told: dict[str, str] = {}
    for of, name, value in VALUE.findall(inside):
        if of == prefix:
            told.setdefault(name, value.strip())
    stamp_ns = utc_of_iso(told.get("time", ""))
    if stamp_ns is None:
        return UNTIMED
    place = dict(PLACE.findall(head)) if told.get("fix") != "none" else {}
    altitude_m = _number(told.get("ele"))
    told_m = altitude_m if abs(altitude_m) < HIGHEST_M else math.nan
    return Point(stamp_ns, _number(place.get("lat")), _number(place.get("lon")), told_m)


def _number(text: str | None) -> float:
    try:
        return math.nan if text is None else float(text)
    except ValueError:
        return math.nan
