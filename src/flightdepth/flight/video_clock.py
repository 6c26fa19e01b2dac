"""Times of a video stream: its container's ticks, and nanoseconds since its first picture."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from fractions import Fraction
from typing import Any

import av
from av.error import FFmpegError

from flightdepth.flight.order import Doubt, is_long_after, with_jumps
from flightdepth.flight.records import NS_PER_S


def numbers_packets(container: Any) -> bool:
    """Whether it has no times, as AVI: FFmpeg numbers packets as they lie, and the one that brought a picture out tells
    its place.
    """
    return bool(container.format.name == "avi")


def rewind(container: Any) -> None:
    """Go to the beginning. Times may begin below 0: those of MPEG-TS whose counter overflows within the file do.

    Raises:
        FFmpegError: the container cannot be sought in.
    """
    start = container.start_time or 0  # microseconds
    container.seek(0 if start >= 0 else start - av.time_base)


class VideoClock:
    """Of the `stream` of a container that stands at its beginning.

    `duration_ns` is what the file claims, 0 where it does not say.
    """

    def __init__(self, container: Any, stream: Any) -> None:
        self._container, self._stream = container, stream
        self._by_packet = numbers_packets(container)
        self._origin = self._find_origin()
        self.duration_ns = self._find_duration_ns()

    def ticks_of(self, picture: Any, before: int | None = None) -> int | None:
        """When a picture is shown, ticks; `before` of the one before it. None where nothing tells."""
        if not self._by_packet:
            return picture.pts  # type: ignore[no-any-return]
        if picture.dts is None and before is not None:
            return before + 1  # the last ones come out when there are no packets left; a tick is a picture
        return picture.dts  # type: ignore[no-any-return]

    def stamped(
        self,
        pictures: Iterable[tuple[Any, bool]],
        counts: Counter[str],
        is_doubted: Doubt = is_long_after,
    ) -> Iterator[tuple[int, Any, bool]]:
        """Decoded pictures, in order of display, with strictly rising times since the first picture.

        pictures    each with whether damage lies between it and the one before, which is carried over where that goes
        counts      of what is left out: what has no time, or one that does not fit those around it
        is_doubted  of which times it is asked whether they fit those that follow
        """
        last_ns, damaged = -1, False
        for stamp_ns, (picture, after_damage), jumps in with_jumps(self._times(pictures, counts), is_doubted):
            damaged |= after_damage
            if jumps:
                counts["frames whose time jumps ahead"] += 1
            elif stamp_ns <= last_ns:
                counts["frames not later than the one before"] += 1
            else:
                yield stamp_ns, picture, damaged
                last_ns, damaged = stamp_ns, False

    def ticks_at(self, stamp_ns: int) -> int:
        """The tick at a time since the first picture, or the last one before it."""
        return self._origin + int(Fraction(stamp_ns, NS_PER_S) / self._stream.time_base)

    def stamp_ns(self, ticks: int) -> int:
        """Time since the first picture."""
        return self._nanoseconds(ticks - self._origin)

    def promised_end_ns(self, *, whole: bool) -> int:
        """Where the file's head promises the last picture, 0 where it does not, or where they are counted anyway."""
        if self._stream.frames:
            return 0 if whole else self.duration_ns
        silent = not self._container.streams.audio  # which may last longer
        if silent and "matroska" in self._container.format.name:
            return self.duration_ns - self._nanoseconds(self._origin)
        return 0

    def _times(
        self, pictures: Iterable[tuple[Any, bool]], counts: Counter[str]
    ) -> Iterator[tuple[int, tuple[Any, bool]]]:
        ticks, damaged = None, False
        for picture, after_damage in pictures:
            damaged |= after_damage
            if (ticks := self.ticks_of(picture, ticks)) is None:
                counts["frames without a time"] += 1
            else:
                yield self.stamp_ns(ticks), (picture, damaged)
                damaged = False

    def _find_origin(self) -> int:
        """Time of the first picture, ticks; some containers tell it only with the first packet or picture."""
        if self._stream.start_time is not None and not self._by_packet:
            return int(self._stream.start_time)
        try:
            first = next(
                self._container.decode(self._stream)
                if self._by_packet
                else self._container.demux(self._stream)
            )
            rewind(self._container)
        except (FFmpegError, StopIteration):
            return 0
        return self.ticks_of(first) or 0

    def _find_duration_ns(self) -> int:
        if self._stream.duration is not None:
            return self._nanoseconds(self._stream.duration)
        return int((self._container.duration or 0) * NS_PER_S // av.time_base)

    def _nanoseconds(self, ticks: int) -> int:
        return int(ticks * self._stream.time_base * NS_PER_S)
