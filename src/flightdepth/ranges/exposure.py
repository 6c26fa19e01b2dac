"""Earlier pictures as the current one's exposure shows them: to a network a point at rest looks the same in both.

A camera that sets its exposure by itself brightens the whole picture as the sky leaves it. Half a stop between the two
pictures of a pair makes the error of `motion` more than twice as large, a whole one ten times (docs/filming.md).
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from flightdepth.camera import Camera
from flightdepth.levels import GREY, AnyImage, within_levels
from flightdepth.motion import Vector
from flightdepth.ranges.pairs import Baselines, Frame
from flightdepth.ranges.turning import in_view, is_visible, turned
from flightdepth.runtimes.arrays import Flags
from flightdepth.runtimes.sampling import shown_at

BLOCK_PX = 8  # exposures are compared in means of such blocks, which hide noise and most of what moved
DARKEST, BRIGHTEST = 6, 245  # grey levels beyond which a block says nothing
FEWEST_BLOCKS = 64
# Of the median of log2(now / before), and of that over the median deviation from it. Without a change of exposure the
# first is 0.013 at most, three times the nominal displacement apart; a change that makes less costs little. The second
# was 0.54 where points had moved by a quarter of a real picture, and above 0.6 in one room of 60 at six times.
LEAST_CHANGE, LEAST_OVER_SPREAD = 0.02, 0.6
QUANTILES = np.linspace(0.05, 0.95, 37)
STEPS = 10
OUTLIER_SIGMAS, LEAST_SIGMA = 3.0, 0.5  # of Tukey's biweight; grey levels
# That black stays black, beside all blocks: a picture of one brightness tells a factor alone.
BLACK_WEIGHT = 0.002


class ExposedFrames:
    """The frames of baselines, each as the current picture's exposure shows it; worked out where it is asked for."""

    def __init__(
        self,
        lines: Baselines,
        current: AnyImage,
        camera: Camera,
        shown: Flags | None = None,
        *,
        evened: Callable[[AnyImage], AnyImage],
    ) -> None:
        """`shown` [h, w], a quarter of the size, is False where brightness is not to be compared.

        `evened` makes a frame's picture as bright in its corners as in its middle, as `current` is.
        """
        self._lines, self._camera, self._now, self._shown = lines, camera, _blocks(current), shown
        self._evened = evened
        self._found: dict[int, Frame] = {}

    def __getitem__(self, k: int) -> Frame:
        """Frame `k` of the baselines, the same object each time."""
        if k not in self._found:
            frame, turn = self._lines.frames[k], self._lines.current_from_previous[k]
            turn_rad = float(self._lines.turn_rad[k])
            image = self._evened(frame.image)
            image = _exposed_as(image, self._now, self._camera, turn, turn_rad, shown=self._shown)
            self._found[k] = Frame(frame.index, frame.stamp_ns, image)
        return self._found[k]


def exposed_as(
    previous: AnyImage,
    current: AnyImage,
    camera: Camera,
    current_from_previous: Vector | None = None,
    turn_rad: float = 0.0,
    *,
    shown: Flags | None = None,
) -> AnyImage:
    """`previous`, RGB [H, W, 3] of an ideal pinhole, as bright as `current`; itself where no change is seen.

    `current_from_previous` (3, 3) and its angle tell how the camera turned between the two; `shown` [h, w] where both
    show the scene.
    """
    return _exposed_as(previous, _blocks(current), camera, current_from_previous, turn_rad, shown=shown)


def _exposed_as(
    previous: AnyImage,
    now: Vector,
    camera: Camera,
    current_from_previous: Vector | None,
    turn_rad: float,
    *,
    shown: Flags | None,
) -> AnyImage:
    """`exposed_as` with the current picture's blocks, [h, w]."""
    before, size = _blocks(previous), (now.shape[1], now.shape[0])
    seen = np.ones(now.shape, dtype=np.bool_) if shown is None else shown_at(shown, *size)
    small = camera.resized(*size)
    if current_from_previous is not None and is_visible(turn_rad, small):
        before = turned(before, current_from_previous, small)
        seen = seen & in_view(current_from_previous, small, seen)
    line = tone_line(before, now, seen)
    if line is None:
        return previous
    factor, offset = map(np.float32, line)
    return within_levels(previous * factor + offset)


def tone_line(before: AnyImage, now: AnyImage, seen: Flags) -> tuple[float, float] | None:
    """Factor and offset, in grey levels, from one grey picture [h, w] to another of much the same; None: no change.

    sRGB makes a factor of a change of exposure, a logarithmic profile an offset. Of blocks that moved, noise is as
    large in both pictures, so the line is the reduced major axis, weighted by Tukey's biweight from the line through
    the quantiles of both on, which do not ask what moved where.
    """
    for each in (before, now):
        seen = seen & (each >= DARKEST) & (each <= BRIGHTEST)
    x, y = before[seen].astype(np.float64), now[seen].astype(np.float64)
    if len(x) < FEWEST_BLOCKS:
        return None
    change = np.log2(y / x)
    typical = np.median(change)
    if abs(typical) < max(LEAST_CHANGE, LEAST_OVER_SPREAD * np.median(np.abs(change - typical))):
        return None
    factor, offset = _major_axis(
        np.quantile(x, QUANTILES), np.quantile(y, QUANTILES), np.ones(len(QUANTILES))
    )
    for _ in range(STEPS):
        left = y - factor * x - offset
        sigma = 1.4826 * np.median(np.abs(left)) + LEAST_SIGMA
        weight = np.clip(1 - (left / (OUTLIER_SIGMAS * sigma)) ** 2, 0, None) ** 2
        factor, offset = _major_axis(x, y, weight)
    return factor, offset


def _major_axis(x: Vector, y: Vector, weight: Vector) -> tuple[float, float]:
    """Slope and offset of points [N], and of black that stays black."""
    weight = weight / weight.sum()
    mean_x, mean_y = float(weight @ x), float(weight @ y)
    spread_x = float(weight @ (x - mean_x) ** 2) + BLACK_WEIGHT * mean_x**2
    spread_y = float(weight @ (y - mean_y) ** 2) + BLACK_WEIGHT * mean_y**2
    slope = (spread_y / spread_x) ** 0.5
    return slope, mean_y - slope * mean_x


def _blocks(image: AnyImage) -> Vector:
    """Means of blocks of a picture, grey, not rounded."""
    height, width = image.shape[:2]
    size = (max(width // BLOCK_PX, 1), max(height // BLOCK_PX, 1))
    means = cv2.resize(image.astype(np.float32, copy=False), size, interpolation=cv2.INTER_AREA)
    # `exact_grey` is float32, in which the shares do not make up a whole: a picture of one level would change.
    return np.asarray(means @ np.array(GREY), dtype=np.float64)
