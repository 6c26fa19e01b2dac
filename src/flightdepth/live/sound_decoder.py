"""Packets to sound pictures, as they come: after damage none until a key frame begins afresh, or a refresh ends."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Any

from av.error import FFmpegError

from flightdepth.flight.decoding import DAMAGED_FRAMES, Damageable
from flightdepth.flight.deinterlacing import Deinterlacer

MOST_SKIPPED = 60  # packets: B frames keep a key frame in the decoder until others than key frames come
IN_DECODER_S = 2  # a picture that a decoder still held when news of damage came is not older


class SoundDecoder(Damageable):
    """A codec context and what is known of damage; what is left out is counted in `counts`.

    As `flight.decoding` does for files, but at once: no picture is held back to see whether the next is damaged, only
    an interlaced one until the next has come.
    """

    def __init__(self, context: Any, counts: Counter[str]) -> None:
        super().__init__(context, counts)
        self._context = context
        self._deinterlacer = Deinterlacer()
        # Threads by frame would hold back as many pictures as there are cores.
        context.thread_type = "SLICE"
        self._skipping = 0

    def decode(self, packet: Any) -> Iterator[Any]:
        """Sound pictures of one packet; the last of a file come with the empty packet at its end."""
        self._take_note(packet)
        try:
            found = self._context.decode(packet)
        except FFmpegError:
            self._refused(packet)
            return
        # The decoder keeps it to itself.
        if self._waiting and not self._skipping and packet.size and not (found or self._context.has_b_frames):
            self._counts[self._why_waiting] += 1
        for decoded in found:
            if self._is_sound(decoded):
                yield from self._deinterlacer.add(decoded)
        if self._waiting or not packet.size:  # what waits shall not grow old
            yield from self._deinterlacer.flush()

    def _take_note(self, packet: Any) -> None:
        """What is known of a packet before it is decoded."""
        missing = self._misses(packet)
        if missing or packet.is_corrupt:
            self.damage(packet.pts)
        if self._skipping:
            self._skipping = 0 if packet.is_keyframe else self._skipping - 1  # not all containers tell it
            self._context.skip_frame = "NONKEY" if self._skipping else "DEFAULT"
            self._refresh.damage(None)
        if self._waiting:
            self._refresh.begin_anew(packet)

    def damage(self, pts: int | None) -> None:
        """Something is missing or wrong at `pts`."""
        self._waiting = self._damaged = True
        self._refresh.damage(pts)
        if pts is not None:
            self._damage_pts = pts

    def skip_to_key_frame(self) -> None:
        """Packets before the next one were left out: what is built on them is not even decoded, which takes time."""
        self.damage(None)
        self._skipping = MOST_SKIPPED

    def _is_sound(self, decoded: Any) -> bool:
        if decoded.is_corrupt:
            self._counts[DAMAGED_FRAMES] += 1
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
        """Whether it is a key frame from after the damage, which may be damaged itself, or whole without one.

        A key frame that is long before the damage, by its stamp, is after it too: the sender began again.
        """
        if self._refresh.is_whole(decoded.pts):
            return True
        if self._damage_pts is None or decoded.pts is None:
            return self._is_key(decoded)
        early_s = (self._damage_pts - decoded.pts) * decoded.time_base
        return self._is_key(decoded) and not 0 <= early_s <= IN_DECODER_S
