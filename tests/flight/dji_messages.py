"""DJI's metadata as its drones write it: protocol buffers by hand, whose fields of 0 are not written."""

import math
import struct


def varint(number):
    number &= (1 << 64) - 1  # two's complement, as an int32 too is written
    found = bytearray()
    while number > 0x7F:
        found.append(number & 0x7F | 0x80)
        number >>= 7
    return bytes([*found, number])


def field(number, value):
    """An int as a varint, a float as a double, bytes as they are; nothing for 0."""
    if isinstance(value, bytes):
        return varint(number << 3 | 2) + varint(len(value)) + value
    if isinstance(value, float):
        return varint(number << 3 | 1) + struct.pack("<d", value)
    return varint(number << 3) + varint(value) if value else b""


def float_32(number, value):
    return varint(number << 3 | 5) + struct.pack("<f", value) if value else b""


def angles(*tenths):
    return b"".join(field(number, each) for number, each in enumerate(tenths, 1))


def position(place_deg, above_sea_mm, *, degrees=False, says_so=True):
    """Field 4 of the flight: place and height; `place_deg` None: no fix."""
    unit = 1.0 if degrees else math.pi / 180
    latitude, longitude = place_deg or (0.0, 0.0)
    told = field(2, latitude * unit) + field(3, longitude * unit) if place_deg else b""
    return field(1, field(1, int(degrees and says_so)) + told) + field(2, above_sea_mm)


def header(protocol, model=b"DJI"):
    return field(
        1, field(1, field(1, b"dvtm_" + protocol + b".proto") + field(5, b"1581F") + field(10, model))
    )


def picture(
    number,
    place_deg,
    *,
    above_start_mm=0.0,
    drone=(0, 0, 0),
    gimbal=None,
    flight=3,
    above_sea_mm=80_000,
    **units,
):
    """Field 3 of a packet: its picture. `drone`: roll, pitch, yaw; `gimbal`: pitch, roll, yaw; tenths of a degree."""
    nest = field(3, angles(*drone)) + field(4, position(place_deg, above_sea_mm, **units))
    nest += b"" if above_start_mm is None else field(5, float_32(1, above_start_mm))
    camera = b"" if gimbal is None else field(4, field(3, angles(*gimbal)))
    return field(3, field(1, field(1, number) + field(2, 33_366 * number)) + field(flight, nest) + camera)
