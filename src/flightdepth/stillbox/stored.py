"""Sets in the original folder layout, read scene by scene: the authors' or this package's own."""

from __future__ import annotations

import hashlib
import json
import random
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.scenes.pictures import read_picture
from flightdepth.scenes.scene import Floats, displacement
from flightdepth.stillbox.camera_path import path_from
from flightdepth.stillbox.encoding import DEPTH_CLIP_M
from flightdepth.stillbox.original_layout import METADATA
from flightdepth.stillbox.pairs import Depth, Image

TRAIN_PERCENT = 80


@dataclass(frozen=True)
class StoredScene:
    """A scene read back; its world has the axes of the first frame's camera.

    images              uint8 RGB [F, H, W, 3]
    depth_m             float32 z-depth [F, H, W]; the original clips it to 0.1..200 m
    camera_position     [F, 3] metres
    world_from_camera   [F, 3, 3]
    """

    images: NDArray[np.uint8]
    depth_m: NDArray[np.float32]
    camera_position: Floats
    world_from_camera: Floats

    @property
    def frames(self) -> int:
        """Number of camera positions."""
        return len(self.camera_position)

    @property
    def is_open(self) -> bool:
        """The original has closed rooms alone."""
        return False

    def displacement(self, previous: int, current: int) -> Floats:
        """Position at `current` minus that at `previous`, metres, in `current`'s orientation, shape (3,)."""
        return displacement(self.camera_position, self.world_from_camera, previous, current)


@dataclass(frozen=True)
class StoredSet:
    """Scenes of a folder, in the order of its sub-folders and their metadata; pictures are read when asked for.

    `renderer` is the one that the metadata names; the original names none.
    """

    folder: Path
    width: int
    height: int
    horizontal_fov_deg: float
    renderer: str
    entries: tuple[tuple[Path, dict[str, Any]], ...]

    def __len__(self) -> int:
        return len(self.entries)

    @property
    def camera(self) -> Camera:
        """The ideal pinhole camera of every picture."""
        return Camera.from_fov(self.width, self.height, self.horizontal_fov_deg)

    @cached_property
    def steps_m(self) -> tuple[float, float]:
        """Shortest and longest way between two frames next to each other, in all scenes, metres."""
        even = [facts for _, facts in self.entries if "position" not in facts]
        steps = [np.linalg.norm(facts["speed"]) * facts["time_step"] for facts in even]
        for facts in (facts for _, facts in self.entries if "position" in facts):
            steps += list(np.linalg.norm(np.diff(path_from(facts)[0], axis=0), axis=1))
        return float(min(steps)), float(max(steps))

    @property
    def digest(self) -> str:
        """Short hash of the scenes' metadata, in their order."""
        facts = [(place.name, scene) for place, scene in self.entries]
        return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:16]

    @property
    def turns(self) -> bool:
        """Whether the camera turns from picture to picture."""
        orientations = (facts.get("orientation") or [None] for _, facts in self.entries)
        return any(each != turns[0] for turns in orientations for each in turns)

    def __iter__(self) -> Iterator[StoredScene]:
        return (self.scene(number) for number in range(len(self)))

    def scene(self, number: int) -> StoredScene:
        """Read scene `number`.

        Raises:
            BadInput: a file is missing, damaged, or not of the set's size; the file is named.
        """
        place, facts = self.entries[number]
        size = (self.height, self.width)
        position, orientation = path_from(facts)
        return StoredScene(
            np.stack([_picture(place / name, size) for name in facts["imgs"]]),
            np.stack([_depth(place / name, size) for name in facts["depth"]]),
            position,
            orientation,
        )

    def split(self, seed: int = 0) -> tuple[StoredSet, StoredSet]:
        """80 % of the shuffled scenes to train with, and the others: the authors' split, if theirs lists by name."""
        # Shuffled from where sub-folders stand by name, 100 before 11.
        entries = sorted(self.entries, key=lambda entry: entry[0].name)
        random.Random(seed).shuffle(entries)
        first = len(entries) * TRAIN_PERCENT // 100
        return replace(self, entries=tuple(entries[:first])), replace(self, entries=tuple(entries[first:]))


