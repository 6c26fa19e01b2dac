"""Packets to sound pictures, as they come: after damage no picture counts until a key frame begins afresh.

An encoder that refreshes its pictures strip by strip (intra refresh) sends no key frame after its first. FFmpeg's H.264
decoder knows when such a refresh is complete (recovery point SEI), and gives no picture before: if it is told to begin
anew after damage, all that it gives then is sound.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Any

from av.error import FFmpegError

from flightdepth.flight.decoding import BUILT_ON_DAMAGE, NO_KEY_FRAME_YET, STOP_AT_DAMAGE
from flightdepth.flight.deinterlacing import Deinterlacer

MOST_SKIPPED = 60  # packets: B frames keep a key frame in the decoder until others than key frames come
# Decoders that, once flushed, give nothing before a key frame or a whole refresh.
GIVES_WHOLE = frozenset({"h264"})
IN_DECODER_S = 2  # a picture that a decoder still held when news of damage came is not older


class SoundDecoder:
    """A codec context and what is known of damage; what is left out is counted in `counts`.

    As `flight.decoding` does for files, but at once: no picture is held back to see whether the next is damaged, only
    an interlaced one until the next has come.
    """

    def __init__(self, context: Any, counts: Counter[str]) -> None:
        self._context, self._counts = context, counts
        self._deinterlacer = Deinterlacer()
        # Threads by frame would hold back as many pictures as there are cores.
        context.thread_type = "SLICE"
        if context.name in STOP_AT_DAMAGE:
            context.options = {"err_detect": "explode"}
        self._waiting, self._damaged = True, False
        self._skipping = 0
        self._damage_pts: int | None = None
        self._anew = context.name in GIVES_WHOLE  # it holds nothing from before the damage
        self._first_pts: int | None = None  # of the first packet since it began anew

    def decode(self, packet: Any) -> Iterator[Any]:
        """Sound pictures of one packet; the last of a file come with the empty packet at its end."""
        if packet.is_corrupt:
            self.damage(packet.pts)
        if not self._anew and self._context.name in GIVES_WHOLE:
            self._counts.update(BUILT_ON_DAMAGE for _ in self._context.decode(None))  # what it still held
            self._context.flush_buffers()
            self._anew, self._first_pts = True, None
            if packet.is_corrupt or (packet.pts is not None and packet.pts == self._damage_pts):
                return
        if self._skipping:
            self._skipping = 0 if packet.is_keyframe else self._skipping - 1  # not all containers tell it
            self._context.skip_frame = "NONKEY" if self._skipping else "DEFAULT"
        try:
            found = self._context.decode(packet)
        except FFmpegError:
            self._refused(packet)
            return
        if self._anew and not self._skipping:
            self._first_pts = packet.pts if self._first_pts is None else self._first_pts
            if self._waiting and packet.size and not (found or self._context.has_b_frames):
                self._counts[self._why_waiting] += 1  # the decoder keeps it to itself
        for decoded in found:
            if self._is_sound(decoded):
                yield from self._deinterlacer.add(decoded)
        if self._waiting or not packet.size:  # what waits shall not grow old
            yield from self._deinterlacer.flush()

    def _refused(self, packet: Any) -> None:
        """The decoder can make nothing of a packet: it is damaged, or leans on what came before all that it holds."""
        if self._anew and self._first_pts is None:
            self._counts[self._why_waiting] += 1
            self._anew = False
        elif self._anew and packet.pts is not None and packet.pts < self._first_pts:
            # Shown before the key frame of an open group, which the decoder still holds.
            self._counts[self._why_waiting] += 1
        else:
            self._counts["damaged video packets"] += 1
            self.damage(packet.pts)

    @property
    def _why_waiting(self) -> str:
        return BUILT_ON_DAMAGE if self._damaged else NO_KEY_FRAME_YET

    def damage(self, pts: int | None) -> None:
        """Something is missing or wrong at `pts`."""
        self._waiting = self._damaged = True
        self._anew = False
        if pts is not None:
            self._damage_pts = pts

    def skip_to_key_frame(self) -> None:
        """Packets before the next one were left out: what is built on them is not even decoded, which takes time."""
        self.damage(None)
        self._skipping = MOST_SKIPPED

    def _is_sound(self, decoded: Any) -> bool:
        if decoded.is_corrupt:
            self._counts["damaged frames"] += 1
            self.damage(decoded.pts)
        elif self._waiting and not self._begins_afresh(decoded):
            self._counts[self._why_waiting] += 1
        elif decoded.pts is None:
            self._counts["frames without a time"] += 1
        else:
            self._waiting = self._damaged = False
            self._skipping = min(self._skipping, 1)
            return True
        return False

    def _begins_afresh(self, decoded: Any) -> bool:
        """Whether it is a key frame from after the damage: one may be damaged itself.

        One that is long before it, by its stamp, is after it too: the sender began again.
        """
        if self._anew:
            return True
        if self._damage_pts is None or decoded.pts is None:
            return bool(decoded.key_frame)
        early_s = (self._damage_pts - decoded.pts) * decoded.time_base
        return bool(decoded.key_frame) and not 0 <= early_s <= IN_DECODER_S
