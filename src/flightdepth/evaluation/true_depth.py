"""The true depth of a flight's frames, from a folder of files that somebody else wrote."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.evaluation.truth_files import ENDINGS, read_stored
from flightdepth.outputs.cloud import pixel_rays
from flightdepth.outputs.encoding import FARTHEST, UNIT_M
from flightdepth.runtimes.arrays import Maps

WHOLE_PER_M, FLOAT_PER_M = 1 / UNIT_M, 1.0  # stored numbers that make a metre, where nothing is said
LAST_NUMBER = re.compile(r"(\d+)\D*$")
ONE_SHAPE = 0.01  # by which share the sides' ratios of truth and depth may differ
# Lengths of rays that are so many times their depth, half a degree from 90: none is told beyond.
STEEPEST = 100.0


@dataclass(frozen=True)
class TrueDepth:
    """Truth by the frames' index, read when it is asked for.

    files   of each frame
    per_m   stored numbers that make a metre; None: 100 of whole numbers, 1 of floats
    is_ray  they tell the length of the ray, not depth along the camera's axis
    far_m   from here on it is sky
    used    those of `per_m` that were used so far
    """

    files: Mapping[int, Path]
    per_m: float | None = None
    is_ray: bool = False
    far_m: float = float("inf")
    used: set[float] = field(default_factory=set)

    def at(self, index: int, camera: Camera) -> Maps:
        """Depth of a frame in metres, float32 [h, w] at the truth's own size: NaN unknown, infinite sky.

        camera   of the frame, whose picture may have another size of the same shape

        Raises:
            BadInput: the file cannot be read, or shows another shape.
        """
        path = self.files[index]
        stored = read_stored(path)
        height, width = stored.shape
        if abs(width / height * camera.height / camera.width - 1) > ONE_SHAPE:
            expected = f"the shape of the flight's {camera.width}x{camera.height}, at any size"
            raise BadInput(f"truth {path}", expected=expected, got=f"{width}x{height}")
        truth_m = self._metres(stored)
        if self.is_ray:
            truth_m = along_axis(truth_m, camera.resized(width, height))
        return np.where(truth_m >= self.far_m, np.float32(np.inf), truth_m).astype(np.float32)

    def _metres(self, stored: NDArray[Any]) -> Maps:
        is_float = stored.dtype.kind == "f"
        per_m = self.per_m or (FLOAT_PER_M if is_float else WHOLE_PER_M)
        self.used.add(per_m)
        metres = stored.astype(np.float64) / per_m
        metres[~(metres > 0)] = np.nan
        if stored.dtype == np.uint16:  # more than it can tell
            metres[stored == FARTHEST] = np.inf
        return metres.astype(np.float32)


def truth_files(folder: Path, first: int = 0) -> dict[int, Path]:
    """The files of true depth in a folder by their frames: the last number of a name, counted from `first`.

    Raises:
        BadInput: no such folder, no such file in it, or two of one number.
    """
    if not folder.is_dir():
        raise BadInput(f"--truth {folder}", expected="a folder", got="a file" if folder.exists() else "none")
    found: dict[int, Path] = {}
    for path in sorted(_candidates(folder)):
        number = int(LAST_NUMBER.findall(path.stem)[0]) - first
        if number in found:
            got = f"{found[number].name} and {path.name}"
            raise BadInput(f"--truth {folder}", expected="one file a frame", got=got)
        found[number] = path
    if not found:
        expected = f"files that end in {' '.join(ENDINGS)}, with a frame's number in the name"
        raise BadInput(f"--truth {folder}", expected=expected, got="none")
    return found


def _candidates(folder: Path) -> Iterable[Path]:
    for path in folder.iterdir():
        is_known = path.suffix.lower() in ENDINGS and not path.name.startswith(".")
        if is_known and LAST_NUMBER.search(path.stem) and path.is_file():
            yield path


def along_axis(lengths_m: Maps, camera: Camera) -> Maps:
    """Depth along the camera's axis of rays' lengths, [H, W] through its lens; NaN where rays leave it sideways."""
    longer = np.linalg.norm(pixel_rays(camera, 1), axis=-1)
    longer[longer > STEEPEST] = np.nan
    return np.asarray(lengths_m / longer, np.float32)


def at_centres(map_hw: Maps, shape: tuple[int, int]) -> Maps:
    """What a map [H, W] says at the centres of the pixels of another size of the same view, `shape` = (h, w)."""
    rows, columns = (
        ((np.arange(count) + 0.5) * size / count).astype(np.intp)
        for count, size in zip(shape, map_hw.shape, strict=True)
    )
    return np.asarray(map_hw[rows[:, None], columns])
