"""DJI's subtitle files: a cue for each picture or second, with position, height, speed and gimbal angles.

Layouts read, by the models known to write them:

    GPS(149.0251,-20.2533,16) BAROMETER:1.9                               Mavic Pro, Phantom 4: lon, lat, satellites
    GPS(-20.2533,149.0251,0.0M) BAROMETER:1.9M                            Matrice 300: lat, lon, height
    GPS (-58.851, -34.237, 15), H 85.80m, H.S 2.88m/s, V.S 0.00m/s,
        F.PRY (2.7, -7.0, 110.1), G.PRY (-24.4, 0.0, 110.4)               Phantom 4 RTK ("RTK (" too), Mini 2, Air
    [latitude: 41.42] [longitude: 2.16] [altitude: 30.4]                  Mavic 2, Air 2 ("longtitude" too)
    [latitude: ...] [longitude: ...] [rel_alt: 1.2 abs_alt: 30.4]
        [gb_yaw: 12.3 gb_pitch: -89.9 gb_roll: 0.0]                       Mavic 3, Air 2S, Mini 3 and later
        [drone_speedx: 0.2 drone_speedy: 0.0 drone_speedz: 0.0]           the same, Matrice 30, 300 with H20
    GPS(W: 97.109543, N: 32.593742, 174.21m), G.PRY (-40.3, 0.0, -31.2)   Autel's, which are no DJI's

HTML tags are dropped; decimals may be written with a comma. A cue's start is the time: the wall clock inside
it is not used. Velocity comes from the positions (positions.py). H.S or drone_speedx and y, where given, replace its
horizontal size (nobody says which of x and y is north), V.S or drone_speedz its vertical one with the sign that agrees
with the heights, because firmware differs on the sign.
focal_len (35 mm equivalent) and dzoom_ratio give the field of view of a video as wide as the sensor.
Gimbal angles are yaw from north clockwise, pitch up, roll to the right, in degrees: the attitude of the
camera is Rz(yaw) Ry(pitch) Rx(roll) applied to a camera that looks north.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flightdepth.errors import BadInput
from flightdepth.flight.file_bytes import as_text, log_bytes
from flightdepth.flight.gimbal import looking_along
from flightdepth.flight.lenses import fov_of_equivalent_deg, millimetres
from flightdepth.flight.order import rising_counted
from flightdepth.flight.places import SEA_LEVEL, PlaceTrack
from flightdepth.flight.positions import Velocities, place_track, velocities_by_places
from flightdepth.flight.records import NS_PER_S, AttitudeSample, Telemetry, ViewTrack, by_time
from flightdepth.motion import Vector

NUMBER = r"([-+]?\d{1,9}(?:[.,]\d{1,12})?)"
CUE = re.compile(r"(\d{1,3}):([0-5]\d):([0-5]\d)[,.](\d{1,3})\s*-->")
TAG = re.compile(r"<[^<>]*>")
FIELD = re.compile(
    r"(?<![\w.])(latitude|longt?itude|rel_alt|abs_alt|altitude|barometer|hb|gb_yaw|gb_pitch|gb_roll"
    r"|drone_speed[xyz]|h\.s|v\.s|h)"
    rf"\s*[:(]?\s*{NUMBER}",
    re.IGNORECASE,
)
ZOOM = re.compile(rf"\b(focal_len|dzoom_ratio)\s*:\s*{NUMBER}", re.IGNORECASE)
GPS = re.compile(r"\b(?:GPS|RTK)\s*\(([^()]{1,80})\)")
HEMISPHERE = re.compile(rf"\b([NSEW])\s*:\s*{NUMBER}")
HEIGHT_M = re.compile(rf"{NUMBER}\s*m\b", re.IGNORECASE)
GIMBAL_PRY = re.compile(rf"\bG\.PRY\s*\(\s*{NUMBER}\D{{0,3}},\s*{NUMBER}\D{{0,3}},\s*{NUMBER}")
# Best first: those above the start are barometric and smooth, those above the sea may be the GPS's.
HEIGHTS = ("rel_alt", "barometer", "hb", "h", "abs_alt", "altitude", "gps_height")
GIMBAL = ("gb_yaw", "gb_pitch", "gb_roll")


@dataclass(frozen=True)
class Cue:
    """One subtitle: its named numbers by lower-case name, the pair inside GPS(...) in the file's order."""

    stamp_ns: int
    fields: dict[str, float]
    gps: tuple[float, float] | None
    gps_has_height: bool
    yaw_pitch_roll_deg: tuple[float, float, float] | None
    hfov_deg: float | None = None

    def place(self, *, latitude_first: bool) -> tuple[float, float] | None:
        """Latitude and longitude, degrees; None before the first fix (0, 0) and for what is not on earth."""
        place = self.gps if latitude_first or self.gps is None else self.gps[::-1]
        if "latitude" in self.fields and "longitude" in self.fields:
            place = self.fields["latitude"], self.fields["longitude"]
        if place is None or place == (0.0, 0.0) or abs(place[0]) > 90 or abs(place[1]) > 180:
            return None
        return place


