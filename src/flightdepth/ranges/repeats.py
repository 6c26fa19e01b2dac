"""Pictures that repeat: a camera or a link that hangs shows the same one again, with new times.

A drone that flies on would get "infinitely far" from them: known displacement, nothing moved.
"""

from __future__ import annotations

import cv2

from flightdepth.ranges.network import Image

# Mean difference of two pictures, grey levels. Measured on H.264: a picture shown again, up to 0.04; two pictures
# of a real flight at 30 a second, 1.4 and more.
SAME_LEVELS = 0.1
# After so long the same, one other picture is a key frame that shows the old one anew: two in a row are needed.
HANGS_NS = 300_000_000


class Repeats:
    """Tells new pictures from repeated ones; give it every picture in the order of time. Another size is new."""

    def __init__(self) -> None:
        self._image: Image | None = None
        self._shown_ns = 0
        self._changed_once = False
        self.repeated = False
        self.frozen = False  # set by who knows that the camera moved meanwhile; until a new picture comes

    @property
    def shown_ns(self) -> int:
        """Stamp at which the picture shown now was new."""
        return self._shown_ns

    def add(self, stamp_ns: int, image: Image) -> None:
        """Compare a picture, uint8 [H, W, 3], with the one before."""
        before = self._image
        same = before is not None and before.shape == image.shape and difference(before, image) < SAME_LEVELS
        hangs = self.repeated and stamp_ns - self._shown_ns >= HANGS_NS
        refreshed = hangs and not same and not self._changed_once
        self._changed_once = refreshed
        self.repeated = same or refreshed
        if not same:
            self._image = image
        if not self.repeated:
            self._shown_ns, self.frozen = stamp_ns, False


def difference(one: Image, other: Image) -> float:
    """Mean absolute difference, grey levels."""
    return float(cv2.norm(one, other, cv2.NORM_L1)) / one.size
