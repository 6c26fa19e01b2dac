"""How depth changes along a real flight without ground truth: points tracked over metres flown.

A rigid point's z-depth falls by d_z for each metre flown, where d is the unit direction of travel in camera
axes: by 1 m a metre straight ahead (slope -1), whatever the point is. So tracked points test the scale of a
depth map on any forward flight. Only differences along a track count, so a constant offset goes unnoticed.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.evaluation.bootstrap import with_ends
from flightdepth.levels import Image, grey
from flightdepth.runtimes.arrays import Maps

Floats = NDArray[np.float64]

MOST_POINTS = 400
LEAST_SAMPLES, MOST_SAMPLES = 15, 600
PATCH_PX = 2  # depth is the median of a (2 * PATCH_PX + 1) square
LARGEST_RETURN_PX = 0.7  # forward-backward error of a kept point


@dataclass
class _Track:
    point: tuple[float, float]
    flown_m: list[float] = field(default_factory=list)
    depth_m: list[float] = field(default_factory=list)


@dataclass(frozen=True)
class Slopes:
    """Change of depth per metre flown, one entry a track (Theil-Sen), with its median's 95 % interval.

    slopes       [T]  ideal -1 straight ahead
    first_m      [T]  depth at the start of the track, metres
    median, low, high   median slope and its bootstrap interval over tracks; NaN without tracks
    """

    slopes: Floats
    first_m: Floats
    median: float
    low: float
    high: float

    def between(self, near_m: float, far_m: float) -> Slopes:
        """The tracks that began between two depths."""
        keep = (self.first_m >= near_m) & (self.first_m < far_m)
        return slopes_of(self.slopes[keep], self.first_m[keep])


def slopes_of(slopes: Floats, first_m: Floats) -> Slopes:
    """Median and interval of some tracks' slopes."""
    return Slopes(slopes, first_m, *with_ends(slopes, np.median))


class PathLength:
    """Metres flown, from speeds at increasing times (trapezoid)."""

    def __init__(self) -> None:
        self._stamps_ns: list[int] = []
        self._flown_m: list[float] = []
        self._speed_m_s = 0.0

    def add(self, stamp_ns: int, speed_m_s: float) -> None:
        """The next speed."""
        flown_m = 0.0
        if self._stamps_ns:
            between_s = (stamp_ns - self._stamps_ns[-1]) * 1e-9
            flown_m = self._flown_m[-1] + between_s * (self._speed_m_s + speed_m_s) / 2
        self._stamps_ns.append(stamp_ns)
        self._flown_m.append(flown_m)
        self._speed_m_s = speed_m_s

    def at(self, stamp_ns: int) -> float | None:
        """Metres flown up to a time; None outside the times that were given."""
        if not self._stamps_ns or not self._stamps_ns[0] <= stamp_ns <= self._stamps_ns[-1]:
            return None
        origin_ns = self._stamps_ns[0]
        stamps = np.array(self._stamps_ns) - origin_ns
        return float(np.interp(stamp_ns - origin_ns, stamps, self._flown_m))


class TrackedPoints:
    """Tracks corners from frame to frame and notes the depth under each."""

    def __init__(self) -> None:
        self._grey: Image | None = None
        self._alive: list[_Track] = []
        self._all: list[_Track] = []

    def add(self, image: Image, depth_m: Maps, flown_m: float) -> None:
        """The next frame: uint8 RGB [H, W, 3], depth [H, W] (NaN = unknown), metres flown so far."""
        now = grey(image)
        if self._grey is not None and self._alive:
            self._alive = _followed(self._grey, now, self._alive)
        self._replenish(now, depth_m)
        for track in self._alive:
            depth = _depth_at(depth_m, track.point)
            if np.isfinite(depth):
                track.flown_m.append(flown_m)
                track.depth_m.append(depth)
        self._grey = now

    def slopes(self, *, least_span_m: float) -> Slopes:
        """Fit every track that lasted `LEAST_SAMPLES` depths and `least_span_m` metres."""
        fitted = [
            (_theil_sen(*(_thinned(each) for each in (t.flown_m, t.depth_m))), t.depth_m[0])
            for t in self._all
            if len(t.depth_m) >= LEAST_SAMPLES and t.flown_m[-1] - t.flown_m[0] >= least_span_m
        ]
        columns = np.array(fitted, dtype=np.float64).reshape(-1, 2).T
        return slopes_of(*columns)

    def _replenish(self, now: Image, depth_m: Maps) -> None:
        """New corners where depth is known and no track is near."""
        mask = np.where(np.isfinite(depth_m), np.uint8(255), np.uint8(0))
        for track in self._alive:
            cv2.circle(mask, (round(track.point[0]), round(track.point[1])), 10, (0,), -1)
        wanted = MOST_POINTS - len(self._alive)
        if wanted <= 0:
            return
        corners = cv2.goodFeaturesToTrack(now, wanted, 0.01, 10, mask=mask)
        for x, y in [] if corners is None else corners[:, 0]:
            track = _Track((float(x), float(y)))
            self._alive.append(track)
            self._all.append(track)


def _followed(before: Image, now: Image, tracks: list[_Track]) -> list[_Track]:
    """Tracks found again in the next frame, there and back (Lucas-Kanade)."""
    points = np.array([t.point for t in tracks], np.float32)[:, None]
    there, seen, _ = cv2.calcOpticalFlowPyrLK(before, now, points, points.copy())
    back, seen_back, _ = cv2.calcOpticalFlowPyrLK(now, before, there, points.copy())
    error = np.linalg.norm(back - points, axis=(1, 2))
    height, width = now.shape
    kept = []
    for track, point, ok in zip(
        tracks,
        there[:, 0],
        np.asarray(seen)[:, 0] * np.asarray(seen_back)[:, 0] * (error < LARGEST_RETURN_PX),
        strict=True,
    ):
        if ok and 0 <= point[0] < width - 1 and 0 <= point[1] < height - 1:
            track.point = (float(point[0]), float(point[1]))
            kept.append(track)
    return kept


def _depth_at(depth_m: Maps, point: tuple[float, float]) -> float:
    """Median of the known depths round a point; NaN when fewer than half are known."""
    x, y = round(point[0]), round(point[1])
    patch = depth_m[max(y - PATCH_PX, 0) : y + PATCH_PX + 1, max(x - PATCH_PX, 0) : x + PATCH_PX + 1]
    known = patch[np.isfinite(patch)]
    return float(np.median(known)) if 2 * known.size >= patch.size and known.size else float("nan")


def _thinned(values: list[float]) -> Floats:
    """Every so-many-th of a track's values, MOST_SAMPLES at most: a fit takes time with their square."""
    return np.array(values[:: -(-len(values) // MOST_SAMPLES)])


def _theil_sen(x: Floats, y: Floats) -> float:
    """Median of the slopes between all pairs that lie at least a fifth of the span apart."""
    i, j = np.triu_indices(len(x), 1)
    apart = x[j] - x[i] >= 0.2 * (x[-1] - x[0])
    i, j = i[apart], j[apart]
    return float(np.median((y[j] - y[i]) / (x[j] - x[i])))
