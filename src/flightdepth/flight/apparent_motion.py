"""How the pictures of a video move: turn rate and flow, from points followed in small grey pictures."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.flight.records import NS_PER_S, Frame
from flightdepth.flight.rotation import Flow, rotation_flow, smallest_rotation
from flightdepth.flight.steadiness import FEWEST_FOLLOWED, NOISE_PX, Grey, follow, small_camera, small_grey
from flightdepth.motion import Vector
from flightdepth.runtimes.lens import undistort

LEAST_STEP_NS = 30_000_000  # between two pictures; of faster video every second, third, ... is followed
# Back to which each is followed: over less time a slow turn drowns in the tracking's noise, over more a fast one blurs.
PAIR_NS = 90_000_000


@dataclass(frozen=True, eq=False)
class ApparentMotion:
    """Of n pictures against those a tenth of a second before; NaN where too few points were followed.

    stamps_ns  [n]     midway between the two pictures
    turn_rad_s [n, 3]  turn rate, right-down-forward axes of the camera
    flow_1_s   [n]     median speed of the points without the turn, focal lengths a second: speed over distance
    """

    stamps_ns: NDArray[np.int64]
    turn_rad_s: Vector
    flow_1_s: Vector


def apparent_motion(frames: Iterable[Frame], camera: Camera) -> ApparentMotion:
    """Of the pictures of a camera; about 4 ms a picture beside decoding."""
    small = small_camera(camera)
    stamps, rows = [], []
    kept: deque[tuple[int, Grey]] = deque()
    for frame in frames:
        if kept and frame.stamp_ns - kept[-1][0] < LEAST_STEP_NS:
            continue
        kept.append((frame.stamp_ns, small_grey(frame.image, small)))
        while len(kept) > 2 and frame.stamp_ns - kept[1][0] >= PAIR_NS:
            kept.popleft()
        (before_ns, before), (now_ns, now) = kept[0], kept[-1]
        if len(kept) > 1:
            stamps.append((before_ns + now_ns) // 2)
            rows.append(_motion(before, now, small) * NS_PER_S / (now_ns - before_ns))
    table = np.array(rows, dtype=np.float64).reshape(-1, 4)
    return ApparentMotion(np.array(stamps, dtype=np.int64), table[:, :3], table[:, 3])


def _motion(before: Grey, after: Grey, camera: Camera) -> Vector:
    """Rotation vector (3,) and median flow without it, (4,), from one picture to the next."""
    start, end, _ = follow(before, after)
    if len(start) < FEWEST_FOLLOWED:
        return np.full(4, np.nan)
    flow = Flow.between(undistort(start, camera), undistort(end, camera))
    turn = smallest_rotation(flow, NOISE_PX / camera.fx)
    along_x, along_y = rotation_flow(flow.points)
    left = flow.motions - np.stack([along_x @ turn, along_y @ turn], axis=1)
    return np.append(turn, np.median(np.linalg.norm(left, axis=1)))
