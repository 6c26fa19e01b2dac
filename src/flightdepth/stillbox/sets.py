"""What decides the files of a set: how scenes are drawn, the picture's size, the seed; and sets known by a name."""

from __future__ import annotations

import json
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar, cast

from pydantic import ValidationError

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.scenes import Scene, StillBoxConfig, Textures, draw_scene
from flightdepth.scenes.config import SET_VERSION
from flightdepth.scenes.draw import stillbox_velocity
from flightdepth.scenes.outdoor import draw_outdoor, outdoor_velocity
from flightdepth.scenes.outdoor_config import OUTDOOR_VERSION, OutdoorConfig
from flightdepth.scenes.outdoor_textures import outdoor_textures
from flightdepth.scenes.refusal import refusal
from flightdepth.scenes.scene import Floats

Config = StillBoxConfig | OutdoorConfig
ConfigT = TypeVar("ConfigT", bound=Config)

# Scenes in the original sets, by the width of their pictures.
ORIGINAL_SCENES = {64: 80_000, 128: 16_000, 256: 3_200, 512: 3_200}
# A random stream's key is taken apart into words of 32 bits: scene 0 of seed 2^32 would be scene 1 of seed 0.
LAST_SEED = 2**32 - 1


def _check_whole(name: str, value: Any, least: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise BadInput(f"{name} of a set", expected=f"a whole number from {least} on", got=repr(value))


@dataclass(frozen=True)
class SceneSet:
    """A dataset is (config, seed) at a picture size in pixels; each scene follows from its number alone."""

    config: Config
    width: int
    height: int
    seed: int

    def __post_init__(self) -> None:
        for name, least in (("width", 1), ("height", 1), ("seed", 0)):
            _check_whole(name, getattr(self, name), least)
        if self.seed > LAST_SEED:
            raise BadInput("seed of a set", expected=f"at most {LAST_SEED}", got=str(self.seed))

    @property
    def camera(self) -> Camera:
        """The ideal pinhole camera of every picture."""
        return Camera.from_fov(self.width, self.height, self.config.horizontal_fov_deg)

    @property
    def version(self) -> str:
        """Changes when the same config and seed give other scenes."""
        return f"outdoor-{OUTDOOR_VERSION}" if isinstance(self.config, OutdoorConfig) else SET_VERSION

    def own_textures(self) -> Textures | None:
        """The textures that belong to an outdoor set and its seed; None where textures are to be given."""
        return outdoor_textures(self.seed) if isinstance(self.config, OutdoorConfig) else None

    def scene(self, number: int, texture_count: int) -> Scene:
        """Scene `number`; an outdoor set knows how many textures it has."""
        if isinstance(self.config, OutdoorConfig):
            return draw_outdoor(self.config, self.seed, number)
        return draw_scene(self.config, texture_count, self.seed, number, self.height / self.width)

    def velocity(self, number: int) -> Floats:
        """The camera's velocity at each frame of scene `number`, m/s in world axes, shape [F, 3]."""
        if isinstance(self.config, OutdoorConfig):
            return outdoor_velocity(self.config, self.seed, number)
        return stillbox_velocity(self.config, self.seed, number)


# Flights in any direction, 6 s at 10 pictures a second.
ANY_FLIGHT = OutdoorConfig(frames=60, rate_hz=10.0, legs="any")
# Sets by name, and how many scenes each holds.
_NAMED = {
    str(width): (SceneSet(StillBoxConfig(), width, width, seed=1), scenes)
    for width, scenes in ORIGINAL_SCENES.items()
} | {"outdoor": (SceneSet(ANY_FLIGHT, 512, 320, seed=1), 300)}
SET_NAMES = tuple(_NAMED)
_OF_THE_SET = ("width", "height", "seed")


def named_set(name: str, /, **overrides: Any) -> tuple[SceneSet, int]:
    """A set known by its name and how many scenes it holds.

    Overrides are `scenes`, `width`, `height`, `seed` and the fields of the set's config. A width given alone to
    one of the original's sets keeps its pictures square.

    Raises:
        BadInput: no such set, an unknown key, or a value that does not fit.
    """
    if name not in _NAMED:
        raise BadInput("set", expected=f"one of {', '.join(SET_NAMES)}", got=repr(name))
    base, scenes = _NAMED[name]
    size = {key: overrides.pop(key) for key in _OF_THE_SET if key in overrides}
    if base.width == base.height and "width" in size:
        size.setdefault("height", size["width"])
    scenes = overrides.pop("scenes", scenes)
    _check_whole("scenes", scenes, 1)
    return replace(base, config=changed(base.config, overrides), **size), scenes


def changed(config: ConfigT, overrides: dict[str, Any]) -> ConfigT:
    """`config` with some fields set anew and all of it validated again.

    Raises:
        BadInput: an unknown field, or a value that does not fit.
    """
    try:
        return cast("ConfigT", type(config).model_validate(config.model_dump() | overrides))
    except ValidationError as error:
        keys = ("scenes", *_OF_THE_SET, *type(config).model_fields)
        raise refusal("set", error, {"": keys}) from error


def read_overrides(path: Path) -> dict[str, Any]:
    """Overrides for `named_set` from a .toml or .json file: one flat table of names and values.

    Raises:
        BadInput: no such file, another suffix, or not such a table.
    """
    readers = {".toml": tomllib.loads, ".json": json.loads}
    if path.suffix not in readers or not path.is_file():
        raise BadInput(f"config {path}", expected="a .toml or .json file that exists")
    try:
        found = readers[path.suffix](path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, json.JSONDecodeError, UnicodeDecodeError) as error:
        raise BadInput(f"config {path}", expected=path.suffix[1:].upper(), got=str(error)) from error
    if not isinstance(found, dict):
        raise BadInput(f"config {path}", expected="one table of names and values", got=type(found).__name__)
    return found
