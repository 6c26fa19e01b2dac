"""Whether the pictures deny the direction of motion that a log tells.

A log of other axes, of another time, or of a camera that is mounted otherwise: its depth would be wrong and look
right. Both directions, the log's and the one that corners show, are fitted to the corners with the small rotation that
each needs (`remainder`); the log's is denied where that leaves far more of them off their lines.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from flightdepth.camera import Camera
from flightdepth.ranges.direction import direction_of, rays_of
from flightdepth.ranges.pairs import Frame, Pair
from flightdepth.ranges.remainder import LEFT_SHARE, LOG_SIGMA_RAD, MOST_SIGMAS, SEEN_SIGMA_RAD, remainder
from flightdepth.ranges.tracks import Tracker

EVERY_NS = 250_000_000
DENIALS = 2  # in a row: something large may pass by
DENIED_RAD = MOST_SIGMAS * LOG_SIGMA_RAD  # less is mended beside rotation


class LogCheck:
    """A flight's checks of its log.

    off_rad  how far the log's direction was off the one seen, at the last check that denied it
    """

    def __init__(self, camera: Camera, tracker: Tracker) -> None:
        self._camera, self._tracker = camera, tracker
        self._checked_ns: int | None = None
        self._denials = 0
        self.off_rad = 0.0

    def denies(self, pair: Callable[[], Pair], current: Frame) -> bool:
        """Whether not to believe the log's direction now; `pair` gives one in which a direction can be seen."""
        if self._checked_ns is None or current.stamp_ns - self._checked_ns >= EVERY_NS:
            off_rad = self._off_rad(pair(), current)
            if off_rad is not None:
                self._checked_ns = current.stamp_ns
                self._denials = self._denials + 1 if off_rad > 0 else 0
                self.off_rad = off_rad or self.off_rad
        return self._denials >= DENIALS

    def _off_rad(self, pair: Pair, current: Frame) -> float | None:
        """0 where the log is right enough, None where the pictures tell no direction."""
        now, before = rays_of(pair, current, self._tracker)
        seen = direction_of(now, before, self._camera.fx)
        if seen is None:
            return None
        told = pair.displacement_m / pair.length_m
        off_rad = float(np.arccos(np.clip(told @ seen.unit, -1, 1)))
        if off_rad < DENIED_RAD:
            return 0.0
        # A rolling shutter's bend would excuse wrong directions.
        by_log, shown = (
            remainder(now, before, unit, self._camera, direction_sigma_rad=sigma_rad, bends=False)
            for unit, sigma_rad in ((told, LOG_SIGMA_RAD), (seen.unit, SEEN_SIGMA_RAD))
        )
        if by_log is None or shown is None:
            return None
        left_px, left_by_log_px = (each.left_px(now, before, self._camera) for each in (shown, by_log))
        denied = left_px < LEFT_SHARE * left_by_log_px
        return off_rad if denied else 0.0