def open_stored_set(folder: Path | str) -> StoredSet:
    """The set in `folder`.

    Raises:
        BadInput: there is no metadata, some of it is damaged or lacks what is needed, or sizes differ.
    """
    folder = Path(folder)
    paths = sorted(folder.glob(f"*/{METADATA}"), key=lambda path: _place_of(path.parent.name))
    if not paths:
        mend = "Shards are not read: render with --format folder." if any(folder.glob("*.tar")) else None
        raise BadInput(f"set {folder}", expected=f"sub-folders with {METADATA}", got="none", mend=mend)
    heads, entries = set(), []
    for path in paths:
        head, scenes = _metadata(path)
        heads.add(head)
        if len(heads) > 1:
            raise BadInput(
                f"metadata {path}",
                expected="one resolution, field of view and renderer in a set",
                got=str(head),
            )
        entries += [(path.parent, scene) for scene in scenes]
    if not entries:
        raise BadInput(f"set {folder}", expected="at least one scene", got="none")
    return StoredSet(folder, *heads.pop(), tuple(entries))


def _place_of(name: str) -> tuple[bool, int, str]:
    """What sub-folders are sorted by: numbers first, 100 after 99, then other names."""
    is_number = name.isdecimal()
    return not is_number, int(name) if is_number else 0, name


def unclipped(depth_m: Depth) -> Depth:
    """Stored depth, float32 metres, with what stands at the layout's clip infinite: that far or farther, a sky."""
    return np.where(depth_m < DEPTH_CLIP_M[1], depth_m, np.float32(np.inf))


def _metadata(path: Path) -> tuple[tuple[int, int, float, str], list[dict[str, Any]]]:
    """(width, height, field of view in degrees, renderer) and the scenes of one sub-folder."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        arguments = found.get("args") or {}
        width, height = (int(n) for n in found.get("resolution") or arguments["resolution"])
        fov = float(found.get("fov") or arguments["fov"])
        Camera.from_fov(width, height, fov)  # which refuses what no camera has
        for number, scene in enumerate(found["scenes"]):
            _check(scene, f"scene {number}")
        return (width, height, fov, str(arguments.get("renderer", "unknown"))), found["scenes"]
    except BadInput as error:
        raise BadInput(f"metadata {path}, {error}") from error
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        got = f"no {error}" if isinstance(error, KeyError) else str(error)
        raise BadInput(f"metadata {path}", expected="that of a Still Box folder", got=got) from error


def _check(scene: dict[str, Any], where: str) -> None:
    """Refuse a scene whose numbers do not fit together."""
    names, frames = scene["imgs"] + scene["depth"], len(scene["imgs"])
    for key in ("depth", "orientation", "position"):  # the last two are not in every set
        count = len(scene.get(key) or scene["imgs"])
        if frames == 0 or count != frames:
            raise BadInput(f"{where}, {key}", expected=f"one for each of {frames} imgs", got=str(count))
    outside = [name for name in names if Path(name).name != name]
    if outside:
        raise BadInput(where, expected="names of files beside the metadata", got=outside[0])
    try:
        position, orientation = path_from(scene)
    except BadInput as error:
        raise BadInput(f"{where}, {error}") from error
    if position.shape != (frames, 3) or not (np.isfinite(position).all() and np.isfinite(orientation).all()):
        raise BadInput(
            where, expected="speed [right, up, forward] and time_step, finite", got=str(scene["speed"])
        )


def _picture(path: Path, size: tuple[int, int]) -> Image:
    image = read_picture(path)
    if image is None or image.shape != (*size, 3):
        got = "a missing or damaged one" if image is None else f"{image.shape[1]}x{image.shape[0]}"
        raise BadInput(f"picture {path}", expected=f"an image of {size[1]}x{size[0]} px", got=got)
    return image


def _depth(path: Path, size: tuple[int, int]) -> Depth:
    expected = f"a depth map of {size[1]}x{size[0]} metres"
    try:
        depth_m = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise BadInput(f"depth {path}", expected=expected, got=" ".join(str(error).split())) from error
    if not isinstance(depth_m, np.ndarray) or depth_m.shape != size or depth_m.dtype.kind != "f":
        got = f"{depth_m.dtype} {depth_m.shape}" if isinstance(depth_m, np.ndarray) else "an archive"
        raise BadInput(f"depth {path}", expected=expected, got=got)
    if not (depth_m > 0).all():
        raise BadInput(
            f"depth {path}", expected="depth above 0 everywhere", got=f"{(~(depth_m > 0)).sum()} others"
        )
    return np.asarray(depth_m, dtype=np.float32)
