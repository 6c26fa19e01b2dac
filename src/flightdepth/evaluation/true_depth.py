"""The true depth of a flight's frames, from a folder of files that somebody else wrote."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.evaluation.truth_files import ENDINGS, read_stored
from flightdepth.flight.picture_names import Named, by_number, by_time
from flightdepth.flight.records import NS_PER_S
from flightdepth.outputs.encoding import FARTHEST, UNIT_M
from flightdepth.runtimes.arrays import Maps
from flightdepth.runtimes.lens import pixel_rays

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
    far_m   from here on, as it is stored, it is sky
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
            return np.asarray(truth_m / lengths_of_rays(camera.resized(width, height)), np.float32)
        return truth_m

    def _metres(self, stored: NDArray[Any]) -> Maps:
        is_float = stored.dtype.kind == "f"
        per_m = self.per_m or (FLOAT_PER_M if is_float else WHOLE_PER_M)
        self.used.add(per_m)
        metres = stored.astype(np.float64) / per_m
        metres[~(metres > 0)] = np.nan
        if stored.dtype.kind == "u" and stored.dtype.itemsize == 2:  # more than it can tell
            metres[stored == FARTHEST] = np.inf
        metres[metres >= self.far_m] = np.inf
        return metres.astype(np.float32)


def truth_files(folder: Path) -> dict[int, Path]:
    """The files of true depth in a folder by the last number of their names.

    Raises:
        BadInput: no such folder, no such file in it, or two of one number.
    """
    if not folder.is_dir():
        raise BadInput(f"--truth {folder}", expected="a folder", got="a file" if folder.exists() else "none")
    found: dict[int, Path] = {}
    for path in sorted(_candidates(folder)):
        number = int(LAST_NUMBER.findall(path.stem)[0])
        if number in found:
            got = f"{found[number].name} and {path.name}"
            mend = "Give the truth a folder of its own."
            raise BadInput(f"--truth {folder}", expected="one file a frame", got=got, mend=mend)
        found[number] = path
    if not found:
        expected = f"files that end in {' '.join(ENDINGS)}, with a frame's number in the name"
        raise BadInput(f"--truth {folder}", expected=expected, got="none")
    return found


class Matched(NamedTuple):
    """Files of true depth by their frames, and how many others there are.

    spans   what the others' names tell beside the frames: numbers, or times
    first   the number that frame 0 has in their names; None where these are times
    """

    files: dict[int, Path]
    of_no_frame: int
    spans: str
    first: int | None


def matched(folder: Path, pictures: Mapping[int, str], first: int | None = None) -> Matched:
    """The files of true depth in a folder by a flight's frames, in the order of these.

    pictures   name of each frame's file, by its index; empty of a video
    first      the number that frame 0 has; None: the frames' own, or those that their pictures have in their names.
               Where the pictures' names are times and so are those of the truth, the nearest counts that is not
               farther off than half of the time between two pictures.

    Raises:
        BadInput: as of `truth_files`, or no file is of any frame.
    """
    named = first is None and all(pictures.values())
    moments = by_time(list(pictures.values())) if named else None
    if moments is not None and folder.is_dir():
        told = by_time([path.name for path in _candidates(folder)])
        if told is not None:
            return _matched_by_time(folder, pictures, moments, told)
    if named and moments is None:
        of_names = {picture.name: picture.number for picture in by_number(folder, list(pictures.values()))}
        numbers = {index: of_names[name] for index, name in pictures.items()}
    else:
        numbers = {index: index + (first or 0) for index in pictures}
    files = truth_files(folder)
    found = {index: files[number] for index, number in numbers.items() if number in files}
    told_span = f"{min(files)} to {max(files)}"
    span = f"{min(numbers.values())} to {max(numbers.values())}" if numbers else "none: no frame"
    if not found:
        raise BadInput(
            f"--truth {folder}",
            expected=f"numbers {span}, of this flight's frames",
            got=told_span,
            mend="Give --first N, the number that frame 0 has there.",
        )
    spans = f"their numbers are {told_span}, the frames' {span} (--first)"
    return Matched(found, len(files) - len(found), spans, numbers.get(0))


def _matched_by_time(
    folder: Path, pictures: Mapping[int, str], moments: Sequence[Named], told: Sequence[Named]
) -> Matched:
    names = nearest_in_time(moments, told)
    found = {index: folder / names[name] for index, name in pictures.items() if name in names}
    span, told_span = (
        f"{named[0].number / NS_PER_S:.3f} to {named[-1].number / NS_PER_S:.3f} s"
        for named in (moments, told)
    )
    if not found:
        expected = f"times within half a step of the pictures', {span} since 1970"
        raise BadInput(f"--truth {folder}", expected=expected, got=told_span)
    spans = f"their times are {told_span}, the pictures' {span}"
    return Matched(found, len(told) - len(set(found.values())), spans, None)


def nearest_in_time(pictures: Sequence[Named], others: Sequence[Named]) -> dict[str, str]:
    """Of each picture the other nearest in time, by their names; none farther off than half a usual step of them.

    Both are in the order of their times, ns.
    """
    times_ns = np.array([other.number for other in others], np.int64)
    steps_ns = np.diff([picture.number for picture in pictures])
    farthest_ns = float(np.median(steps_ns)) / 2 if len(steps_ns) else 0.0
    found: dict[str, str] = {}
    for picture in pictures:
        off_ns = np.abs(times_ns - picture.number)
        nearest = int(off_ns.argmin())
        if off_ns[nearest] <= farthest_ns:
            found[picture.name] = others[nearest].name
    return found


def _candidates(folder: Path) -> Iterable[Path]:
    for path in folder.iterdir():
        is_known = path.suffix.lower() in ENDINGS and not path.name.startswith(".")
        if is_known and LAST_NUMBER.search(path.stem) and path.is_file():
            yield path


@lru_cache(2)
def lengths_of_rays(camera: Camera) -> Maps:
    """How many times its depth the ray through a pixel is long, [H, W]; NaN where rays leave the lens sideways."""
    longer = np.asarray(np.linalg.norm(pixel_rays(camera, 1), axis=-1), np.float32)
    longer[longer > STEEPEST] = np.nan
    return longer


def at_centres(map_hw: Maps, shape: tuple[int, int]) -> Maps:
    """What a map [H, W] says at the centres of the pixels of another size of the same view, `shape` = (h, w)."""
    rows, columns = (
        ((np.arange(count) + 0.5) * size / count).astype(np.intp)
        for count, size in zip(shape, map_hw.shape, strict=True)
    )
    return np.asarray(map_hw[rows[:, None], columns])
