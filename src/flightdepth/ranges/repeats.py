"""Pictures that repeat: a camera or a link that hangs shows the same one again, with new times.

A drone that flies on would get "infinitely far" from them: known displacement, nothing moved.
"""

from __future__ import annotations

from collections import deque

import cv2

from flightdepth.levels import Image

# Mean difference of two pictures, grey levels. Measured on H.264: a picture shown again, up to 0.04; two pictures
# of a real flight at 30 a second, 1.4 and more.
SAME_LEVELS = 0.1
# An encoder mends a repeated picture bit by bit: up to this share of what new ones change (median of three: a cut
# changes more), and so many levels.
MENDED_SHARE, MENDED_LEVELS = 0.1, 0.5
# After so long the same, one other picture is a key frame that shows the old one anew: it takes another, when due.
HANGS_NS = 300_000_000
# New pictures come as seldom as the second longest of so many waits; a repeat in less than this share of it is usual,
# unless it takes so long that 12 new pictures a second would be too many.
WAITS, USUAL_SHARE, LONGEST_USUAL_NS = 5, 0.9, 75_000_000
NEW_SHARE = (
    0.7  # of their usual change; less may be a key frame that shows the old picture anew, and tells no wait
)
FROZEN = "frozen picture"  # how `Repeats.told` begins


class Repeats:
    """Tells new pictures from repeated ones; give it every picture in the order of time. Another size is new.

    shown_ns  stamp at which the picture shown now was new
    """

    def __init__(self) -> None:
        self._image: Image | None = None
        self.shown_ns = 0
        self._changed_ns: int | None = None  # when one other picture came, and the next is not overdue
        self._changes = 0.0, 0.0, 0.0  # that the last new pictures made, grey levels
        self._news: deque[tuple[int, float]] = deque(
            maxlen=WAITS
        )  # waits for new pictures, ns, and their changes
        self.repeated = False
        self.frozen = False  # set by who knows that the camera moved meanwhile; until a new picture comes

    def taken_ns(self, stamp_ns: int) -> int:
        """When the picture given at `stamp_ns` was taken: as it was new, where it is repeated and does not hang.

        Video of 25 or 30 pictures a second in a file or link of more holds each several times.
        """
        return self.shown_ns if self.repeated and stamp_ns - self.shown_ns < HANGS_NS else stamp_ns

    def is_usual(self, wait_ns: int) -> bool:
        """Whether new pictures are as far apart as that: 25 pictures a second in a file of 50 do not hang.

        One of the last waits may have been as long as it liked: that was a picture that hung.
        """
        waits_ns = sorted(each_ns for each_ns, _ in self._news)
        return len(waits_ns) > 1 and wait_ns < min(LONGEST_USUAL_NS, USUAL_SHARE * waits_ns[-2])

    def told(self, now_ns: int) -> str:
        """For people: that the picture shown now is frozen, and for how long."""
        return f"{FROZEN}: the same for {(now_ns - self.shown_ns) * 1e-9:.2f} s"

    def add(self, stamp_ns: int, image: Image) -> None:
        """Compare a picture, uint8 [H, W, 3], with the one before."""
        before = self._image
        alike = before is not None and before.shape == image.shape
        change = difference(before, image) if before is not None and alike else 0.0
        mended = min(MENDED_SHARE * sorted(self._changes)[1], MENDED_LEVELS)
        same = alike and change < max(SAME_LEVELS, mended)
        hangs = self.repeated and stamp_ns - self.shown_ns >= HANGS_NS
        refreshed = hangs and not same and self._changed_ns is None
        if refreshed:
            self._changed_ns = stamp_ns
        elif self._changed_ns is not None and not (same and self.is_usual(stamp_ns - self._changed_ns)):
            self._changed_ns = None
        self.repeated = same or refreshed
        if not same:
            self._image, self._changes = image, (*self._changes[1:], change)
        if not self.repeated:
            self._learn(stamp_ns - self.shown_ns, change)
            self.shown_ns, self.frozen = stamp_ns, False

    def _learn(self, wait_ns: int, change: float) -> None:
        changes = sorted(each for _, each in self._news)
        if len(changes) < WAITS or change > NEW_SHARE * changes[WAITS // 2]:
            self._news.append((wait_ns, change))


def difference(one: Image, other: Image) -> float:
    """Mean absolute difference, grey levels."""
    return float(cv2.norm(one, other, cv2.NORM_L1)) / one.size
