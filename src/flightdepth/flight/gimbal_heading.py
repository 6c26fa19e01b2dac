"""A gimbal's heading, put right by that of the drone whose nose it follows.

The yaw that a DJI gimbal reports is meant from north, but it starts anywhere and drifts, while the drone's own is
held by its compass and its flight: they differ by 36 degrees in a log of a Mini 2, by 12, and by 13 to 28, in two of
another drone, though the cameras looked ahead. DJI's support says to take the drone's heading where a gimbal cannot
pan (dji-sdk, Mobile-SDK-Android-V5, issues 536 and 795). So what differs slowly is the gimbal's error; what differs
for moments is the gimbal that smooths a turn.
"""

from __future__ import annotations

import numpy as np

from flightdepth.motion import Vector

ASIDE_DEG = 60.0  # a camera that looks farther aside was turned there
APART_DEG = 20.0  # a gimbal that follows is seldom farther from where it is on average
FOLLOWING_SHARE = 0.8
HALF_WINDOW_S = 10


def followed_offset_deg(times_s: Vector, gimbal_yaw_deg: Vector, body_yaw_deg: Vector) -> Vector | None:
    """Degrees [n] to add to a gimbal's yaw [n], so that it looks where the drone's nose points, slowly seen.

    Moments in which it looks aside say nothing of its error, and are turned by as much as what is around them.
    Times in rising seconds [n]; NaN where an angle is unknown. None where the gimbal does not follow the nose.
    """
    apart = np.deg2rad(body_yaw_deg - gimbal_yaw_deg)
    known = np.isfinite(apart)
    if np.count_nonzero(known) < 2:
        return None
    middle = np.arctan2(np.sin(apart[known]).mean(), np.cos(apart[known]).mean())
    around_deg = np.rad2deg((apart[known] - middle + np.pi) % (2 * np.pi) - np.pi)
    middle_deg = float(np.rad2deg(middle) + np.median(around_deg))
    following = np.abs(around_deg - np.median(around_deg)) <= APART_DEG
    if abs(middle_deg) > ASIDE_DEG or following.mean() < FOLLOWING_SHARE:
        return None
    seconds, by_second = np.unique(times_s[known][following].astype(np.int64), return_inverse=True)
    parts = np.split(around_deg[following], np.flatnonzero(np.diff(by_second)) + 1)
    medians = np.array([np.median(part) for part in parts])
    first = np.searchsorted(seconds, seconds - HALF_WINDOW_S)
    last = np.searchsorted(seconds, seconds + HALF_WINDOW_S, "right")
    slow = [np.median(medians[start:end]) for start, end in zip(first.tolist(), last.tolist(), strict=True)]
    return np.asarray(np.interp(times_s, seconds + 0.5, slow) + np.rad2deg(middle))
