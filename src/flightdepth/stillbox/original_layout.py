"""The folder layout of the original Still Box, written scene by scene.

`NN/RGB_SSSS_FF.jpg`, `NN/depth_SSSS_FF.npy` (float32 metres) and `NN/metadata.json`, a hundred scenes a folder. A
scene is named there when all of its files are on the disk, so that a crash leaves a smaller set, never a broken one.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from flightdepth.errors import BadInput
from flightdepth.files import bring_to_the_disk, write_json
from flightdepth.stillbox.encoding import EncodedScene

SCENES_PER_FOLDER = 100
METADATA = "metadata.json"
SAVE_EVERY_S = 5.0  # flushing each file would take longer than rendering it


class OriginalLayout:
    """A set on its way to the disk, from where it stands; scenes are added in the order of their numbers."""

    def __init__(
        self, folder: Path, arguments: dict[str, Any], *, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._folder, self._clock = folder, clock
        self._head = {"args": arguments, "fov": arguments["fov"], "resolution": arguments["resolution"]}
        self._place = _newest(folder)
        self._scenes = _named_scenes(self._place)
        self._saved_at, self._unsaved = clock(), False
        for left in self._place.glob(f".{METADATA}.*"):  # of a process that was killed
            left.unlink()

    @property
    def standing(self) -> int:
        """Scenes that are written and named."""
        return int(self._place.name) * SCENES_PER_FOLDER + len(self._scenes)

    def __enter__(self) -> OriginalLayout:
        return self

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        if error is None:
            self.save()
        else:  # the disk may be full; what was named before stands
            with suppress(OSError):
                self.save()

    def add(self, scene: EncodedScene) -> None:
        """Write the next scene; it is named in the metadata at the next save."""
        if len(self._scenes) == SCENES_PER_FOLDER:
            self._place, self._scenes = self._folder / _folder_name(scene.number), []
        files = _files(scene)
        self._place.mkdir(parents=True, exist_ok=True)
        try:
            for name, data in files.items():
                (self._place / name).write_bytes(data)
        except BaseException:
            for name in files:
                (self._place / name).unlink(missing_ok=True)
            raise
        self._scenes.append(scene.facts | _file_names(scene))
        self._unsaved = True
        if len(self._scenes) == SCENES_PER_FOLDER or self._clock() - self._saved_at >= SAVE_EVERY_S:
            self.save()

    def save(self) -> None:
        """Flush the scenes to the disk, then name them."""
        if self._unsaved:
            bring_to_the_disk()
            facts = {"scenes_nb": len(self._scenes), "scenes": self._scenes}
            write_json(self._place / METADATA, self._head | facts)
            self._saved_at, self._unsaved = self._clock(), False


def _newest(folder: Path) -> Path:
    """The last folder of scenes that has metadata, else the first folder."""
    number = 0
    while (folder / f"{number + 1:02d}" / METADATA).exists():
        number += 1
    return folder / f"{number:02d}"


def _named_scenes(place: Path) -> list[dict[str, Any]]:
    path = place / METADATA
    if not path.exists():
        return []
    try:
        scenes: list[dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))["scenes"]
    except (ValueError, KeyError, TypeError) as error:
        raise BadInput(f"metadata {path}", expected="JSON with scenes", got=str(error)) from error
    return scenes


def _folder_name(number: int) -> str:
    return f"{number // SCENES_PER_FOLDER:02d}"


def _file_names(scene: EncodedScene) -> dict[str, list[str]]:
    place, frames = scene.number % SCENES_PER_FOLDER, range(len(scene.pictures))
    return {
        "imgs": [f"RGB_{place:04d}_{frame:02d}.jpg" for frame in frames],
        "depth": [f"depth_{place:04d}_{frame:02d}.npy" for frame in frames],
    }


def _files(scene: EncodedScene) -> dict[str, bytes]:
    names = _file_names(scene)
    return dict(zip(names["imgs"] + names["depth"], scene.pictures + scene.depths, strict=True))
