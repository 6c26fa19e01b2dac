"""Pictures of a flight with their times: of a video file, or of a folder of pictures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Generator, Iterator
from itertools import chain
from pathlib import Path
from types import TracebackType

from flightdepth.errors import BadInput, FlightDepthError
from flightdepth.flight.display_matrix import turned_upright
from flightdepth.flight.mask import PictureMask
from flightdepth.flight.picture import Picture
from flightdepth.flight.picture_folder import PictureFolder
from flightdepth.flight.records import LATEST_NS, NS_PER_S, Frame, seconds
from flightdepth.flight.universal_time import UniversalTime
from flightdepth.flight.video_file import VideoFile


class Video:
    """One pass over the pictures of a video file, or of a folder of pictures. Times count from the first picture.

    What cannot be used is left out and counted in `counts`; see `VideoFile` and `PictureFolder`. Pictures are turned
    upright, and mirrored, where the file says so. `duration_ns` is what the file claims, 0 where it does not say;
    `frame_count_hint` is about how many pictures will be delivered, for progress bars, None where the file does not
    say. `mask` tells who looks at the pictures where they show the scene; it has their size. `rate_hz` is that of a
    folder's pictures, whose names tell no times.
    """

    def __init__(
        self,
        path: Path,
        *,
        start_s: float | None = None,
        end_s: float | None = None,
        mask: PictureMask | None = None,
        rate_hz: float | None = None,
    ) -> None:
        self.path, self._rate_hz = path, rate_hz
        self.start_ns, self.end_ns = _interval(start_s, end_s)
        self.counts: Counter[str] = Counter()
        self._is_over = False
        self._source = _open(path, rate_hz)
        self._chosen = self._between()
        try:
            self.duration_ns = self._source.duration_ns
            self.frame_count_hint = self._source.count_between(self.start_ns, self.end_ns)
            first = next(self._chosen, None)
            if first is None:
                raise self._no_frame()
            self._first = first
            self.mask = None if mask is None else mask.at(*self.size)
        except BaseException:
            self.close()
            raise

    def again(self, *, start_s: float | None = None, end_s: float | None = None) -> Video:
        """Another pass, over another part."""
        return Video(self.path, start_s=start_s, end_s=end_s, rate_hz=self._rate_hz)

    def __enter__(self) -> Video:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; no more pictures come."""
        self._is_over = True
        self._chosen.close()
        self._source.close()

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the upright pictures."""
        return self._first.size

    @property
    def quarter_turns(self) -> int:
        """How often the pictures are turned by 90 degrees, anticlockwise, 0..3, to stand upright."""
        return self._first.turn.quarter_turns

    @property
    def pixel_aspect(self) -> float:
        """Width of a pixel as a share of its height, in the upright pictures; 1 where the file does not say."""
        aspect = self._source.pixel_aspect
        return 1 / aspect if self.quarter_turns % 2 else aspect

    @property
    def tags(self) -> dict[str, str]:
        """What the file says of itself, by lower-case name."""
        return self._source.tags

    @property
    def size_bytes(self) -> int:
        """Size of the file, or of all pictures."""
        return self._source.size_bytes

    @property
    def utc(self) -> UniversalTime | None:
        """When the first picture was taken, where the pictures' names tell it."""
        return self._source.utc

    def frames(self) -> Iterator[Frame]:
        """The pictures from `start_s` (included) to `end_s` (left out), in time order; once, before `close`.

        Raises:
            FlightDepthError: they were asked for before, or the file is closed.
        """
        if self._is_over:
            raise FlightDepthError(f"{self.path} is read once, while it is open: open it again")
        self._is_over = True
        index, damaged = 0, False
        for picture in chain([self._first], self._chosen):
            damaged |= picture.after_damage
            if picture.size != self.size:
                self.counts["frames of another size than the first"] += 1
                continue
            image = turned_upright(picture.decoded, picture.turn)
            yield Frame(index, picture.stamp_ns, image, after_damage=damaged, picture=picture.name)
            index, damaged = index + 1, False

    def _between(self) -> Generator[Picture]:
        damaged = False  # carried over to the next picture where one falls away
        for chosen in self._source.pictures(self.start_ns, self.counts):
            if self.end_ns is not None and chosen.stamp_ns >= self.end_ns:
                break
            damaged |= chosen.after_damage
            if chosen.stamp_ns >= self.start_ns:
                yield chosen._replace(after_damage=damaged)
                damaged = False

    def _no_frame(self) -> BadInput:
        if self.start_ns == 0 and self.end_ns is None:
            return BadInput(
                f"video {self.path}", expected="at least one picture that can be decoded", got="none"
            )
        end = "the end" if self.end_ns is None else seconds(self.end_ns)
        # With an end the part may just lie between two pictures, and the last one is shown for a while.
        shown_ns = self.duration_ns / (self._source.count_between(0, None) or 1)
        cut = self.end_ns is None and self.start_ns < self.duration_ns - shown_ns
        return BadInput(
            f"video {self.path}",
            expected=f"pictures between {seconds(self.start_ns)} and {end}",
            got=f"a video of {seconds(self.duration_ns)}" + (" that was cut off before" if cut else ""),
            mend="Change --start or --end.",
        )


def _open(path: Path, rate_hz: float | None) -> PictureFolder | VideoFile:
    if path.is_dir():
        return PictureFolder(path, rate_hz)
    if rate_hz is not None and path.exists():
        raise BadInput("--rate", expected="a folder of pictures", got=f"{path}, which tells its own times")
    return VideoFile(path)


def _interval(start_s: float | None, end_s: float | None) -> tuple[int, int | None]:
    for name, value in (("--start", start_s), ("--end", end_s)):
        if value is not None and not 0 <= value * NS_PER_S <= LATEST_NS:
            raise BadInput(name, expected="seconds since the video's start", got=str(value))
    start_ns = 0 if start_s is None else round(start_s * NS_PER_S)
    end_ns = None if end_s is None else round(end_s * NS_PER_S)
    if end_ns is not None and end_ns <= start_ns:
        raise BadInput("--end", expected=f"more than {seconds(start_ns)}", got=seconds(end_ns))
    return start_ns, end_ns
