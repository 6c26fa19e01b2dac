"""The lens of a camera from a photograph that it took: the focal length in the EXIF tags."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from av.error import FFmpegError

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.flight.container import open_container
from flightdepth.flight.file_bytes import head_of
from flightdepth.flight.lenses import fov_of_equivalent_deg

EXPECTED = "a photograph whose EXIF tags tell the 35 mm equivalent focal length"
EQUIVALENT = "FocalLengthIn35mmFilm"
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
    tags = {name.rpartition("/")[2]: value.strip() for name, value in picture.metadata.items()}
    try:
        equivalent_mm = float(tags.get(EQUIVALENT, "0"))
    except ValueError:
        equivalent_mm = 0.0
    if not 5 < equivalent_mm < 2000:
        got = f"no {EQUIVALENT}"
        raise BadInput(f"camera {path}", expected=EXPECTED, got=got, mend="Give --hfov DEGREES instead.")
    width, height = picture.width, picture.height
    # The equivalent compares diagonals, so the picture's own shape counts.
    hfov_deg = fov_of_equivalent_deg(equivalent_mm, (width, height))
    model = tags.get("Model", "a camera without a name")
    source = f"photograph {path.name} by {model}: {equivalent_mm:g} mm, {hfov_deg:.1f} degrees"
    return Photograph(Camera.from_fov(width, height, hfov_deg), source)
