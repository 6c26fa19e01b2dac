"""Whether the pictures deny the direction of motion that a log tells.

A log of other axes, of another time, or of a camera that is mounted otherwise: its depth would be wrong and look
right. Both directions, the log's and the one that corners show, are fitted to the corners with the small rotation that
each needs (`derotation.remainder`); the log's is denied where that leaves far more of them off their lines.
"""

from __future__ import annotations

import cv2
import numpy as np

from flightdepth.camera import Camera
from flightdepth.epipolar import aside, lines
from flightdepth.motion import Vector
from flightdepth.ranges.derotation import LOG_SIGMA_RAD, MOST_SIGMAS, SEEN_SIGMA_RAD, Remainder, remainder
from flightdepth.ranges.direction import direction_of, rays_of
from flightdepth.ranges.pairs import Frame, Pair
from flightdepth.ranges.tracks import Tracker

EVERY_NS = 250_000_000
DENIALS = 2  # in a row: something large may pass by
DENIED_RAD = MOST_SIGMAS * LOG_SIGMA_RAD  # less is mended beside rotation
# Corners off their lines: right logs leave 0.1 px on average, wrong ones 0.3 to 0.9 (MOST_OFF_PX at most each).
LEFT_SHARE, MOST_OFF_PX = 0.6, 1.0


class LogCheck:
    """A flight's checks of its log.

    off_rad  how far the log's direction was off the one seen, at the last check that denied it
    """

    def __init__(self, camera: Camera, tracker: Tracker) -> None:
        self._focal_px, self._tracker = camera.fx, tracker
        self._checked_ns: int | None = None
        self._denials = 0
        self.off_rad = 0.0

    def denies(self, pair: Pair, current: Frame) -> bool:
        """Whether not to believe the log's direction now; `pair` is one in which a direction can be seen."""
        if self._checked_ns is None or current.stamp_ns - self._checked_ns >= EVERY_NS:
            off_rad = self._off_rad(pair, current)
            if off_rad is not None:
                self._checked_ns = current.stamp_ns
                self._denials = self._denials + 1 if off_rad > 0 else 0
                self.off_rad = off_rad or self.off_rad
        return self._denials >= DENIALS

    def _off_rad(self, pair: Pair, current: Frame) -> float | None:
        """0 where the log is right enough, None where the pictures tell no direction."""
        now, before = rays_of(pair, current, self._tracker)
        seen = direction_of(now, before, self._focal_px)
        if seen is None:
            return None
        told = pair.displacement_m / pair.length_m
        off_rad = float(np.arccos(np.clip(told @ seen.unit, -1, 1)))
        if off_rad < DENIED_RAD:
            return 0.0
        by_log = remainder(now, before, told, self._focal_px)
        shown = remainder(now, before, seen.unit, self._focal_px, direction_sigma_rad=SEEN_SIGMA_RAD)
        if by_log is None or shown is None:
            return None
        denied = self._left_px(shown, now, before) < LEFT_SHARE * self._left_px(by_log, now, before)
        return off_rad if denied else 0.0

    def _left_px(self, found: Remainder, now: Vector, before: Vector) -> float:
        """How far corners are off their lines, or moved against the parallax, on average."""
        turned = before @ cv2.Rodrigues(found.rotation)[0].T
        off, along = lines(now.T, (turned / turned[:, 2:]).T, found.unit, aside(found.unit))[5].reshape(2, -1)
        off_px = self._focal_px * np.hypot(off, np.minimum(along, 0))
        return float(np.minimum(off_px, MOST_OFF_PX).mean())
