"""Pictures of the newest result, made when somebody looks and once for all who do."""

from __future__ import annotations

import threading
from collections.abc import Callable

import cv2
import numpy as np

from flightdepth.levels import jpeg
from flightdepth.live.status import LiveResult
from flightdepth.outputs.palette import DepthScale, Palette, Picture

WIDEST_PX = 800
QUALITY = {"input": 80, "depth": 88}


class Pictures:
    """Holds the newest result; `jpeg` waits for one newer than the caller has."""

    def __init__(self, scale: DepthScale) -> None:
        self._palette = Palette(scale)
        self._makers: dict[str, Callable[[LiveResult], Picture]] = {"input": shown, "depth": self._painted}
        self._changed = threading.Condition()
        self._making = threading.Lock()
        self._result: LiveResult | None = None
        self._number = 0
        self._made: dict[str, tuple[int, bytes]] = {}

    @property
    def result(self) -> LiveResult | None:
        """The newest; None before the first."""
        return self._result

    def put(self, result: LiveResult) -> None:
        """A newer result; nothing is drawn yet."""
        with self._changed:
            self._result = result
            self._number += 1
            self._changed.notify_all()

    def jpeg(self, name: str, after: int, timeout_s: float) -> tuple[int, bytes] | None:
        """Number and JPEG of "input" or "depth", newer than number `after`; None where none came in time."""
        with self._changed:
            self._changed.wait_for(lambda: self._number > after, timeout_s)
            number, result = self._number, self._result
        if result is None or number <= after:
            return None
        with self._making:
            made = self._made.get(name)
            if made is None or made[0] < number:
                made = number, jpeg(self._makers[name](result), QUALITY[name])
                self._made[name] = made
        return made

    def _painted(self, result: LiveResult) -> Picture:
        depth = result.depth
        maps = depth.depth_m, depth.farther_than_m, depth.nearer_than_m
        return self._palette.fitted(shown_size(result), *maps)


def shown(result: LiveResult) -> Picture:
    """The input at the page's size."""
    return np.asarray(cv2.resize(result.image, shown_size(result), interpolation=cv2.INTER_AREA), np.uint8)


def shown_size(result: LiveResult) -> tuple[int, int]:
    """Width and height, at most WIDEST_PX wide."""
    height, width = result.image.shape[:2]
    shown_px = min(width, WIDEST_PX)
    return shown_px, round(height * shown_px / width)
