"""Where pictures are whole again after damage without a key frame, and where packets are missing without a word.

An encoder that refreshes its pictures strip by strip (intra refresh) sends no key frame after its first. It says where
such a refresh begins and how long it takes (recovery point SEI). FFmpeg heeds that only in a decoder that begins anew:

- H.264's is let go on, since it tells damage only in pictures that it gives, and the frames are counted here.
- H.265's gives nothing at all after a missing picture, so it begins anew where a refresh does, and counts itself.

Where a whole packet is missing, H.264's decoder gives pictures built on another one instead, and none is marked.
"""

from __future__ import annotations

from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from av.error import FFmpegError

from flightdepth.flight.video_headers import FrameNumber, H264Headers, h265_begins, size_bytes

# H.265 tells damage only when it is asked to stop there; asked of H.264, that would spoil more than it finds.
STOP_AT_DAMAGE = frozenset({"hevc"})
# Decoders that, fresh or flushed, give nothing before a key frame or a whole refresh.
GIVES_WHOLE = frozenset({"h264", "hevc"})
BEGUN_KEPT = 64  # refreshes: news of damage come late, and one may begin before another ends


@dataclass
class _Begun:
    """A refresh: its first packet's time, its last frame's number, and from which time on pictures are whole."""

    pts: int
    last: int
    newest_pts: int | None = None
    whole_pts: int | None = None

    def add(self, frame: FrameNumber, pts: int) -> None:
        if self.whole_pts is None and frame.is_reference and frame.number == self.last:
            # What was decoded before and is shown later is not whole.
            self.whole_pts = pts if self.newest_pts is None else max(pts, self.newest_pts + 1)
        self.newest_pts = pts if self.newest_pts is None else max(pts, self.newest_pts)


class Refresh:
    """Follows the packets of one stream beside its decoder, `context`, which must not be open yet. Times are ticks.

    `entered` is False while H.265's decoder can make nothing of packets, since they begin in mid-stream.
    """

    def __init__(self, context: Any) -> None:
        name = None if context is None else context.name
        self._context = context
        if name in STOP_AT_DAMAGE:
            context.options = {"err_detect": "explode"}
        extradata = b"" if context is None else context.extradata or b""
        self._h264 = H264Headers(extradata) if name == "h264" else None
        self._h265_size_bytes = size_bytes(extradata, at=21) if name == "hevc" else None
        self._fresh, self._fed = name in GIVES_WHOLE, False
        self.entered = True
        self._before: int | None = None  # number of the last reference
        self._begun: deque[_Begun] = deque(maxlen=BEGUN_KEPT)

    def damage(self, pts: int | None) -> None:
        """Something is missing or wrong at `pts`, or it is not known where: what began before does not count."""
        self._fresh = False
        self._begun = deque(
            (begun for begun in self._begun if pts is not None and begun.pts > pts), maxlen=BEGUN_KEPT
        )

    def is_whole(self, pts: int | None) -> bool:
        """Whether a picture of after the damage has nothing of it any more."""
        if self._fresh:
            return True
        whole = (begun.whole_pts for begun in self._begun)
        return pts is not None and any(each is not None and each <= pts for each in whole)

    def misses(self, packet: Any) -> bool:
        """Take note of a packet before it is decoded; whether others are missing before it."""
        frame = None if self._h264 is None or not packet.size else self._h264.read(bytes(packet))
        if frame is None:
            return False
        ahead = 0 if frame.is_idr or self._before is None else (frame.number - self._before) % frame.modulus
        missing = ahead > 1 and not frame.may_jump
        if missing:
            self.damage(None)
        if frame.is_reference:
            self._before = frame.number
        elif missing:
            self._before = frame.number - 1
        if packet.pts is not None:
            if frame.recovery is not None:
                self._begun.append(_Begun(packet.pts, (frame.number + frame.recovery) % frame.modulus))
            for begun in self._begun:
                begun.add(frame, packet.pts)
        return missing

    def begin_anew(self, packet: Any) -> None:
        """Begin anew with this packet where the decoder must and can; what it held is lost."""
        if self._h265_size_bytes is None:
            return
        begins = h265_begins(bytes(packet), self._h265_size_bytes)
        if begins and self._fed and not (self._fresh and self.entered):
            self._forget()
        self.entered, self._fresh = begins or (self.entered and self._fed), begins or self._fresh
        self._fed = True

    def _forget(self) -> None:
        with suppress(FFmpegError):  # of what leans on damage
            self._context.decode(None)
        self._context.flush_buffers()
