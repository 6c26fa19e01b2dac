"""One connection to a stream, or one pass over a file in real time: packets in, stamped pictures out."""

from __future__ import annotations

import logging
import struct
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from typing import Any

import av
import av.logging
import numpy as np
from numpy.typing import NDArray

from flightdepth.errors import FlightDepthError
from flightdepth.flight.container import main_stream
from flightdepth.flight.decoding import GAP, file_packets
from flightdepth.flight.display_matrix import upright
from flightdepth.flight.records import NS_PER_S
from flightdepth.flight.video_clock import VideoClock
from flightdepth.live.backlog import Backlog
from flightdepth.live.picture_clock import PictureClock
from flightdepth.live.sound_decoder import SoundDecoder
from flightdepth.live.status import AgeFrom
from flightdepth.live.video_address import VideoAddress

# A read that waits longer than READ_S is given up, so that a silent stream is noticed within two seconds.
OPEN_S, READ_S = 5.0, 1.5
EMPTY_S = 0.002  # between two looks for a picture where FFmpeg does not wait for it, as on macOS
MISSED = "RTP: missed"
SILENT = logging.NullHandler()  # one for all connections: a second time a logger does not add it
Told = list[tuple[int, str, str]]  # level, who, what
_listeners, _listening = 0, threading.Lock()
BEHIND = "packets thrown away because decoding fell behind"
# A file's picture that is due so long ago is passed over: the machine slept, or is too slow.
LATE_NS = NS_PER_S


class StreamEnded(FlightDepthError):
    """The sender closed the stream."""


@dataclass(frozen=True, eq=False)
class Picture:
    """A decoded picture, not yet RGB: most are dropped where the machine cannot keep up."""

    decoded: Any
    stamp_ns: int
    age_from: AgeFrom

    def rgb(self) -> NDArray[np.uint8]:
        """uint8 RGB [H, W, 3], upright."""
        return upright(self.decoded)


