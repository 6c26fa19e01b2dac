"""DJI's subtitles, in a file or inside a video: a cue for each picture or second (dji_cue.py).

A cue's start is the time: the wall clock inside it is not used. Velocity comes from the positions (positions.py).
H.S or drone_speedx and y, where given, replace its horizontal size (nobody says which of x and y is north), V.S or
drone_speedz its vertical one with the sign that agrees with the heights, because firmware differs on the sign.
The attitude of the camera is Rz(yaw) Ry(pitch) Rx(roll) applied to a camera that looks north.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from flightdepth.errors import BadInput
from flightdepth.flight.data_track import TrackPacket, track_packets
from flightdepth.flight.dji_cue import TAG, Cue, cue_of
from flightdepth.flight.file_bytes import as_text, log_bytes
from flightdepth.flight.gimbal import looking_along
from flightdepth.flight.order import rising_counted
from flightdepth.flight.places import SEA_LEVEL, PlaceTrack
from flightdepth.flight.positions import Velocities, place_track, velocities_by_places
from flightdepth.flight.records import NS_PER_S, AttitudeSample, Telemetry, ViewTrack, by_time
from flightdepth.motion import Vector

CUE = re.compile(r"(\d{1,3}):([0-5]\d):([0-5]\d)[,.](\d{1,3})\s*-->")
# Best first: those above the start are barometric and smooth, those above the sea may be the GPS's.
HEIGHTS = ("rel_alt", "barometer", "hb", "h", "abs_alt", "altitude", "gps_height")


def looks_like_dji_srt(head: bytes, path: Path) -> bool:
    """Subtitles of any kind: what is missing in them is said by `read_dji_srt`."""
    return CUE.search(as_text(head)) is not None


def read_dji_srt(path: Path) -> Telemetry:
    """Read a DJI subtitle file: velocities in the world frame, the camera's attitude where the gimbal is told."""
    counts: Counter[str] = Counter()
    cues = _cues(as_text(log_bytes(path)), counts)
    log = _flight(f"DJI subtitles {path.name}", cues, counts)
    if log is None:
        expected = "DJI subtitles with two GPS positions or more"
        got = f"{len(cues)} subtitles, too few with a position"
        raise BadInput(f"telemetry {path}", expected=expected, got=got)
    return log


def read_dji_subtitle_track(path: Path) -> Telemetry | None:
    """The same of subtitles inside a video; None where there are none, as in a folder, or they tell no flight."""
    if path.is_dir():
        return None
    told = ((packet.interval.start_ns, _text(packet)) for packet in track_packets(path, "subtitle", bool))
    # An MP4 has an empty one for the time between two.
    cues = [cue_of(stamp_ns, TAG.sub(" ", text)) for stamp_ns, text in told if text.strip()]
    return _flight("DJI subtitles in the video", cues, Counter()) if cues else None


def _text(packet: TrackPacket) -> str:
    """What a subtitle says; an MP4's begins with its length in two bytes, and formatting may follow."""
    if packet.codec != "mov_text":
        return as_text(packet.data)
    return as_text(packet.data[2 : 2 + int.from_bytes(packet.data[:2], "big")])


def _flight(name: str, cues: Sequence[Cue], counts: Counter[str]) -> Telemetry | None:
    """What subtitles tell of a flight; None where fewer than two tell a position."""
    cues = _ordered(cues, counts)
    found, places = _flown(cues, counts)
    if not len(found):
        return None
    cameras = _attitudes(cues)
    name = f"{name}: {len(found)} velocities from positions" + (", gimbal attitude" if cameras else "")
    samples = by_time(found.samples(), cameras)
    return Telemetry(name, samples, dict(+counts), view=_views(cues), places=places)


def _cues(text: str, counts: Counter[str]) -> list[Cue]:
    marks = list(CUE.finditer(text))
    ends = [*(mark.start() for mark in marks), len(text)][1:]
    bodies = [TAG.sub(" ", text[mark.end() : end]) for mark, end in zip(marks, ends, strict=True)]
    # A last line without its end may have lost digits, or its angles.
    if bodies and not text.endswith(("\n", "\r", "</font>")):
        counts["subtitles cut off at the end"] += 1
        del bodies[-1]
    return [cue_of(_begins_ns(mark), body) for mark, body in zip(marks, bodies, strict=False)]


