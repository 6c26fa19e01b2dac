"""Taking out of each pair the small rotation that no log reports, and the direction's error (`remainder`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from flightdepth.camera import Camera
from flightdepth.levels import AnyImage
from flightdepth.motion import Vector, rotation_angle_rad
from flightdepth.ranges.direction import rays_of
from flightdepth.ranges.pairs import Frame, Pair
from flightdepth.ranges.remainder import LOG_SIGMA_RAD, SEEN_SIGMA_RAD, remainder
from flightdepth.ranges.tracks import Tracker, tracked_rays
from flightdepth.ranges.turning import turned

# A pair whose corners stay farther off their lines is of no rigid scene, or turned beyond what they tell: right ones
# leave 0.25 px at most through a wide lens, 0.6 through one of 20 degrees, those that turned too far 0.8 to 1.
MOST_LEFT_PX = 0.6


class Derotation:
    """Takes out of each pair what its two pictures show of unreported motion."""

    def __init__(self, camera: Camera, tracker: Tracker) -> None:
        self._camera, self._tracker = camera, tracker
        self._turned_rad = 0.0  # at most, between the pictures of a pair of the frame before

    def of(self, pairs: Sequence[Pair], current: Frame) -> tuple[Pair, ...]:
        """The pairs with rotation and direction mended; those whose direction nobody tells stay as they are.

        Pairs that no small mending makes right are left out.
        """
        tried = (self._without_remainder(pair, current) for pair in pairs)
        mended = tuple(pair for pair in tried if pair is not None)
        self._turned_rad = max((pair.turn_rad for pair in mended), default=0.0)
        return mended

    def _without_remainder(self, pair: Pair, current: Frame) -> Pair | None:
        if not (pair.directed or pair.seen):
            return pair
        now, before = rays_of(pair, current, self._tracker)
        sigma_rad = LOG_SIGMA_RAD if pair.directed else SEEN_SIGMA_RAD
        left = remainder(
            now,
            before,
            pair.displacement_m,
            self._camera,
            direction_sigma_rad=sigma_rad,
            turn=pair.current_from_previous,
            turned_rad=self._turned_rad,
        )
        if left is None:
            return pair
        if not left.is_small(sigma_rad) or left.left_px(now, before, self._camera) > MOST_LEFT_PX:
            return None
        wrong = left.heads_elsewhere
        pair = replace(pair, covariance=left.left_open(turned_back=left.turns, redirected=wrong))
        pair = turned_by(pair, left.rotation, left.bend) if left.turns else pair
        return replace(pair, displacement_m=left.unit * pair.length_m) if wrong else pair


def derotated(
    previous: AnyImage, current: AnyImage, displacement: Vector, camera: Camera
) -> tuple[AnyImage, Vector, Vector | None]:
    """One pair of an ideal pinhole with the clear errors of its motion taken out.

    Returns `previous`, the displacement (3,), and the covariance (6, 6) of what is left, None where nothing tells.
    """
    left = remainder(*tracked_rays(previous, current, camera), displacement, camera)
    if left is None or not left.is_small(LOG_SIGMA_RAD):
        return previous, displacement, None
    if left.turns:
        previous = turned(previous, np.asarray(cv2.Rodrigues(left.rotation)[0]), camera, left.bend)
    moved = left.unit * np.linalg.norm(displacement) if left.heads_elsewhere else displacement
    return previous, moved, left.left_open(turned_back=left.turns, redirected=left.heads_elsewhere)


def turned_by(pair: Pair, rotation: Vector, bend: Vector | None = None) -> Pair:
    """The pair with a rotation vector (3,) on top of the one that is known, and a rolling shutter's bend (3,)."""
    turn = np.asarray(cv2.Rodrigues(rotation)[0] @ pair.current_from_previous)
    return replace(pair, current_from_previous=turn, turn_rad=rotation_angle_rad(turn), bend=bend)
