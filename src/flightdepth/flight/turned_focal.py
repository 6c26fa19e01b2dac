"""The focal length that the camera's own turns tell.

When a camera turns, points move by focal length times angle. Its gyroscope, or its attitude, tells the angle, and the
pictures tell the pixels; the ratio is the focal length, and how points near the edge move beside those in the middle
tells an ideal lens from a fisheye. Flying moves points too: what changes evenly with time is taken off, turn by turn.
A drone's own attitude says nothing here, since a gimbal may stand between it and the camera.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.flight.records import NS_PER_S, Telemetry
from flightdepth.flight.rotation import rotation_flow
from flightdepth.flight.signals import Signal, turn_signal
from flightdepth.flight.turn_comparison import FEWEST_PAIRS, LEAST_RATE_RAD_S, Comparison, ToldTurns
from flightdepth.motion import Vector
from flightdepth.runtimes.lens import undistort

AROUND_S = 0.7  # pictures so near to a turn tell what flying does
MOST_PAIRS, MOST_POINTS = 1500, 80
FEWEST_POINTS = 10  # of a pair
LONGEST_PAIR_S = 0.25
LEAST_TURNED_DEG = 5.0
LEAST_CORRELATION = 0.93
MOST_SMOOTHER, MOST_DRIFT = 0.06, 0.2
MOST_RATIO = 4.0  # of the focal length that fits to the one that is tried first, or the other way round
ALIKE = 1.08  # misfits up to this ratio do not tell two lenses apart
ROUNDS, STEPS = 6, 12
SETTLED = 0.002
NOISE_PX = 0.3
WIDEST = math.tan(math.radians(75))  # off the axis; beyond it a fisheye's rays go to infinity


@dataclass(frozen=True)
class TurnedFocal:
    """What turns tell of a lens; `camera` is None where they tell nothing, and `reason` says why.

    camera      one of those that were tried, with the focal length that fits
    share       standard deviation of the focal length, as a share of it
    turned_deg  by how much the camera turned in all
    misfit_px   how far a turn through this lens leaves points from where they are, median
    """

    camera: Camera | None
    share: float = math.nan
    turned_deg: float = 0.0
    misfit_px: float = math.inf
    reason: str = ""


class TurnPoints:
    """Keeps the points that were followed in the newest `most` pairs of pictures of a camera that turns.

    `camera` is that of the pictures in which points are followed; times must rise.
    """

    def __init__(self, camera: Camera, *, most: int = MOST_PAIRS) -> None:
        self.camera = camera
        self._spans_s: deque[tuple[float, float]] = deque(maxlen=most)
        self._points: deque[NDArray[np.float32]] = deque(maxlen=most)

    def __len__(self) -> int:
        return len(self._spans_s)

    def add(self, before: Vector, after: Vector, before_ns: int, after_ns: int) -> bool:
        """Pixels [n, 2] of the same points in two pictures; whether they are of use."""
        start_s, end_s = before_ns / NS_PER_S, after_ns / NS_PER_S
        if len(before) < FEWEST_POINTS or end_s - start_s > LONGEST_PAIR_S:
            return False
        points = np.full((2, MOST_POINTS, 2), np.nan, np.float32)
        count = min(len(before), MOST_POINTS)
        points[:, :count] = before[:count], after[:count]
        self._spans_s.append((start_s, end_s))
        self._points.append(points)
        return True

    def focal(self, told: Signal | None, cameras: Sequence[Camera] = ()) -> TurnedFocal:
        """By that lens of some which fits best, where `told` says how the camera turned, rad/s. A second or two.

        The lens is the pictures' own where none are given.
        """
        if told is None:
            return TurnedFocal(None, reason="the log does not tell how the camera turns")
        if len(self) < FEWEST_PAIRS:
            return TurnedFocal(None, reason="the camera hardly turns")
        turns = ToldTurns(np.array(self._spans_s), told)
        points = np.array(self._points, dtype=np.float64)
        tries = [_fitted(camera, points, turns) for camera in cameras or (self.camera,)]
        known = sorted((each for each in tries if each.camera), key=lambda each: each.misfit_px)
        return _undecided(known) if known else min(tries, key=lambda each: each.misfit_px)


class TurnWatch:
    """Keeps points where a whole log says that the camera turned. `told`: turn rates; `camera`: see TurnPoints."""

    def __init__(self, log: Telemetry, camera: Camera) -> None:
        self.told, self.camera, self.points = told_rates(log), camera, TurnPoints(camera)
        self._turning_s = np.empty(0)
        if (calm := turn_signal(replace(log, body_attitudes=()))) is not None:
            rates = np.linalg.norm(calm.values, axis=1)
            self._turning_s = calm.at_s[rates > LEAST_RATE_RAD_S]

    def add(self, before: Vector, after: Vector, before_ns: int, after_ns: int) -> None:
        """Pixels [n, 2] of the same points in two pictures."""
        if self.wants(after_ns):
            self.points.add(before, after, before_ns, after_ns)

    def wants(self, stamp_ns: int) -> bool:
        """Whether the camera turns at about this time, and more pairs are of use."""
        at_s = stamp_ns / NS_PER_S
        first, last = np.searchsorted(self._turning_s, [at_s - AROUND_S, at_s + AROUND_S])
        return bool(first < last) and len(self.points) < MOST_PAIRS

    def busiest_s(self, first_s: float, last_s: float, length_s: float) -> float:
        """Start of the `length_s` between two times in which the camera turns most."""
        at_s = self._turning_s[(self._turning_s >= first_s) & (self._turning_s <= last_s)]
        if not len(at_s):
            return first_s
        counts = np.searchsorted(at_s, at_s + length_s) - np.arange(len(at_s))
        return max(first_s, float(at_s[int(counts.argmax())]) - AROUND_S)

    def focal(self, cameras: Sequence[Camera] = ()) -> TurnedFocal:
        """By that lens of some which fits best; by the pictures' own where none are given. A second or two."""
        return self.points.focal(self.told, cameras)


