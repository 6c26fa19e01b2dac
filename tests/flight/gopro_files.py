"""GoPro settings as the cameras write them: a moov/udta/GPMF box appended to a real MP4."""

import struct
from pathlib import Path

import numpy as np
from flight_files import box, klv, make_video, nest

# Radial calibration of the kind that a HERO11 writes (gpmf-parser, issue 196), without its warp.
POLY = (0.0, 1.8229533, 0.1068096, -0.6631866, 0.3563110, 0.0, 0.0)
ZMPL = 0.6549


def text(key, value):
    return klv(key, "c", 1, len(value), value.encode())


def floats(key, values):
    return klv(key, "f", 4 * len(values), 1, struct.pack(f">{len(values)}f", *values))


def settings(
    model="HERO11 Black", mode="L", eise="N", eisa="N/A", *, poly=None, size=(1920, 1080), zoom=0, more=()
):
    """The bytes of a settings box; None for a key leaves it out."""
    told = [("MINF", model), ("VFOV", mode), ("EISE", eise), ("EISA", eisa)]
    records = [text(key, value) for key, value in told if value is not None]
    records.append(klv("DZST", "L", 4, 1, struct.pack(">L", zoom)))
    if poly is not None:
        records += [
            floats("POLY", poly),
            floats("ZMPL", [ZMPL]),
            klv("VRES", "L", 4, 2, struct.pack(">2L", *size)),
            floats("ARUW", [16 / 9]),
            floats("ARWA", [16 / 9]),
        ]
    return nest("DEVC", text("DVNM", "Global Settings"), *records, *more)


def gopro_video(path: Path, payload: bytes, *, width=192, height=108) -> Path:
    """A short MP4 with the settings in its index, as GoPro places them."""
    make_video(path, range(0, 400, 40), width=width, height=height)
    data = path.read_bytes()
    moov = data.rindex(b"moov") - 4
    path.write_bytes(data[:moov] + box("moov", data[moov + 8 :], box("udta", box("GPMF", payload))))
    return path


def angle_of(radius_share):
    """GoPro's polynomial, by hand: radians off the axis at a share of half the diagonal."""
    p = np.asarray(radius_share) * ZMPL
    return sum(r * p**power for power, r in enumerate(POLY))