class VideoStream:
    """An open stream or file; iterate `pictures()` once, then `close()`.

    Damaged packets and pictures are left out and counted in `counts`.
    """

    def __init__(self, address: VideoAddress, counts: Counter[str]) -> None:
        self._address, self._counts = address, counts
        self._container = av.open(
            address.source(),
            format=address.format,
            options=dict(address.options),
            timeout=(OPEN_S, READ_S),
        )
        if not self._container.streams.video:
            self._container.close()
            raise StreamEnded("it has no video")
        self._stream = main_stream(self._container)
        if address.rtp:
            # A thread of FFmpeg's that logs waits for Python, while Python, freeing the codec, waits for that thread.
            self._stream.codec_context.thread_count = 1
        self._decoder = SoundDecoder(self._stream.codec_context, counts)
        self._backlog = Backlog()

    def close(self) -> None:
        """Close the connection."""
        self._container.close()

    def pictures(self, clock: PictureClock, stop: threading.Event) -> Iterator[Picture]:
        """Pictures as they come, stamped by `clock`; raises StreamEnded or FFmpegError when it breaks.

        FFmpeg and the system keep what is not read yet: where it piles up, it is thrown away up to the newest.
        """
        log: AbstractContextManager[Told] = losses_told() if self._address.rtp else nullcontext([])
        with log as told:
            for packet in self._packets():
                if stop.is_set():
                    return
                if any(MISSED in text for _, _, text in told):
                    self._counts["gaps in the RTP packets"] += 1
                    self._decoder.damage(packet.pts)
                told.clear()
                if packet.pts is not None and self._tell(clock, packet):
                    self._counts[BEHIND] += 1
                    self._decoder.skip_to_key_frame()
                    continue
                for decoded in self._decoder.decode(packet):
                    yield Picture(self._owned(decoded), *clock.stamp(self._nanoseconds(decoded.pts)))
        raise StreamEnded("it ended")

    def paced(self, epoch_ns: int, delay_ns: int, stop: threading.Event) -> Iterator[Picture]:
        """A file's pictures, each when it is due; its stream begins at `epoch_ns`, as a log beside it does."""
        clock = VideoClock(self._container, self._stream)

        def is_doubted(own_ns: int, *before: int) -> bool:
            return epoch_ns + own_ns > time.monotonic_ns() + LATE_NS  # there is time to look ahead

        late: tuple[int, int] | None = None  # since when, and by how much then
        for own_ns, decoded, _ in clock.stamped(self._file_pictures(), self._counts, is_doubted):
            due_ns = epoch_ns + own_ns
            now_ns = time.monotonic_ns()
            ahead_ns = due_ns - now_ns
            if stop.wait(max(0, ahead_ns) / NS_PER_S):
                return
            if ahead_ns < -LATE_NS:
                self._counts["pictures of a file that could not be read in time"] += 1
                late = late or (now_ns, -ahead_ns)
                if now_ns - late[0] > LATE_NS and -ahead_ns >= late[1]:
                    self._decoder.skip_to_key_frame()  # decoding each it does not catch up
                    late = None
                continue
            late = None
            yield Picture(decoded, due_ns - delay_ns, "reception")

    def _file_pictures(self) -> Iterator[tuple[Any, bool]]:
        for packet in file_packets(self._container, self._stream, self._gap):
            for decoded in self._decoder.decode(packet):
                yield decoded, False  # of damage in between nobody asks here

    def _packets(self) -> Iterator[Any]:
        packets = self._container.demux(self._stream)
        asked_ns = time.monotonic_ns()
        while True:
            try:
                packet = next(packets, None)
            except BlockingIOError as error:  # a camera that has no picture yet, as macOS says it
                if time.monotonic_ns() - asked_ns > READ_S * NS_PER_S:
                    raise TimeoutError("nothing came in time") from error
                time.sleep(EMPTY_S)
                packets = self._container.demux(self._stream)
                continue
            if packet is None:
                return
            now_ns = time.monotonic_ns()
            self._backlog.read(now_ns, now_ns - asked_ns)
            yield packet
            asked_ns = time.monotonic_ns()

    def _gap(self) -> None:
        self._counts[GAP] += 1
        self._decoder.damage(None)

    def _owned(self, decoded: Any) -> Any:
        """A picture that outlives the stream: raw ones lie in the camera driver's memory, which goes with it."""
        raw = self._stream.codec_context.name == "rawvideo"
        return decoded.reformat(format="rgb24", threads=1) if raw else decoded

    def _tell(self, clock: PictureClock, packet: Any) -> bool:
        """Let the clock hear of a packet; whether it lay in a queue, and is to be thrown away."""
        sender_wall_ns = None
        if packet.has_sidedata("prft"):
            # AVProducerReferenceTime: microseconds since 1970, then flags.
            (wall_us,) = struct.unpack_from("<q", bytes(packet.get_sidedata("prft")))
            sender_wall_ns = wall_us * 1000
        own_ns, now_ns = self._nanoseconds(packet.pts), time.monotonic_ns()
        clock.packet(
            own_ns,
            now_ns,
            sender_wall_ns=sender_wall_ns,
            wall_now_ns=time.time_ns(),
            queued=self._backlog.hurried,
        )
        return self._backlog.skips(clock.late_ns(own_ns, now_ns))

    def _nanoseconds(self, ticks: int) -> int:
        return int(ticks * self._stream.time_base * NS_PER_S)


@contextmanager
def losses_told() -> Iterator[Told]:
    """FFmpeg's warnings of this thread: the only word there is of lost RTP packets.

    The decoder fills what they held with guesses and calls few of those pictures damaged: with 3 % of the packets
    lost, 4 of about 30. Only meanwhile does FFmpeg's log go through Python: see `VideoStream`.
    """
    logging.getLogger("libav").addHandler(SILENT)  # said in counts, not on stderr
    _listen(1)
    try:
        with av.logging.Capture(local=True) as told:
            yield told
    finally:
        _listen(-1)


def _listen(change: int) -> None:
    global _listeners  # noqa: PLW0603
    with _listening:
        _listeners += change
        av.logging.set_level(av.logging.WARNING if _listeners else None)
