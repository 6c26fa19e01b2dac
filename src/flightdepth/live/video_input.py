"""The thread that reads a stream: opens it, opens it again when it breaks, and keeps the newest picture."""

from __future__ import annotations

import re
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass

from av.error import ExitError, FFmpegError

from flightdepth.errors import FlightDepthError
from flightdepth.flight.decoding import READ_ERROR
from flightdepth.live.picture_clock import NO_REPORT, PictureClock
from flightdepth.live.rtp_stream import RtpStream
from flightdepth.live.slots import Newest
from flightdepth.live.video_address import RTP, VideoAddress
from flightdepth.live.video_stream import READ_S, Picture, StreamEnded, VideoStream

FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.25, 4.0
NOT_TAKEN = "a newer picture came first"
ENDED = "the run ended first"


@dataclass(frozen=True)
class VideoListener:
    """Who hears of the stream, on its thread: each picture (live clock), why it broke, why its clock is distrusted,
    and why a file is over before its end.
    """

    on_picture: Callable[[int], None]
    on_error: Callable[[str], None]
    on_distrusted: Callable[[str], None]
    on_cut: Callable[[str], None] = lambda why: None


class VideoInput:
    """Reads `address` on a thread of its own from `start` to `close`; `slot` holds the newest picture.

    delay_ns      the camera's fixed delay, exposure to sending
    sender_clock  believe the sender's wall clock (RTCP)
    epoch_ns      when a file's first picture is due

    `reconnects` counts how often the stream was opened again; `ended` is set when a file is over; `error`
    holds what killed the thread, if anything did; `distrusted` is PictureClock's.
    """

    def __init__(
        self,
        address: VideoAddress,
        listener: VideoListener,
        *,
        delay_ns: int = 0,
        sender_clock: bool = False,
        epoch_ns: int = 0,
    ) -> None:
        self.slot: Newest[Picture] = Newest()
        self.received = 0
        self.reconnects = 0
        self.ended = threading.Event()
        self.error: BaseException | None = None
        self.distrusted: str | None = None
        self._counts: Counter[str] = Counter()
        self._counted: Counter[str] = Counter()  # when the last picture came, or the stream was opened
        self._address, self._listener = address, listener
        self._delay_ns, self._sender_clock, self._epoch_ns = delay_ns, sender_clock, epoch_ns
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._work, name="video", daemon=True)

    def start(self) -> None:
        """Begin to read."""
        self._thread.start()

    def close(self) -> None:
        """Stop reading; a read that hangs is left behind after its timeout."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(READ_S + 1)
        if self.slot.take(0) is not None:
            self._counts[ENDED] += 1

    @property
    def dropped(self) -> dict[str, int]:
        """What never reached the estimator, by reason."""
        return dict(Counter(self._counts) + Counter({NOT_TAKEN: self.slot.replaced}))

    @property
    def instead(self) -> str | None:
        """What came most since the last picture, and was none."""
        most = (Counter(self._counts) - self._counted).most_common(1)
        return f"{most[0][1]} {most[0][0]}" if most else None

    def _work(self) -> None:
        try:
            self._keep_reading()
        except BaseException as error:  # carried to the owner, who raises it
            self.error = error
        finally:
            self.ended.set()

    def _keep_reading(self) -> None:
        failures = 0
        while not self._stop.is_set():
            before = self.received
            try:
                self._read()
                return  # a file is over, or we were told to stop
            except (FFmpegError, OSError, ValueError, StreamEnded) as error:
                if self._address.paced:
                    self._cut_short(error)
                    return
                self._listener.on_error(in_words(error))
                # Who waited in vain waits no longer: in a pause nobody hears a sender that comes back.
                waited = self.received > before or isinstance(error, TimeoutError | ExitError)
            failures = 0 if waited else failures + 1
            self._stop.wait(pause_s(failures))
            self.reconnects += 1

    def _cut_short(self, error: Exception) -> None:
        """A file cannot be read on: it is over there, as for `flightdepth run`, unless it never began."""
        why = in_words(error)
        if not self.received or not isinstance(error, OSError | FFmpegError):
            raise FlightDepthError(f"video {self._address.name}: {why}") from error
        self._counts[READ_ERROR] += 1
        self._listener.on_cut(why)

    def _read(self) -> None:
        clock = PictureClock(
            self._delay_ns, wall_from_sender=self._sender_clock, same_clock=self._address.same_clock
        )
        self._counted = Counter(self._counts)
        with closing(self._open()) as stream:
            for picture in self._pictures(stream, clock):
                now_ns = time.monotonic_ns()
                self.received += 1
                self._counted = Counter(self._counts)
                self.slot.put(picture)
                self._listener.on_picture(now_ns)
                self._tell_distrust(clock.distrusted)

    def _tell_distrust(self, why: str | None) -> None:
        changed, self.distrusted = why != self.distrusted, why
        if changed and why is not None and why != NO_REPORT:  # the first report may come seconds later
            self._listener.on_distrusted(why)

    def _open(self) -> VideoStream | RtpStream:
        if self._address.format == RTP:
            return RtpStream(self._address.target, self._counts)
        return VideoStream(self._address, self._counts)

    def _pictures(self, stream: VideoStream | RtpStream, clock: PictureClock) -> Iterator[Picture]:
        if isinstance(stream, VideoStream) and self._address.paced:
            return stream.paced(self._epoch_ns, self._delay_ns, self._stop)
        return stream.pictures(clock, self._stop)


def pause_s(failures: int) -> float:
    """Seconds to wait before opening again: doubles with each failure in a row, up to LONGEST_PAUSE_S."""
    return float(min(FIRST_PAUSE_S * 2 ** min(failures, 10), LONGEST_PAUSE_S))


def in_words(error: Exception) -> str:
    """FFmpeg's error without its number and without the address, which may hold a password."""
    if isinstance(error, ExitError):
        return "nothing came in time"
    text = getattr(error, "strerror", None) or str(error)
    return re.sub(r"\s*'[^']*'", "", " ".join(text.split())).rstrip(": ")
