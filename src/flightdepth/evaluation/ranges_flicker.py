"""Flicker: how much depth changes from one frame to the next beyond what the motion explains."""

from __future__ import annotations

import numpy as np

from flightdepth.camera import Camera
from flightdepth.evaluation.arrays import Maps
from flightdepth.motion import Vector


def moved(depth_m: Maps, displacement: Vector, camera: Camera) -> Maps:
    """A depth map [h, w] as the next frame sees it, `displacement` (3,) metres later; NaN where nothing falls.

    Each pixel's point goes to the nearest pixel of the next map, of several the nearest point.
    """
    h, w = depth_m.shape
    view = camera.resized(w, h)
    points = view.rays()[np.isfinite(depth_m)] * depth_m[np.isfinite(depth_m), None] - displacement
    points = points[points[:, 2] > 0]
    x = np.rint(view.fx * points[:, 0] / points[:, 2] + view.cx)
    y = np.rint(view.fy * points[:, 1] / points[:, 2] + view.cy)
    inside = (x >= 0) & (x < w) & (y >= 0) & (y < h)
    there = np.full((h, w), np.inf, np.float32)
    place = y[inside].astype(np.intp), x[inside].astype(np.intp)
    np.minimum.at(there, place, points[inside, 2].astype(np.float32))
    there[np.isinf(there)] = np.nan
    return there


def flicker(before_m: Maps, now_m: Maps, displacement: Vector, camera: Camera) -> float:
    """Median |depth(t) moved by the motion - depth(t + 1)| / depth(t + 1); NaN where no pixel has both."""
    change = np.abs(moved(before_m, displacement, camera) - now_m) / now_m
    known = change[np.isfinite(change)]
    return float(np.median(known)) if known.size else float("nan")
