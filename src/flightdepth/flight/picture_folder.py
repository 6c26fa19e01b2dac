"""A folder of pictures as a video: their order and their times by their names, or at a rate that is given."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import cached_property
from pathlib import Path

import numpy as np

from flightdepth.cluster import ahead
from flightdepth.errors import BadInput
from flightdepth.flight.file_bytes import head_of
from flightdepth.flight.picture import Picture
from flightdepth.flight.picture_names import Named, by_number, by_time, periods, pictures_in
from flightdepth.flight.records import NS_PER_S
from flightdepth.flight.still import EQUIVALENT, decoded, exif_tags, turn_in
from flightdepth.flight.universal_time import UniversalTime

LOWEST_HZ, HIGHEST_HZ = 0.001, 10_000.0
READERS, AHEAD = 2, 4  # threads, and pictures that they have read before they are asked for
DAMAGED = "pictures that are damaged or cannot be read"
NOT_LATER = "frames not later than the one before"
LEFT_OUT = "pictures whose numbers are left out"


class PictureFolder:
    """The pictures that lie directly in a folder, to be read once. Times count from the first of them.

    Names that are times tell these, and when the first picture was taken (`utc`); of others, which differ in one
    number, `rate_hz` tells them. A picture that is damaged, or not later than the one before, is left out and counted.
    None leans on another, so that damage ends with its picture. `tags` is what the first one tells of its lens.

    Raises:
        BadInput: no pictures, several series, no rate where the names tell no times, or one where they do.
    """

    pixel_aspect = 1.0

    def __init__(self, path: Path, rate_hz: float | None = None) -> None:
        self._path = path
        self.tags: dict[str, str] = {}
        self.utc: UniversalTime | None = None
        self._periods: list[int] = []  # of numbered ones, since the first
        names = pictures_in(path)
        pictures = by_time(names)
        if pictures is not None:
            self._stamps_ns = self._told(pictures, rate_hz)
        else:
            pictures = by_number(path, names)
            self._stamps_ns = self._at_rate(pictures, rate_hz)
        self._names = [picture.name for picture in pictures]

    def _told(self, pictures: Sequence[Named], rate_hz: float | None) -> list[int]:
        first = pictures[0]
        if rate_hz is not None:
            got = f"{first.name}, whose name is its time"
            raise BadInput("--rate", expected="pictures whose names are no times", got=got)
        self.utc = UniversalTime.of(first.number, "names")
        return [picture.number - first.number for picture in pictures]

    def _at_rate(self, pictures: Sequence[Named], rate_hz: float | None) -> list[int]:
        if rate_hz is None:
            raise BadInput(
                f"pictures in {self._path}",
                expected="names that are times since 1970",
                got=pictures[0].name,
                mend="Tell how many were taken a second: --rate HZ.",
            )
        if not LOWEST_HZ <= rate_hz <= HIGHEST_HZ:  # True for NaN too
            raise BadInput("--rate", expected=f"{LOWEST_HZ:g} to {HIGHEST_HZ:g} Hz", got=f"{rate_hz:g}")
        self._periods = periods(self._path, pictures)
        return [round(period * NS_PER_S / rate_hz) for period in self._periods]

    def close(self) -> None:
        """No file stays open; readers end with the iterator of `pictures`."""

    @property
    def duration_ns(self) -> int:
        """From the first picture to the end of the last, which is shown as long as half of the others at least."""
        steps = np.diff(self._stamps_ns)
        return self._stamps_ns[-1] + (int(np.median(steps)) if len(steps) else 0)

    @cached_property
    def size_bytes(self) -> int:
        """Of all pictures."""
        size = 0
        for name in self._names:
            with suppress(OSError):  # a link may lead nowhere
                size += (self._path / name).stat().st_size
        return size

    def count_between(self, start_ns: int, end_ns: int | None) -> int:
        """How many pictures lie in a part."""
        end = len(self._names) if end_ns is None else bisect_left(self._stamps_ns, end_ns)
        return max(0, end - bisect_left(self._stamps_ns, start_ns))

    def pictures(self, start_ns: int, counts: Counter[str]) -> Iterator[Picture]:
        """Sound pictures with strictly rising times, from the first that is not before the start on."""
        wanted = range(bisect_left(self._stamps_ns, start_ns), len(self._names))
        last_ns = -1
        with ThreadPoolExecutor(READERS, "pictures") as readers:
            read = ahead(wanted, lambda at: readers.submit(self._read, at), AHEAD)
            for at, picture in zip(wanted, read, strict=True):
                if at > wanted.start and (left_out := self._left_out_before(at)):
                    counts[LEFT_OUT] += left_out
                if self._stamps_ns[at] <= last_ns:
                    counts[NOT_LATER] += 1
                elif (found := picture.result()) is None:
                    counts[DAMAGED] += 1
                else:
                    if not self.tags and (focal := exif_tags(found.decoded).get(EQUIVALENT)) is not None:
                        self.tags = {EQUIVALENT: focal}
                    yield found
                    last_ns = found.stamp_ns

    def _left_out_before(self, at: int) -> int:
        return max(0, self._periods[at] - self._periods[at - 1] - 1) if self._periods else 0

    def _read(self, at: int) -> Picture | None:
        data = head_of(self._path / self._names[at], -1)
        picture = decoded(data)
        if picture is None:
            return None
        return Picture(self._stamps_ns[at], picture, turn_in(data), name=self._names[at])
