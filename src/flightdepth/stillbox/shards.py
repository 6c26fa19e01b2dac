"""A set as WebDataset shards: tar files, `stillbox-256-000000.tar` and so on, a hundred scenes each.

One sample is one scene: `000123.json` (its metadata), then `000123.00.jpg`, `000123.00.npy`, `000123.01.jpg` ...
A shard gets its name when it is complete and on the disk; the headers hold no time and no owner, so that the same
set is the same bytes.
"""

from __future__ import annotations

import io
import json
import os
import tarfile
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from flightdepth.stillbox.encoding import EncodedScene

SCENES_PER_SHARD = 100


class Shards:
    """A set of `scenes` scenes on its way to the disk, from where it stands; they are added in order."""

    def __init__(self, folder: Path, name: str, arguments: dict[str, Any], scenes: int) -> None:
        self._folder, self._name, self._total = folder, name, scenes
        self._head = {"fov": arguments["fov"], "resolution": arguments["resolution"]}
        self._shard: _Shard | None = None

    @property
    def standing(self) -> int:
        """Scenes in complete shards."""
        shards = 0
        while _path(self._folder, self._name, shards * SCENES_PER_SHARD).exists():
            shards += 1
        return min(shards * SCENES_PER_SHARD, self._total)

    def __enter__(self) -> Shards:
        return self

    def __exit__(self, *_: object) -> None:
        if self._shard is not None:
            self._shard.drop()

    def add(self, scene: EncodedScene) -> None:
        """Write the next scene into its shard; the last one of a shard gives it its name."""
        if self._shard is None:
            self._shard = _Shard(_path(self._folder, self._name, scene.number))
        self._shard.add(scene, self._head)
        if (scene.number + 1) % SCENES_PER_SHARD == 0 or scene.number + 1 == self._total:
            self._shard.finish()
            self._shard = None


def forget_short_shard(folder: Path, name: str, scenes: int) -> None:
    """Remove the last shard of a set of `scenes` scenes unless it is full: in a larger set it holds more."""
    if scenes % SCENES_PER_SHARD:
        _path(folder, name, scenes).unlink(missing_ok=True)


def _path(folder: Path, name: str, number: int) -> Path:
    """The shard of scene `number`."""
    return folder / f"{name}-{number // SCENES_PER_SHARD:06d}.tar"


class _Shard:
    """A tar file that takes its name when it is complete, and leaves nothing otherwise."""

    def __init__(self, path: Path) -> None:
        self._path, self._partial = path, path.with_name(f".{path.name}.part")
        self._file = self._partial.open("wb")
        self._tar = tarfile.open(fileobj=self._file, mode="w", format=tarfile.USTAR_FORMAT)  # noqa: SIM115 - closed by finish

    def add(self, scene: EncodedScene, head: dict[str, Any]) -> None:
        for name, data in _members(scene, head):
            header = tarfile.TarInfo(name)  # time 0, nobody's
            header.size = len(data)
            self._tar.addfile(header, io.BytesIO(data))

    def finish(self) -> None:
        self._tar.close()
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()
        self._partial.replace(self._path)

    def drop(self) -> None:
        with suppress(OSError):  # a full disk refuses the last bytes once more
            self._file.close()
        self._partial.unlink(missing_ok=True)


def _members(scene: EncodedScene, head: dict[str, Any]) -> Iterator[tuple[str, bytes]]:
    key = f"{scene.number:06d}"
    yield f"{key}.json", json.dumps({"number": scene.number} | head | scene.facts, allow_nan=False).encode()
    for frame, (picture, depth) in enumerate(zip(scene.pictures, scene.depths, strict=True)):
        yield f"{key}.{frame:02d}.jpg", picture
        yield f"{key}.{frame:02d}.npy", depth