def _begins_ns(mark: re.Match[str]) -> int:
    hours, minutes, seconds = (int(mark[group]) for group in (1, 2, 3))
    milliseconds = int(mark[4].ljust(3, "0"))
    return ((hours * 60 + minutes) * 60 + seconds) * NS_PER_S + milliseconds * 1_000_000


def _views(cues: Sequence[Cue]) -> ViewTrack | None:
    told = [(cue.stamp_ns, cue.hfov_deg) for cue in cues if cue.hfov_deg is not None]
    if not told:
        return None
    stamps, degrees = zip(*told, strict=True)
    return ViewTrack(np.array(stamps, dtype=np.int64), np.array(degrees), nominal=True)


def _ordered(cues: Sequence[Cue], counts: Counter[str]) -> list[Cue]:
    kept = rising_counted([cue.stamp_ns for cue in cues], counts, "subtitles")
    return [cues[index] for index in kept]


def _flown(cues: Sequence[Cue], counts: Counter[str]) -> tuple[Velocities, PlaceTrack | None]:
    """Velocities and where they were told; `abs_alt` is what DJI takes for the height above the sea."""
    latitude_first = _latitude_first(cues)
    placed = [(cue, cue.place(latitude_first=latitude_first)) for cue in cues]
    sound = [cue for cue, place in placed if place is not None]
    counts["subtitles without a position"] += len(cues) - len(sound)
    places_deg = np.array([place for _, place in placed if place is not None]).reshape(-1, 2)
    stamps_ns = np.array([cue.stamp_ns for cue in sound], dtype=np.int64)
    found = velocities_by_places(stamps_ns, places_deg, _heights(sound), counts)
    altitudes_m = np.array([cue.fields.get("abs_alt", math.nan) for cue in sound])
    # Not counted: those that jump have been.
    places = place_track(stamps_ns, places_deg, altitudes_m, SEA_LEVEL)
    return _with_speeds(found, {cue.stamp_ns: cue for cue in sound}), places


def _latitude_first(cues: Sequence[Cue]) -> bool:
    """Whether GPS(...) starts with the latitude: what is beyond 90 decides, else a height as third number."""
    pairs = [cue.gps for cue in cues if cue.gps is not None]
    beyond_first = sum(abs(first) > 90 for first, _ in pairs)
    beyond_second = sum(abs(second) > 90 for _, second in pairs)
    if beyond_first != beyond_second:
        return beyond_second > beyond_first
    return sum(cue.gps_has_height for cue in cues if cue.gps is not None) * 2 > len(pairs)


def _heights(cues: Sequence[Cue]) -> Vector:
    """One source of height for the whole file, gaps filled; level flight where none is told."""
    for source in HEIGHTS:
        known = [(index, cue.fields[source]) for index, cue in enumerate(cues) if source in cue.fields]
        if known and len(known) * 2 > len(cues):
            indices, heights = zip(*known, strict=True)
            return np.asarray(np.interp(np.arange(len(cues)), indices, heights))
    return np.zeros(len(cues))


def _with_speeds(found: Velocities, cues: dict[int, Cue]) -> Velocities:
    """The sizes that the drone itself tells, with the directions from the positions, where these move."""
    velocity, sizes = found.velocity_ned.copy(), np.linalg.norm(found.velocity_ned[:, :2], axis=1)
    moving = np.flatnonzero(sizes > 0)
    told = [cues[stamp] for stamp in found.stamps_ns.tolist()]
    vertical = np.array([cue.fields.get("v.s", 0.0) for cue in told])
    sign = 1.0 if vertical @ velocity[:, 2] >= 0 else -1.0
    for index, cue in enumerate(told):
        if "h.s" in cue.fields and len(moving):
            nearest = moving[np.abs(found.stamps_ns[moving] - cue.stamp_ns).argmin()]
            velocity[index, :2] = found.velocity_ned[nearest, :2] * (cue.fields["h.s"] / sizes[nearest])
        if "v.s" in cue.fields:
            velocity[index, 2] = sign * cue.fields["v.s"]
    return Velocities(found.stamps_ns, velocity, found.sigma)


def _attitudes(cues: Sequence[Cue]) -> list[AttitudeSample]:
    told = [(cue.stamp_ns, cue.yaw_pitch_roll_deg) for cue in cues]
    return [AttitudeSample(stamp_ns, looking_along(*angles)) for stamp_ns, angles in told if angles]
