"""What one of DJI's subtitles says: position, height, speed, gimbal angles, focal length.

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

HTML tags are dropped; decimals may be written with a comma.
focal_len (35 mm equivalent) and dzoom_ratio give the field of view of a video as wide as the sensor.
Gimbal angles are yaw from north clockwise, pitch up, roll to the right, in degrees.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from flightdepth.flight.lenses import fov_of_equivalent_deg, millimetres

NUMBER = r"([-+]?\d{1,9}(?:[.,]\d{1,12})?)"
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


def cue_of(stamp_ns: int, body: str) -> Cue:
    """What a subtitle without its tags says."""
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