def looks_like_dji_srt(head: bytes, path: Path) -> bool:
    """Subtitles of any kind: what is missing in them is said by `read_dji_srt`."""
    return CUE.search(as_text(head)) is not None


def read_dji_srt(path: Path) -> Telemetry:
    """Read a DJI subtitle file: velocities in the world frame, the camera's attitude where the gimbal is told."""
    counts: Counter[str] = Counter()
    cues = _ordered(_cues(as_text(log_bytes(path)), counts), counts)
    found, places = _flown(cues, counts)
    if not len(found):
        expected = "DJI subtitles with two GPS positions or more"
        got = f"{len(cues)} subtitles, too few with a position"
        raise BadInput(f"telemetry {path}", expected=expected, got=got)
    cameras = _attitudes(cues)
    name = f"DJI subtitles {path.name}: {len(found)} velocities from positions"
    name += ", gimbal attitude" if cameras else ""
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
    return [_cue(mark, body) for mark, body in zip(marks, bodies, strict=False)]


def _cue(mark: re.Match[str], body: str) -> Cue:
    hours, minutes, seconds = (int(mark[group]) for group in (1, 2, 3))
    milliseconds = int(mark[4].ljust(3, "0"))
    stamp_ns = ((hours * 60 + minutes) * 60 + seconds) * NS_PER_S + milliseconds * 1_000_000
    fields: dict[str, float] = {}
    for field in FIELD.finditer(body):
        fields.setdefault(field[1].lower().replace("longt", "long"), _number(field[2]))
    if "drone_speedx" in fields and "drone_speedy" in fields:
        fields.setdefault("h.s", math.hypot(fields["drone_speedx"], fields["drone_speedy"]))
    if "drone_speedz" in fields:
        fields.setdefault("v.s", fields["drone_speedz"])
    gps = GPS.search(body)
    inside = gps[1] if gps else ""
    for side, number in HEMISPHERE.findall(inside):
        degrees = _number(number)
        name = "latitude" if side in "NS" else "longitude"
        fields.setdefault(name, -abs(degrees) if side in "SW" else degrees)
    if height := HEIGHT_M.search(inside):
        fields.setdefault("gps_height", _number(height[1]))
    hfov_deg = _hfov_deg({name.lower(): value for name, value in ZOOM.findall(body)})
    return Cue(stamp_ns, fields, _pair(inside), "m" in inside.lower(), _gimbal(fields, body), hfov_deg)


def _number(text: str) -> float:
    return float(text.replace(",", "."))


def _pair(inside: str) -> tuple[float, float] | None:
    """The first two numbers of GPS(...): with decimal points, or with decimal commas and no point at all."""
    comma_decimals = "." not in inside and inside.count(",") >= 3
    numbers = re.findall(r"[-+]?\d{1,9}" + (r",\d{1,12}" if comma_decimals else r"(?:\.\d{1,12})?"), inside)
    return (_number(numbers[0]), _number(numbers[1])) if len(numbers) > 1 else None


def _gimbal(fields: dict[str, float], body: str) -> tuple[float, float, float] | None:
    if all(name in fields for name in GIMBAL):
        return fields["gb_yaw"], fields["gb_pitch"], fields["gb_roll"]
    match = GIMBAL_PRY.search(body)
    return (_number(match[3]), _number(match[1]), _number(match[2])) if match else None


def _hfov_deg(told: dict[str, str]) -> float | None:
    """Field of view of the sensor's width: focal_len is mm, or tenths without decimals, dzoom_ratio 1 or 10000."""
    focal_mm, zoom = _number(told.get("focal_len", "0")), _number(told.get("dzoom_ratio", "1"))
    focal_mm *= 0.1 if focal_mm >= 100 and told["focal_len"].isdigit() else 1
    focal_mm *= zoom / 10_000 if zoom >= 1000 else zoom
    equivalent_mm = millimetres(focal_mm)
    return None if equivalent_mm is None else fov_of_equivalent_deg(equivalent_mm)


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
    places = place_track(stamps_ns, places_deg, altitudes_m, SEA_LEVEL, Counter())
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
