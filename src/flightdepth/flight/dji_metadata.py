"""DJI's metadata inside a video (djmd): for each picture the drone's place and height, its angles and its gimbal's.

A protocol buffer a picture, which DJI does not describe; field numbers after ExifTool 13.59 (its module DJI.pm), whose
author found them in users' videos. The first packet names the protocol, such as dvtm_Mini4_Pro.proto. A picture's
message is field 3 of its packet. In it, in the nest whose number LAYOUTS has, stand

    3  the drone's roll, pitch and yaw: 1, 2, 3 (tenths of a degree)
    4  1: the place: 1 is 1 where in degrees, else they are radians; 2, 3: latitude, longitude (doubles)
       2: mm above the sea (an integer)
    5  1: mm above the start (a float)

and the gimbal's pitch, roll and yaw as 1, 2, 3 of 3 of the camera's nest. Velocities come from the places
(positions.py), and angles mean what they mean in the subtitles (dji_srt.py).
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flightdepth.errors import BadInput
from flightdepth.flight.data_track import DAMAGED, track_packets
from flightdepth.flight.gimbal import looking_along, turned
from flightdepth.flight.order import rising_counted
from flightdepth.flight.places import SEA_LEVEL
from flightdepth.flight.positions import place_track, velocities_by_fixes
from flightdepth.flight.protobuf_wire import Message, ProtobufError, Value, message_of, real, signed
from flightdepth.flight.records import AttitudeSample, BodyAttitudeSample, Telemetry, by_time
from flightdepth.motion import Vector

PROTOCOL = re.compile(rb"dvtm_([\w-]+)\.proto")
HEADER_BYTES = 400  # of the first packet, in which the protocol's name stands
PICTURE = 3
DRONE, PLACE, ABOVE_START, GIMBAL = 3, 4, 5, 3
# Fields of yaw, pitch and roll in a message of angles.
DRONE_ANGLES, GIMBAL_ANGLES = (3, 2, 1), (3, 1, 2)

Angles = tuple[float, float, float]  # yaw, pitch, roll, degrees


class Layout(NamedTuple):
    """Numbers of the nests in a picture's message: of the flight, and of the camera where it has a gimbal."""

    flight: int
    camera: int | None


GIMBALLED = Layout(flight=3, camera=4)  # Mavic 3 and 4, Air 3, Mini 4 and 5, Matrice 30 and 4
LAYOUTS = {"AVATA2": Layout(flight=4, camera=None), "dji_neo": Layout(flight=4, camera=None)}
IN_DEGREES = ("Mavic4", "Mini5Pro")  # without saying so


@dataclass(frozen=True)
class Told:
    """What one picture's message tells: degrees, NaN before the first fix; metres, NaN where none; angles, or None."""

    stamp_ns: int
    place_deg: tuple[float, float]
    above_sea_m: float
    above_start_m: float
    drone: Angles | None
    gimbal: Angles | None


def read_dji_metadata(path: Path) -> Telemetry | None:
    """What the metadata track of a video says; None where there is none, as in a folder.

    Raises:
        BadInput: there is one, with fewer than two places.
    """
    counts: Counter[str] = Counter()
    protocol, told = ("", []) if path.is_dir() else _told(path, counts)
    if not protocol:
        return None
    told = [told[index] for index in rising_counted([each.stamp_ns for each in told], counts, "pictures")]
    stamps_ns = np.array([each.stamp_ns for each in told], dtype=np.int64)
    places_deg = np.array([each.place_deg for each in told]).reshape(-1, 2)
    found = velocities_by_fixes(stamps_ns, places_deg, _heights_m(told), counts)
    name = f"DJI metadata in the video ({protocol})"
    if not len(found):
        got = f"{len(told)} pictures, too few with a position"
        mend = "Give --telemetry LOG or --speed M_S."
        raise BadInput(name, expected="two GPS positions or more", got=got, mend=mend)
    cameras = [AttitudeSample(each.stamp_ns, looking_along(*each.gimbal)) for each in told if each.gimbal]
    bodies = [BodyAttitudeSample(each.stamp_ns, turned(*each.drone)) for each in told if each.drone]
    above_sea_m = np.array([each.above_sea_m for each in told])
    return Telemetry(
        f"{name}: {len(found)} velocities from positions" + (", gimbal attitude" if cameras else ""),
        by_time(found.samples(), cameras),
        dict(+counts),
        body_attitudes=tuple(bodies),
        # Not counted: those that jump have been.
        places=place_track(stamps_ns, places_deg, above_sea_m, SEA_LEVEL),
    )


def _told(path: Path, counts: Counter[str]) -> tuple[str, list[Told]]:
    """The protocol's name, empty without such a track, and what each picture's message tells; damaged are counted."""
    protocol, told = "", []
    for interval, packet, _ in track_packets(path, "data", lambda data: bool(_protocol(data))):
        protocol = protocol or _protocol(packet)
        try:
            if picture := message_of(message_of(packet).get(PICTURE)):
                told.append(_of(picture, interval.start_ns, protocol))
        except ProtobufError:
            counts[DAMAGED] += 1
    return protocol, told


def _protocol(packet: bytes) -> str:
    match = PROTOCOL.search(packet[:HEADER_BYTES])
    return match[1].decode() if match else ""


def _of(picture: Message, stamp_ns: int, protocol: str) -> Told:
    layout = LAYOUTS.get(protocol, GIMBALLED)
    flight = message_of(picture.get(layout.flight))
    camera = {} if layout.camera is None else message_of(picture.get(layout.camera))
    position = message_of(flight.get(PLACE))
    return Told(
        stamp_ns,
        _degrees(message_of(position.get(1)), protocol),
        signed(position[2]) / 1000 if 2 in position else math.nan,
        real(message_of(flight[ABOVE_START]).get(1)) / 1000 if ABOVE_START in flight else math.nan,
        _angles(flight.get(DRONE), DRONE_ANGLES),
        _angles(camera.get(GIMBAL), GIMBAL_ANGLES),
    )


def _angles(value: Value | None, numbers: tuple[int, int, int]) -> Angles | None:
    """Those of three fields, in tenths of a degree; one that is 0 is not written."""
    if value is None:
        return None
    told = message_of(value)
    first, second, third = (signed(told.get(number)) / 10 for number in numbers)
    return first, second, third


def _degrees(place: Message, protocol: str) -> tuple[float, float]:
    if not {2, 3} <= place.keys():
        return math.nan, math.nan
    scale = 1.0 if place.get(1) == 1 or protocol in IN_DEGREES else 180 / math.pi
    return real(place[2]) * scale, real(place[3]) * scale


def _heights_m(told: Sequence[Told]) -> Vector:
    """Above the start where most pictures tell it, which is barometric and smooth, else above the sea; NaN: neither."""
    above_start_m = np.array([each.above_start_m for each in told])
    if np.isfinite(above_start_m).sum() * 2 > len(told):
        return above_start_m
    return np.array([each.above_sea_m for each in told])
