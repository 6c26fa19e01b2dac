"""The table of known lenses, lenses.toml: what is published of the cameras that drones carry."""

from __future__ import annotations

import math
import tomllib
from difflib import get_close_matches
from functools import cache
from importlib.resources import files

from pydantic import BaseModel, ConfigDict, Field

from flightdepth.camera import Camera, Model
from flightdepth.errors import BadInput

HALF_DIAGONAL_35MM = math.hypot(36, 24) / 2  # a "35 mm equivalent" focal length compares diagonals
CERTAIN_ERROR = 0.05  # of the focal length; what may be farther off is never taken unasked
CONTRADICTION = 0.1  # between what the user gives and what the file, or the camera's turns, tell for certain
SAME_SHAPE = 0.02  # 854x480 and 848x480 pass for 16:9


class Lens(BaseModel):
    """One entry of lenses.toml, where its fields are explained; `focal` is a share of the picture's width."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str = Field(pattern=r"^[a-z0-9-]+$")
    camera: str
    mode: str
    models: tuple[str, ...] = ()
    code: str | None = None
    stabilised: tuple[str, ...] = ()
    aspect: tuple[int, int] | None = None
    up_to_width: int | None = None
    model: Model = "pinhole"
    hfov_deg: float | None = None
    equivalent_mm: float | None = None
    sensor: tuple[int, int] = (4, 3)
    focal: float | None = None
    distortion: tuple[float, ...] = ()
    diagonal_deg: float | None = None
    error: float = Field(gt=0, le=0.2)
    source: str

    @property
    def horizontal_fov_deg(self) -> float:
        """Of a picture at the table's shape, whichever way the entry tells it."""
        return self._seen(3600, 2025).horizontal_fov_deg

    def fits(self, width: int, height: int) -> bool:
        """Whether the entry holds for pictures of this size, landscape."""
        if self.up_to_width is not None and width > self.up_to_width:
            return False
        shape = width / height
        if self.aspect is None:
            return shape > self.sensor[0] / self.sensor[1] * (1 - SAME_SHAPE)
        return abs(shape * self.aspect[1] / self.aspect[0] - 1) < SAME_SHAPE

    def seen(self, width: int, height: int) -> Camera:
        """The camera of pictures of this size, landscape; a shape that the entry does not know is refused."""
        if not self.fits(width, height):
            expected = f"the mode it holds for: {self.mode}"
            mend = "Calibrate it (docs/cameras.md), or give --hfov DEGREES."
            raise BadInput(f"camera {self.name}", expected=expected, got=f"{width}x{height}", mend=mend)
        return self._seen(width, height)

    def _seen(self, width: int, height: int) -> Camera:
        if self.focal is not None:
            focal, cx, cy = self.focal * width, (width - 1) / 2, (height - 1) / 2
            return Camera(width, height, focal, focal, cx, cy, self.distortion, self.model)
        hfov_deg = self.hfov_deg
        if hfov_deg is None:
            hfov_deg = fov_of_equivalent_deg(self.equivalent_mm or math.nan, self.sensor)
        return Camera.from_fov(width, height, hfov_deg, model=self.model)


def fov_of_equivalent_deg(equivalent_mm: float, sensor: tuple[int, int] = (4, 3)) -> float:
    """Horizontal field of view of the whole width of a `sensor` shape, from a 35 mm equivalent focal length.

    Equal diagonals: tan(fov / 2) = (half the width / half the diagonal) * 21.6 mm / focal.
    """
    wide, high = sensor
    return math.degrees(2 * math.atan(wide / math.hypot(wide, high) * HALF_DIAGONAL_35MM / equivalent_mm))


def millimetres(told: str | float) -> float | None:
    """A 35 mm equivalent that a lens may have: of a number, or of a tag such as "26.00mm"; None of anything else."""
    try:
        value = float(told.lower().removesuffix("mm") if isinstance(told, str) else told)
    except ValueError:
        return None
    return value if 5 < value < 2000 else None


@cache
def known_lenses() -> tuple[Lens, ...]:
    """All entries, in the table's order."""
    text = files("flightdepth.flight").joinpath("lenses.toml").read_text("utf-8")
    return tuple(Lens.model_validate(entry) for entry in tomllib.loads(text)["lens"])


def find_lens(name: str) -> Lens:
    """The entry called `name`."""
    by_name = {lens.name: lens for lens in known_lenses()}
    if name not in by_name:
        near = get_close_matches(name.lower(), by_name, n=3, cutoff=0.4)
        mend = f"Near: {', '.join(near)}." if near else "`flightdepth cameras` lists the names."
        raise BadInput(
            f"camera {name}", expected="a calibration file or a name that is known", got="neither", mend=mend
        )
    return by_name[name]
