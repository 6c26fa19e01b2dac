"""A video file: sound pictures out of its container, with the times that this gives them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from av.error import FFmpegError

from flightdepth.flight.container import open_container, timed_stream
from flightdepth.flight.decoding import NO_KEY_FRAME_YET, SoundPictures
from flightdepth.flight.deinterlacing import deinterlaced
from flightdepth.flight.display_matrix import turn_of
from flightdepth.flight.picture import Picture
from flightdepth.flight.records import NS_PER_S
from flightdepth.flight.spherical import refuse_sphere
from flightdepth.flight.universal_time import UniversalTime
from flightdepth.flight.video_clock import VideoClock, rewind

LEAST_MISSING_NS = NS_PER_S  # at the end of a file that is read from its middle on


class VideoFile:
    """An open video file, to be read once. Times are container times, relative to the stream's start.

    A picture that is damaged or built on a damaged one, has no time, is not later than the one before or long after
    those that follow it is left out and counted.
    """

    utc: UniversalTime | None = None

    def __init__(self, path: Path) -> None:
        self.path = path
        self._container = open_container(path)
        try:
            self._stream = timed_stream(path, self._container)
            self._stream.thread_type = "AUTO"
            self._clock = VideoClock(self._container, self._stream)
        except BaseException:
            self.close()
            raise
        self.duration_ns = self._clock.duration_ns

    def close(self) -> None:
        """Close the file."""
        self._container.close()

    @property
    def size_bytes(self) -> int:
        """Of the file."""
        return self.path.stat().st_size

    @property
    def tags(self) -> dict[str, str]:
        """What the container and its video stream say of themselves, by lower-case name."""
        told = {**self._stream.metadata, **self._container.metadata}
        return {str(name).lower(): str(value).strip() for name, value in told.items()}

    @property
    def pixel_aspect(self) -> float:
        """Width of a pixel over its height, as stored; 1 where the file does not say."""
        told = self._stream.sample_aspect_ratio
        return float(told) if told else 1.0

    def count_between(self, start_ns: int, end_ns: int | None) -> int | None:
        """About how many pictures lie in a part, None where the file does not say."""
        rate = self._stream.average_rate
        if rate is None or not self.duration_ns:
            return self._stream.frames or None
        last_ns = self.duration_ns if end_ns is None else min(end_ns, self.duration_ns)
        return max(0, round((last_ns - start_ns) / NS_PER_S * float(rate)))

    def pictures(self, start_ns: int, counts: Counter[str]) -> Iterator[Picture]:
        """Sound pictures with strictly rising times, from one that is not after the start on, if the file has it.

        FFmpeg may seek too far: MPEG-TS has no index of key frames, and of H.264 that refreshes bit by bit the key
        frames that the container names are none to the decoder. Then it is sought farther back.
        """
        before, back_ns = counts.copy(), 0
        while True:
            again = self._seek(start_ns, back_ns)
            begin_by = self._clock.ticks_at(start_ns) if again else None
            pictures = self._timed(start_ns, counts, begin_by)
            first = next(pictures, None)
            if not again or (first is not None and first.stamp_ns <= start_ns):
                break
            back_ns = max(2 * back_ns, NS_PER_S)
            counts.clear()
            counts.update(before)
        if again:
            del counts[NO_KEY_FRAME_YET]  # before the start: not missed
        if first is not None:
            refuse_sphere(self.path, self._container, first.decoded)
            yield first
        yield from pictures

    def _timed(self, start_ns: int, counts: Counter[str], begin_by: int | None) -> Iterator[Picture]:
        """Sound pictures with strictly rising times, from where the container stands."""
        last_ns, step_ns = -1, 0
        whole = start_ns == 0
        sound = SoundPictures(self._container, self._stream, counts, whole=whole, begin_by=begin_by)
        for stamp_ns, picture, after_damage in self._clock.stamped(deinterlaced(sound), counts):
            yield Picture(stamp_ns, picture, turn_of(picture), after_damage)
            last_ns, step_ns = stamp_ns, stamp_ns - last_ns
        # What was read and is damaged is counted as such.
        read_ns = last_ns if sound.read_pts is None else self._clock.stamp_ns(sound.read_pts)
        missing_ns = self._clock.promised_end_ns(whole=whole) - max(read_ns, start_ns)
        if missing_ns - step_ns > LEAST_MISSING_NS:  # each picture is shown for a while
            counts["seconds missing at the end of the file"] = round(missing_ns / NS_PER_S)

    def _seek(self, start_ns: int, back_ns: int) -> bool:
        """Go to a key frame, `back_ns` before the start or earlier; False where that is the file's beginning."""
        if start_ns == 0:
            return False
        try:
            if back_ns >= start_ns:
                rewind(self._container)
                return False
            self._container.seek(self._clock.ticks_at(start_ns - back_ns), stream=self._stream)
        except FFmpegError:
            return False  # not seekable: decoding from the beginning gives the same frames, later
        return True
