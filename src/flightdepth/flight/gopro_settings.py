"""What a GoPro says of its lens: the settings in the video's moov/udta/GPMF box (HERO6 and later).

Keys, after ExifTool's GoPro tags and issues 173 and 196 of github.com/gopro/gpmf-parser:

    MINF  model                     VFOV  mode: W wide, L linear, N narrow, M medium, S, H, X the warped wide ones
    ZFOV  diagonal field of view    EISE  electronic stabilisation on (Y), EISA which: HS EIS, HS High, HS Boost
    DZOM  zoom allowed, DZST its state, 0 for none       HCTL  the horizon is levelled (crops and turns)
    POLY  angle off the axis = r0 + r1 p + r2 p^2 + ..., radians, p = ZMPL * radius / half the diagonal
    VRES  size that it holds for    ARUW, ARWA  aspect before and after the warp; equal where there is none
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from flightdepth.camera import Camera
from flightdepth.flight.gpmf import GpmfError, Record, records
from flightdepth.motion import Vector

SETTINGS_LIMIT = 1 << 20
BOX_LIMIT = 10_000  # a file of more boxes on one level is no video
WARPED = ("S", "H", "X")
FIT_PX = 1.0  # of a picture 1000 px wide: how far the fitted lens may be from the camera's own polynomial
# First two parts of the firmware's name (Open GoPro, "Supported Cameras"; GoPro's releases).
FIRMWARE_MODELS = {
    "HD4.02": "HERO4 Black",
    "HD5.02": "HERO5 Black",
    "HD6.01": "HERO6 Black",
    "HD7.01": "HERO7 Black",
    "HD8.01": "HERO8 Black",
    "HD9.01": "HERO9 Black",
    "H21.01": "HERO10 Black",
    "H22.01": "HERO11 Black",
    "H22.03": "HERO11 Black Mini",
}


@dataclass(frozen=True)
class GoproSettings:
    """Settings of one recording; an empty text or None where the file does not say."""

    model: str
    mode: str = ""
    stabilised: bool | None = None
    stabilisation: str = ""
    zoomed: bool = False
    lens: Camera | None = None

    @property
    def warped(self) -> bool:
        """Whether the mode stretches the picture unevenly: no lens model holds for it."""
        return self.mode in WARPED


def read_gopro_settings(path: Path, firmware: str) -> GoproSettings | None:
    """The settings inside a video, or what its `firmware` tag tells of the model; None of other makers' files."""
    try:
        with path.open("rb") as file:
            box = _find_box(file, path.stat().st_size, (b"moov", b"udta", b"GPMF"))
        found = {} if box is None else _settings(box)
    except (OSError, GpmfError):
        found = {}
    if "MINF" in found:
        return _gopro(found)
    model = FIRMWARE_MODELS.get(".".join(firmware.split(".")[:2]))
    return None if model is None else GoproSettings(model)


def _find_box(file: BinaryIO, end: int, names: tuple[bytes, ...]) -> bytes | None:
    """Contents of the nested MP4 box called `names`, outermost first, looked for up to byte `end`."""
    for name, start, stop in _boxes(file, file.tell(), end):
        if name == names[0]:
            file.seek(start)
            if len(names) == 1:
                return file.read(min(stop - start, SETTINGS_LIMIT))
            if (inner := _find_box(file, stop, names[1:])) is not None:
                return inner
    return None


def _boxes(file: BinaryIO, at: int, end: int) -> Iterator[tuple[bytes, int, int]]:
    """Name, start and end of the contents of each MP4 box between two bytes of a file."""
    for _ in range(BOX_LIMIT):
        file.seek(at)
        head = file.read(16)
        size, start = int.from_bytes(head[:4], "big"), at + 8
        if size == 1:
            size, start = int.from_bytes(head[8:], "big"), at + 16
        elif size == 0:
            size = end - at
        if len(head) < 8 or size < start - at or at + size > end:
            return
        yield head[4:8], start, at + size
        at += size


def _settings(box: bytes) -> dict[str, Record]:
    """The records of the device that holds the settings."""
    found: dict[str, Record] = {}
    for device in records(box):
        if device.key == "DEVC" and device.kind == "\0":
            found = {record.key: record for record in records(device.data)}
            if "MINF" in found:
                break
    return found


def _gopro(found: dict[str, Record]) -> GoproSettings:
    def text(key: str) -> str:
        return found[key].text().strip() if key in found else ""

    # "EISE" is not in the oldest files; there "EISA" alone says Y, N or a name.
    name = text("EISA")
    on = text("EISE") == "Y" if "EISE" in found else name not in ("", "N", "N/A")
    levelled = text("HCTL").lower() not in ("", "n", "off")
    zoom = _numbers(found, "DZST")
    return GoproSettings(
        text("MINF"),
        text("VFOV"),
        stabilised=on or levelled if {"EISE", "EISA"} & set(found) else None,
        stabilisation=("horizon levelling" if levelled else name) if on or levelled else "",
        zoomed=bool(len(zoom) and zoom[0]),
        lens=_lens(found),
    )


def _lens(found: dict[str, Record]) -> Camera | None:
    """The camera's own calibration, as the Kannala-Brandt lens nearest to it; None without one, or of a warp."""
    poly, scale, size = (_numbers(found, key) for key in ("POLY", "ZMPL", "VRES"))
    before, after = _numbers(found, "ARUW"), _numbers(found, "ARWA")
    warped = len(before) and len(after) and abs(after[0] / before[0] - 1) > 1e-3
    if len(poly) < 2 or not len(scale) or len(size) < 2 or warped:
        return None
    if not (np.isfinite(poly).all() and 0 < scale[0] < 10 and (size >= 2).all() and (size < 1e5).all()):
        return None
    return fitted_lens(poly, float(scale[0]), int(size[0]), int(size[1]))


def fitted_lens(poly: Vector, scale: float, width: int, height: int) -> Camera | None:
    """The fisheye camera whose angles are nearest to GoPro's polynomial, or None where none is within FIT_PX."""
    half_diagonal = float(np.hypot(width, height)) / 2
    radii_px = np.linspace(0, half_diagonal, 400)[1:]
    angles = np.polynomial.polynomial.polyval(radii_px / half_diagonal * scale, poly)
    if angles[0] <= 0 or (np.diff(angles) <= 0).any() or angles[-1] >= np.pi:
        return None
    powers = angles[:, None] ** np.array([1, 3, 5, 7, 9])
    weights, *_ = np.linalg.lstsq(powers, radii_px, rcond=None)
    focal = float(weights[0])
    if np.abs(powers @ weights - radii_px).max() > FIT_PX * width / 1000 or focal <= 0:
        return None
    distortion = tuple(float(weight) for weight in weights[1:] / focal)
    return Camera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2, distortion, "fisheye")


def _numbers(found: dict[str, Record], key: str) -> Vector:
    """The numbers of a record, in a row; none where it is missing or holds something else."""
    if key not in found:
        return np.empty(0)
    try:
        return found[key].numbers().ravel()
    except GpmfError:
        return np.empty(0)
