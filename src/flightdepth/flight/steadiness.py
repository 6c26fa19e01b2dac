"""Which pictures turn too fast for depth: told from them, or from the gyroscope where they say nothing.

DepthNet expects pictures that do not turn against each other. Rotation by an angle moves the picture as a
displacement of angle * depth does, so it changes depth by a share of angle * alpha * beta (paper, eq. 3).
At beta_mean = 0.4 and DepthNet's alpha = 100 m / 0.3 m the change is the depth itself at 1 / (0.4 * 333) =
0.0075 rad (0.43 degrees) within a pair; the paper's own noise, 0.001 rad a frame, stays well below. Where each
pair's rotation is seen in its pictures and taken out (ranges/derotation.py), four times as much does no harm; where
the attitude is told too, so that only its error is left to be seen, twenty-one times as much (benchmarks/turns.py).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.flight.records import NS_PER_S, GyroscopeTrack
from flightdepth.flight.rotation import Flow, likeliest_rotation
from flightdepth.motion import Vector
from flightdepth.runtimes.arrays import Flags
from flightdepth.runtimes.sampling import shown_at

MAX_TURN_RAD = 0.0075
MAX_DEROTATED_RAD = 0.03
MAX_REPORTED_RAD = 0.16
PAIR_NS = 110_000_000  # a nominal pair: 0.1 s and a little, so that three steps at 29.97 frames/s count
SMALL_WIDTH = 160
MAX_POINTS = 80
MIN_POINTS = 20
FEWEST_FOLLOWED = MIN_POINTS // 2
MIN_FOLLOWED = 0.15  # share of the points found again; fewer: blur of a very fast turn, or a cut
NOISE_PX = 0.15
CORNER_PX = 5  # a corner is told by a square of so many pixels
RETURN_PX = 0.5  # a point tracked forth and back comes home within this

Grey = NDArray[np.uint8]
OnFollowed = Callable[[Vector, Vector, int, int], None]


@dataclass(frozen=True)
class TurnRate:
    """How fast the camera turns at a picture.

    rad_s   turn rate over the last 0.1 s (at low frame rates: since the picture before); NaN = cannot tell
    usable  False where pairs with this picture turn too much for depth
    reason  why not, or why it cannot be told; empty where the picture is steady
    """

    rad_s: float
    usable: bool
    reason: str = ""

    @property
    def unusable(self) -> str | None:
        """Why pairs with this picture give no depth; None where they do."""
        return None if self.usable else self.reason


class Steadiness:
    """Follows points of small grey pictures over 0.1 s; about 5 ms a picture on one core.

    `on_followed` gets their pixels in `small_camera` [n, 2], then and now, and both times.
    """

    def __init__(
        self,
        camera: Camera,
        gyroscope: GyroscopeTrack | None = None,
        *,
        on_followed: OnFollowed | None = None,
        shown: Flags | None = None,
    ) -> None:
        """`shown` [H, W] is False where points are not to be followed."""
        self._source, self._camera = camera, small_camera(camera)
        self._gyroscope, self._on_followed = gyroscope, on_followed
        size = (self._camera.width, self._camera.height)
        self._shown = None if shown is None else shown_at(shown, *size)
        self._kept: deque[tuple[int, Grey]] = deque()

    def see_through(self, camera: Camera) -> None:
        """Take the next pictures for those of `camera`, of the same size: the lens zoomed."""
        self._camera = small_camera(camera)

    def add(self, stamp_ns: int, image: NDArray[np.uint8], max_turn_rad: float = MAX_TURN_RAD) -> TurnRate:
        """Judge the next picture, uint8 RGB [H, W, 3] of the camera's size; stamps must rise.

        It is usable up to a turn of `max_turn_rad` over the last 0.1 s.
        """
        if self._kept and stamp_ns <= self._kept[-1][0]:
            raise BadInput("picture", expected=f"a stamp after {self._kept[-1][0]}", got=str(stamp_ns))
        grey = self._small(image)
        self._forget(stamp_ns)
        rate = self._judge(stamp_ns, grey, max_turn_rad) if self._kept else TurnRate(0.0, True)
        self._kept.append((stamp_ns, grey))
        return rate

    def _small(self, image: NDArray[np.uint8]) -> Grey:
        if image.shape[:2] != (self._source.height, self._source.width):
            expected = f"{self._source.width}x{self._source.height}"
            raise BadInput("picture size", expected=expected, got=f"{image.shape[1]}x{image.shape[0]}")
        return small_grey(image, self._camera)

    def _forget(self, stamp_ns: int) -> None:
        """Drop what is older than a pair, but never the picture before this one."""
        while len(self._kept) > 1 and stamp_ns - self._kept[0][0] > PAIR_NS:
            self._kept.popleft()

    def _judge(self, stamp_ns: int, grey: Grey, max_turn_rad: float) -> TurnRate:
        before_ns, before = self._kept[0]
        span_s = (stamp_ns - before_ns) / NS_PER_S
        start, end, found = follow(before, grey, self._shown)
        if self._on_followed is not None:
            self._on_followed(start, end, before_ns, stamp_ns)
        if found < MIN_POINTS:
            return self._from_gyroscope(before_ns, stamp_ns, max_turn_rad)
        if len(start) < max(FEWEST_FOLLOWED, MIN_FOLLOWED * found):
            return TurnRate(float("nan"), False, "the picture changes too fast to be followed")
        flow = Flow.between(start, end, self._camera)
        turn_rad = float(np.linalg.norm(likeliest_rotation(flow, NOISE_PX / self._camera.fx)))
        return verdict(turn_rad, span_s, "the picture", max_turn_rad)

    def _from_gyroscope(self, before_ns: int, stamp_ns: int, max_turn_rad: float) -> TurnRate:
        turn_rad = None if self._gyroscope is None else self._gyroscope.turn_rad(before_ns, stamp_ns)
        if turn_rad is None:
            return TurnRate(float("nan"), True, "too little texture to tell whether the picture turns")
        return verdict(turn_rad, (stamp_ns - before_ns) / NS_PER_S, "the gyroscope", max_turn_rad)


def verdict(turn_rad: float, span_s: float, witness: str, max_turn_rad: float = MAX_TURN_RAD) -> TurnRate:
    """Turn rate of `turn_rad` in `span_s` seconds, and whether a pair that far apart can be used."""
    if turn_rad <= max_turn_rad:
        return TurnRate(turn_rad / span_s, True)
    reason = f"turns {np.degrees(turn_rad):.1f} degrees in {span_s:.2f} s, says {witness}"
    return TurnRate(turn_rad / span_s, False, reason)


def small_camera(camera: Camera) -> Camera:
    """The camera of pictures SMALL_WIDTH wide, in which points are followed."""
    return camera.resized(SMALL_WIDTH, max(1, round(camera.height * SMALL_WIDTH / camera.width)))


def small_grey(image: NDArray[np.uint8], small: Camera) -> Grey:
    """A picture uint8 RGB [H, W, 3] in grey at the size of `small`."""
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)  # first: one channel is cheaper to average
    return np.asarray(cv2.resize(grey, (small.width, small.height), interpolation=cv2.INTER_AREA), np.uint8)


def follow(before: Grey, after: Grey, shown: Flags | None = None) -> tuple[Vector, Vector, int]:
    """Pixels [n, 2] of corners in `before`, of the same ones in `after`, and how many were looked for.

    No corners are looked for where `shown` [h, w] is False, nor so near to it that they may be its edge.
    """
    around = np.ones((CORNER_PX, CORNER_PX), np.uint8)
    mask = None if shown is None else cv2.erode(shown.astype(np.uint8), around)
    corners = cv2.goodFeaturesToTrack(before, MAX_POINTS, 0.01, 6, mask=mask)
    if corners is None:
        return np.empty((0, 2)), np.empty((0, 2)), 0
    window = {"winSize": (11, 11), "maxLevel": 3}
    there, forth, _ = cv2.calcOpticalFlowPyrLK(before, after, corners, None, **window)  # type: ignore[call-overload]
    home, back, _ = cv2.calcOpticalFlowPyrLK(after, before, there, None, **window)  # type: ignore[call-overload]
    returned = np.linalg.norm((home - corners)[:, 0], axis=1) < RETURN_PX
    good = (forth[:, 0] == 1) & (back[:, 0] == 1) & returned
    return corners[good, 0].astype(np.float64), there[good, 0].astype(np.float64), len(corners)
