"""How the pictures of a video move: turn rate, flow, direction of flight, from points followed in small grey ones."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from flightdepth.camera import Camera
from flightdepth.flight.mask import PictureMask
from flightdepth.flight.records import NS_PER_S, Frame
from flightdepth.flight.rotation import Flow, likeliest_motion, rotation_flow
from flightdepth.flight.steadiness import FEWEST_FOLLOWED, NOISE_PX, Grey, follow, small_camera, small_grey
from flightdepth.motion import Stamps, Vector

LEAST_STEP_NS = 30_000_000  # between two pictures; of faster video every second, third, ... is followed
# Back to which each is followed: over less time a slow turn drowns in the tracking's noise, over more a fast one blurs.
PAIR_NS = 90_000_000
LEAST_FLOW = 3.0  # tracking noises; where the median point moves less by flying, nothing shows which way


@dataclass(frozen=True, eq=False)
class ApparentMotion:
    """Of n pictures against those a tenth of a second before; NaN where too few points were followed.

    stamps_ns  [n]     midway between the two pictures
    turn_rad_s [n, 3]  turn rate, right-down-forward axes of the camera
    flow_1_s   [n]     median speed of the points without the turn, focal lengths a second: speed over distance
    direction  [n, 3]  unit vector of the flight, right-down-forward; NaN where it hardly shows, too
    """

    stamps_ns: Stamps
    turn_rad_s: Vector
    flow_1_s: Vector
    direction: Vector


class Followed(NamedTuple):
    """Pixels of the same points [n, 2] in two pictures of `small_camera`, and both times."""

    before: Vector
    after: Vector
    before_ns: int
    after_ns: int


def followed(frames: Iterable[Frame], camera: Camera, mask: PictureMask | None = None) -> Iterator[Followed]:
    """Points of each picture followed from one a tenth of a second before; about 2 ms a picture beside decoding.

    None of what a mask hides.
    """
    small = small_camera(camera)
    shown = None if mask is None else mask.at(small.width, small.height).shown
    kept: deque[tuple[int, Grey]] = deque()
    for frame in frames:
        if kept and frame.stamp_ns - kept[-1][0] < LEAST_STEP_NS:
            continue
        kept.append((frame.stamp_ns, small_grey(frame.image, small)))
        while len(kept) > 2 and frame.stamp_ns - kept[1][0] >= PAIR_NS:
            kept.popleft()
        (before_ns, before), (after_ns, after) = kept[0], kept[-1]
        if len(kept) > 1:
            start, end, _ = follow(before, after, shown)
            yield Followed(start, end, before_ns, after_ns)


def apparent_motion(
    frames: Iterable[Frame], camera: Camera, mask: PictureMask | None = None
) -> ApparentMotion:
    """Of the pictures of a camera, but for what a mask hides; about 5 ms a picture beside decoding."""
    small = small_camera(camera)
    stamps, rows = [], []
    for pair in followed(frames, camera, mask):
        stamps.append((pair.before_ns + pair.after_ns) // 2)
        rows.append(_motion(pair, small))
    table = np.array(rows, dtype=np.float64).reshape(-1, 7)
    return ApparentMotion(np.array(stamps, dtype=np.int64), table[:, :3], table[:, 3], table[:, 4:])


def _motion(pair: Followed, camera: Camera) -> Vector:
    """Turn rate (3,), median flow a second without it, direction of flight (3,) between two pictures: (7,)."""
    if len(pair.before) < FEWEST_FOLLOWED:
        return np.full(7, np.nan)
    noise = NOISE_PX / camera.fx
    flow = Flow.between(pair.before, pair.after, camera)
    turn, direction = likeliest_motion(flow, noise)
    along_x, along_y = rotation_flow(flow.points)
    left = flow.motions - np.stack([along_x @ turn, along_y @ turn], axis=1)
    moved = np.median(np.linalg.norm(left, axis=1))
    shows = moved >= LEAST_FLOW * noise
    span_s = (pair.after_ns - pair.before_ns) / NS_PER_S
    return np.concatenate([turn / span_s, [moved / span_s], direction if shows else np.full(3, np.nan)])