def told_rates(log: Telemetry) -> Signal | None:
    """Turn rates of the camera, rad/s: of its attitudes, else of its gyroscope as it stands; None without."""
    told, track = turn_signal(replace(log, gyroscope=None, body_attitudes=())), log.gyroscope
    if told is None and track is not None:
        told = Signal(track.stamps_ns / NS_PER_S, track.rates_rad_s, axes=False)
    return None if told is None or len(told.at_s) < FEWEST_PAIRS else told


def _undecided(known: Sequence[TurnedFocal]) -> TurnedFocal:
    """The first of some answers, as unsure as those differ that leave hardly more."""
    best = known[0]
    focals = [
        math.log(each.camera.fx) for each in known if each.camera and each.misfit_px < ALIKE * best.misfit_px
    ]
    return replace(best, share=math.hypot(best.share, (max(focals) - min(focals)) / 2))


def ideal_lenses(camera: Camera) -> tuple[Camera, Camera]:
    """An ideal pinhole and an equidistant fisheye, with the size and the focal length of a camera."""
    ideal = camera.without_distortion()
    return ideal, replace(ideal, model="fisheye")


def _fitted(camera: Camera, points: Vector, turns: ToldTurns) -> TurnedFocal:
    """The focal length of one lens: what turns seen through one tell is tried next."""
    focal = 1.0  # times that of `camera`
    for _ in range(STEPS):
        seen, misfit_px = _rotations(points, camera.zoomed(focal))
        best = turns.compared(seen)
        focal *= best.ratio
        if abs(best.ratio - 1) < SETTLED or not 1 / MOST_RATIO < focal < MOST_RATIO:
            break
    reason = _why_not(best)
    share = math.hypot(best.share, best.smoother, best.drift / math.sqrt(12))  # of what drifts evenly
    return TurnedFocal(None if reason else camera.zoomed(focal), share, best.turned_deg, misfit_px, reason)


def _why_not(best: Comparison) -> str:
    """Why turns seen through the lens that fits best tell nothing; empty where they do."""
    unfit = best.correlation < LEAST_CORRELATION or abs(best.ratio - 1) >= SETTLED
    away = f"{best.lag_s:+.2f} s away or more: is the log's clock the video's?"
    reasons = {
        f"it turns by {best.turned_deg:.0f} degrees only where the log tells it often enough": (
            best.turned_deg < LEAST_TURNED_DEG
        ),
        "it turns too briefly, or the other way round": math.isinf(best.share),
        f"its turns fit the pictures' best {away}": best.at_the_end,
        f"its turns and the pictures' do not fit (correlation {best.correlation:.2f})": unfit,
        "the pictures turn more smoothly than the log tells: stabilised, or by a gimbal": (
            best.smoother > MOST_SMOOTHER
        ),
        f"the focal length that they tell changes by {best.drift:.0%}: a zoom?": best.drift > MOST_DRIFT,
    }
    return next((reason for reason, holds in reasons.items() if holds), "")


def _rotations(points: Vector, lens: Camera) -> tuple[Vector, float]:
    """Rotation vectors [k, 3] that move points [k, 2, n, 2] as far as turning can; what they leave, px, median.

    Least squares with Cauchy's weights; NaN points are none.
    """
    rays = undistort(np.nan_to_num(points), lens)
    sound = np.asarray((np.isfinite(points) & (np.abs(rays) < WIDEST)).all(axis=(1, 3)))
    rays = np.where(sound[:, None, :, None], rays, 0.0)
    moved = (rays[:, 1] - rays[:, 0]).reshape(len(points), -1, 1)
    rows = np.stack(rotation_flow(((rays[:, 0] + rays[:, 1]) / 2).reshape(-1, 2)), axis=1)
    rows = rows.reshape(len(points), -1, 3)  # x and y of each point
    weights = sound.astype(np.float64)
    for _ in range(ROUNDS):
        weighted = (rows * np.repeat(weights, 2, axis=1)[..., None]).transpose(0, 2, 1)
        regular = weighted @ rows + 1e-9 * np.eye(3)
        turned = np.asarray(np.linalg.solve(regular, weighted @ moved), dtype=np.float64)
        left_px = lens.fx * np.linalg.norm((rows @ turned - moved).reshape(*sound.shape, 2), axis=2)
        weights = sound / (1 + (left_px / NOISE_PX) ** 2)
    angles = np.linalg.norm(turned[..., 0], axis=1)
    fast = sound & np.asarray(angles > np.median(angles))[:, None]
    return turned[..., 0], float(np.median(left_px[fast])) if fast.any() else math.inf
