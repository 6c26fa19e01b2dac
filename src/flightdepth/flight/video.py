"""Pictures of a video file, with the times that the container gives them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

from av.error import FFmpegError

from flightdepth.errors import BadInput, FlightDepthError
from flightdepth.flight.container import open_container, timed_stream
from flightdepth.flight.decoding import NO_KEY_FRAME_YET, SoundPictures
from flightdepth.flight.deinterlacing import deinterlaced
from flightdepth.flight.display_matrix import turn_of, upright
from flightdepth.flight.mask import PictureMask
from flightdepth.flight.records import LATEST_NS, NS_PER_S, Frame, seconds
from flightdepth.flight.spherical import refuse_sphere
from flightdepth.flight.video_clock import VideoClock

LEAST_MISSING_NS = NS_PER_S  # at the end of a file that is read from its middle on


class _Picture(NamedTuple):
    """A decoded picture and its time; `after_damage`: others between it and the one before were damaged."""

    stamp_ns: int
    picture: Any
    after_damage: bool


class Video:
    """One pass over the pictures of a video file. Times are container times, relative to the stream's start.

    A picture that is damaged or built on a damaged one, has no time, or is not later than the one before is left
    out and counted in `counts`. Pictures are turned upright, and mirrored, where the file says so.
    `duration_ns` is what the file claims, 0 where it does not say; `frame_count_hint` is about how many
    pictures will be delivered, for progress bars, None where the file does not say. `mask` tells who looks at the
    pictures where they show the scene; it has their size.
    """

    def __init__(
        self,
        path: Path,
        *,
        start_s: float | None = None,
        end_s: float | None = None,
        mask: PictureMask | None = None,
    ) -> None:
        self.path = path
        self.start_ns, self.end_ns = _interval(start_s, end_s)
        self.counts: Counter[str] = Counter()
        self._is_over = False
        self._container = open_container(path)
        try:
            self._stream = timed_stream(path, self._container)
            self._first = self._begin()
            self.mask = None if mask is None else mask.at(*self.size)
        except BaseException:
            self.close()
            raise

    def _begin(self) -> _Picture:
        """Find what times count from, and the first of the pictures wanted."""
        self._stream.thread_type = "AUTO"
        self._clock = VideoClock(self._container, self._stream)
        self.duration_ns = self._clock.duration_ns
        self.frame_count_hint = self._guess_frame_count()
        self._chosen = self._between()
        first = next(self._chosen, None)
        if first is None:
            raise self._no_frame()
        refuse_sphere(self.path, self._container, first.picture)
        return first

    def __enter__(self) -> Video:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._is_over = True
        self._container.close()

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the upright pictures."""
        width, height = self._first.picture.width, self._first.picture.height
        return (height, width) if self.quarter_turns % 2 else (width, height)

    @property
    def quarter_turns(self) -> int:
        """How often the pictures are turned by 90 degrees, anticlockwise, 0..3, to stand upright."""
        return turn_of(self._first.picture).quarter_turns

    @property
    def pixel_aspect(self) -> float:
        """Width of a pixel as a share of its height, in the upright pictures; 1 where the file does not say."""
        told = self._stream.sample_aspect_ratio
        aspect = float(told) if told else 1.0
        return 1 / aspect if self.quarter_turns % 2 else aspect

    @property
    def tags(self) -> dict[str, str]:
        """What the container and its video stream say of themselves, by lower-case name."""
        told = {**self._stream.metadata, **self._container.metadata}
        return {str(name).lower(): str(value).strip() for name, value in told.items()}

    def _guess_frame_count(self) -> int | None:
        rate = self._stream.average_rate
        if rate is None or not self.duration_ns:
            return self._stream.frames or None
        end_ns = self.duration_ns if self.end_ns is None else min(self.end_ns, self.duration_ns)
        return max(0, round((end_ns - self.start_ns) / NS_PER_S * float(rate)))

    def frames(self) -> Iterator[Frame]:
        """The pictures from `start_s` (included) to `end_s` (left out), in time order; once, before `close`.

        Raises:
            FlightDepthError: they were asked for before, or the file is closed.
        """
        if self._is_over:
            raise FlightDepthError(f"{self.path} is read once, while it is open: open it again")
        self._is_over = True
        index, damaged = 0, False
        size = (self._first.picture.width, self._first.picture.height)
        for stamp_ns, picture, after_damage in chain([self._first], self._chosen):
            damaged |= after_damage
            if (picture.width, picture.height) != size:
                self.counts["frames of another size than the first"] += 1
                continue
            yield Frame(index, stamp_ns, upright(picture), after_damage=damaged)
            index, damaged = index + 1, False

    def _between(self) -> Iterator[_Picture]:
        damaged = False  # carried over to the next picture where one falls away
        for chosen in self._pictures():
            if self.end_ns is not None and chosen.stamp_ns >= self.end_ns:
                break
            damaged |= chosen.after_damage
            if chosen.stamp_ns >= self.start_ns:
                yield chosen._replace(after_damage=damaged)
                damaged = False

    def _pictures(self) -> Iterator[_Picture]:
        """Sound pictures with strictly rising times, from one that is not after the start on, if the file has it.

        FFmpeg may seek too far: MPEG-TS has no index of key frames, and of H.264 that refreshes bit by bit the key
        frames that the container names are none to the decoder. Then it is sought farther back.
        """
        before, back_ns = self.counts.copy(), 0
        while True:
            again = self._seek(back_ns)
            pictures = self._timed(begin_by=self._clock.ticks_at(self.start_ns) if again else None)
            first = next(pictures, None)
            if not again or (first is not None and first.stamp_ns <= self.start_ns):
                break
            back_ns = max(2 * back_ns, NS_PER_S)
            self.counts.clear()
            self.counts.update(before)
        if again:
            del self.counts[NO_KEY_FRAME_YET]  # before the start: not missed
        if first is not None:
            yield first
        yield from pictures

    def _timed(self, begin_by: int | None) -> Iterator[_Picture]:
        """Sound pictures with strictly rising times, from where the container stands."""
        last_ns, step_ns, ticks, damaged = -1, 0, None, False
        whole = self.start_ns == 0
        sound = SoundPictures(self._container, self._stream, self.counts, whole=whole, begin_by=begin_by)
        for picture, after_damage in deinterlaced(sound):
            damaged |= after_damage
            if (ticks := self._clock.ticks_of(picture, ticks)) is None:
                self.counts["frames without a time"] += 1
            elif (stamp_ns := self._clock.stamp_ns(ticks)) <= last_ns:
                self.counts["frames not later than the one before"] += 1
            else:
                yield _Picture(stamp_ns, picture, damaged)
                last_ns, step_ns, damaged = stamp_ns, stamp_ns - last_ns, False
        # What was read and is damaged is counted as such.
        read_ns = last_ns if sound.read_pts is None else self._clock.stamp_ns(sound.read_pts)
        missing_ns = self._clock.promised_end_ns(whole=whole) - max(read_ns, self.start_ns)
        if missing_ns - step_ns > LEAST_MISSING_NS:  # each picture is shown for a while
            self.counts["seconds missing at the end of the file"] = round(missing_ns / NS_PER_S)

    def _seek(self, back_ns: int) -> bool:
        """Go to a key frame, `back_ns` before the start or earlier; False where that is the file's beginning."""
        if self.start_ns == 0:
            return False
        try:
            if back_ns >= self.start_ns:
                self._container.seek(0)
                return False
            self._container.seek(self._clock.ticks_at(self.start_ns - back_ns), stream=self._stream)
        except FFmpegError:
            return False  # not seekable: decoding from the beginning gives the same frames, later
        return True

    def _no_frame(self) -> BadInput:
        if self.start_ns == 0 and self.end_ns is None:
            return BadInput(
                f"video {self.path}", expected="at least one picture that can be decoded", got="none"
            )
        end = "the end" if self.end_ns is None else seconds(self.end_ns)
        # With an end the part may just lie between two pictures.
        cut = self.end_ns is None and self.start_ns < self.duration_ns
        return BadInput(
            f"video {self.path}",
            expected=f"pictures between {seconds(self.start_ns)} and {end}",
            got=f"a video of {seconds(self.duration_ns)}" + (" that was cut off before" if cut else ""),
            mend="Change --start or --end.",
        )


def _interval(start_s: float | None, end_s: float | None) -> tuple[int, int | None]:
    for name, value in (("--start", start_s), ("--end", end_s)):
        if value is not None and not 0 <= value * NS_PER_S <= LATEST_NS:
            raise BadInput(name, expected="seconds since the video's start", got=str(value))
    start_ns = 0 if start_s is None else round(start_s * NS_PER_S)
    end_ns = None if end_s is None else round(end_s * NS_PER_S)
    if end_ns is not None and end_ns <= start_ns:
        raise BadInput("--end", expected=f"more than {seconds(start_ns)}", got=seconds(end_ns))
    return start_ns, end_ns
