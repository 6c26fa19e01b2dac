"""The lens of a camera from a photograph that it took: the focal length in the EXIF tags."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from av.error import FFmpegError

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.flight.container import open_container
from flightdepth.flight.file_bytes import head_of
from flightdepth.flight.lenses import fov_of_equivalent_deg, millimetres
from flightdepth.flight.still import EQUIVALENT, exif_tags

EXPECTED = "a photograph whose EXIF tags tell the 35 mm equivalent focal length"
JPEG = b"\xff\xd8\xff"


class Photograph(NamedTuple):
    """The ideal camera of a photograph, and a line on where it comes from."""

    camera: Camera
    source: str


def is_photograph(path: Path) -> bool:
    """Whether a file is a JPEG, by its first bytes."""
    return head_of(path, len(JPEG)) == JPEG


def read_photograph(path: Path) -> Photograph:
    """The camera of a JPEG by its EXIF tags, which FFmpeg reads."""
    try:
        with open_container(path) as container:
            picture = next(container.decode(video=0))
    except (FFmpegError, StopIteration) as error:
        raise BadInput(f"camera {path}", expected=EXPECTED, got="a broken JPEG") from error
    tags = exif_tags(picture)
    equivalent_mm = millimetres(tags.get(EQUIVALENT, ""))
    if equivalent_mm is None:
        got = "no FocalLengthIn35mmFilm"
        raise BadInput(f"camera {path}", expected=EXPECTED, got=got, mend="Give --hfov DEGREES instead.")
    width, height = picture.width, picture.height
    # The equivalent compares diagonals, so the picture's own shape counts.
    hfov_deg = fov_of_equivalent_deg(equivalent_mm, (width, height))
    model = tags.get("model", "a camera without a name")
    source = f"photograph {path.name} by {model}: {equivalent_mm:g} mm, {hfov_deg:.1f} degrees"
    return Photograph(Camera.from_fov(width, height, hfov_deg), source)
