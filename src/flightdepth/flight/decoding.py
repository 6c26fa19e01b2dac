"""Sound pictures out of a video stream: after damage none until a key frame begins afresh, or a refresh is complete.

A decoder goes on after damage and fills what it lacks with grey or with what it saw last; every later picture is
built on that, up to the next key frame, and only the first of them is marked. What is told of damage: an error of
the decoder, a packet that the container calls damaged, a picture that the decoder calls damaged, a frame number of
H.264 that is left out.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterator
from typing import Any

from av.error import FFmpegError

from flightdepth.flight.refresh import Refresh
from flightdepth.flight.video_clock import numbers_packets

# Pictures are shown in another order than they are decoded: so many before a damaged one may be built on it.
REORDERED = 4
KEYS_KEPT = 64  # packets: a decoder holds the pictures of fewer

BUILT_ON_DAMAGE = "frames built on damaged ones, up to the next key frame or whole refresh"
NO_KEY_FRAME_YET = "frames before the first key frame"
DAMAGED_PACKETS, DAMAGED_FRAMES = "damaged video packets", "damaged frames"
NO_PICTURE = "video packets that gave no picture"
MISSING = "places where video packets are missing"
GAP, MOST_AGAIN = "places of the file without a packet", 1000
READ_ERROR = "read errors (the rest of the video is lost)"


class Damageable:
    """What is known of damage in a stream whose decoder is `context`; what is left out is counted in `counts`."""

    def __init__(self, context: Any, counts: Counter[str]) -> None:
        self._counts = counts
        self._refresh = Refresh(context)
        self._waiting = True  # for what begins afresh
        self._damaged = False  # since the last picture given
        self._damage_pts: int | None = None
        # Some decoders mark no picture as a key frame (CineForm, QuickTime Animation). Where pictures are shown in the
        # order of their packets, these tell it too; else the decoder knows better.
        self._packets_tell = context is not None and not context.codec.reorder
        self._key_pts: deque[int] = deque(maxlen=KEYS_KEPT)

    def damage(self, pts: int | None) -> None:
        """Something is missing or wrong at `pts`."""
        raise NotImplementedError

    def _misses(self, packet: Any) -> bool:
        """Take note of a packet before it is decoded; whether others are missing before it."""
        if self._packets_tell and packet.is_keyframe and packet.pts is not None:
            self._key_pts.append(packet.pts)
        missing = self._refresh.misses(packet)
        if missing and not self._waiting:
            self._counts[MISSING] += 1
        return missing

    def _is_key(self, picture: Any) -> bool:
        """Whether a decoded picture leans on no other."""
        return bool(picture.key_frame) or picture.pts in self._key_pts

    def _refused(self, packet: Any) -> None:
        """The decoder can make nothing of a packet: it is damaged, or leans on what is."""
        if not self._refresh.entered:
            self._counts[NO_KEY_FRAME_YET] += 1
            return
        leans = self._waiting and self._damaged
        self._counts[BUILT_ON_DAMAGE if leans else DAMAGED_PACKETS] += 1
        self.damage(packet.pts)

    @property
    def _why_waiting(self) -> str:
        return BUILT_ON_DAMAGE if self._damaged else NO_KEY_FRAME_YET


class SoundPictures(Damageable):
    """One pass over a stream: (picture, whether damage lies between it and the one before), in order of display.

    What is left out is counted in `counts`; `whole` says that the stream is read from its start on, so that
    what it lacks can be told. `begin_by`: where nothing begins afresh by this time, ticks, none is given at all.
    `read_pts`: how far the stream was read, ticks, None before the first packet with a time.
    """

    def __init__(
        self,
        container: Any,
        stream: Any,
        counts: Counter[str],
        *,
        whole: bool,
        begin_by: int | None = None,
    ) -> None:
        decoder = stream.codec_context
        super().__init__(decoder, counts)
        self._container, self._stream, self._whole = container, stream, whole
        self._held: deque[tuple[Any, bool]] = deque()
        self._begin_by = begin_by  # None once one has begun
        self.read_pts: int | None = None
        self._read_dts = -1  # of the last packet with a picture
        self._ahead_pts: list[int] = []  # of damaged packets whose pictures are still in the decoder
        self._leaning = False  # whether pictures lean on others: not where each packet is a key frame
        self._hold = REORDERED if decoder is None or decoder.codec.reorder else 0

    def __iter__(self) -> Iterator[tuple[Any, bool]]:
        read = owed = 0  # packets; those whose picture was neither given nor counted
        for packet in self._packets():
            read += packet.size > 0
            owed += packet.size > 0 and not packet.is_discard
            self._take_note(packet)
            try:
                pictures = packet.decode()
            except FFmpegError:
                owed -= 1
                self._refused(packet)
                continue
            owed -= len(pictures)
            for picture in pictures:
                if self._begin_by is not None and picture.pts is not None and picture.pts > self._begin_by:
                    return
                yield from self._judged(picture)
        yield from self._held
        self._count_lost(read, owed)

    def _take_note(self, packet: Any) -> None:
        """What is known of a packet before it is decoded."""
        if self._waiting:
            self._refresh.begin_anew(packet)
        if packet.is_discard:  # decoded, not shown: an MP4's edit list begins later
            self._waiting &= not packet.is_keyframe
        self._leaning |= packet.size > 0 and not packet.is_keyframe
        if packet.pts is not None:
            self.read_pts = packet.pts if self.read_pts is None else max(packet.pts, self.read_pts)
        if packet.dts is not None and packet.size > 0:
            self._read_dts = packet.dts
        missing = self._misses(packet)
        if (missing or packet.is_corrupt) and packet.pts is not None:
            self._ahead_pts.append(packet.pts)

    def _judged(self, picture: Any) -> Iterator[tuple[Any, bool]]:
        if shown := [pts for pts in self._ahead_pts if picture.pts is not None and picture.pts >= pts]:
            self._damage_shown(max(shown))
            self._ahead_pts = [pts for pts in self._ahead_pts if pts not in shown]
        if picture.is_corrupt:
            self._counts[DAMAGED_FRAMES] += 1
            self._damage_shown(picture.pts)
        elif self._waiting and not self._begins_afresh(picture):
            self._counts[self._why_waiting] += 1
        else:
            self._held.append((picture, self._damaged))
            self._waiting = self._damaged = False
            self._begin_by = None
        while len(self._held) > self._hold:
            yield self._held.popleft()

    def _begins_afresh(self, picture: Any) -> bool:
        # Several pictures are in the decoder at once: a key frame from before the damage may come after its news.
        later = self._damage_pts is None or picture.pts is None or picture.pts > self._damage_pts
        return (self._is_key(picture) and later) or self._refresh.is_whole(picture.pts)

    def _damage_shown(self, pts: int | None) -> None:
        """Damage in the order of display: what is held back may be built on it."""
        if self._held:
            self._counts[BUILT_ON_DAMAGE] += len(self._held)
            self._held.clear()
        self.damage(pts)

    def damage(self, pts: int | None) -> None:
        """Something is missing or wrong at `pts`."""
        self._damaged, self._waiting = True, self._leaning
        self._refresh.damage(pts)
        if pts is not None:
            self._damage_pts = pts if self._damage_pts is None else max(self._damage_pts, pts)

    def _count_lost(self, read: int, lost: int) -> None:
        kept_back = [why for why in (BUILT_ON_DAMAGE, NO_KEY_FRAME_YET) if self._counts[why]]
        # After a seek, packets may rightly give no picture.
        if lost > 0 and (self._whole or kept_back):
            self._counts[kept_back[0] if kept_back else NO_PICTURE] += lost
        # FFmpeg ends a cut MP4 without a word, but the index at its front tells how much there should be. That of an
        # AVI counts the empty chunks of pictures that its recorder dropped, and so do the numbers of its packets.
        if numbers_packets(self._container):
            read = max(read, self._read_dts + 1)
        if self._whole and read < self._stream.frames:
            self._counts["frames missing at the end of the file"] = self._stream.frames - read

    def _packets(self) -> Iterator[Any]:
        try:
            yield from file_packets(self._container, self._stream, self._gap)
        except FFmpegError:
            self._counts[READ_ERROR] += 1

    def _gap(self) -> None:
        self._counts[GAP] += 1
        self.damage(None)


def file_packets(container: Any, stream: Any, gap: Callable[[], None]) -> Iterator[Any]:
    """A file's packets. FFmpeg looks for one in 64 KB of anything else, then wants to be asked again: a `gap`."""
    for again in range(MOST_AGAIN + 1):
        try:
            yield from container.demux(stream)
            return
        except BlockingIOError:
            if again == MOST_AGAIN:
                raise
            gap()
