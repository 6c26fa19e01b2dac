"""What a video or a log says over time, as columns of numbers on one clock: turn rates, speeds, directions."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flightdepth.flight.records import MAX_GAP_S, NS_PER_S, AttitudeSample, Telemetry
from flightdepth.motion import Stamps, Vector, mixed_quaternions, rotations_from_quaternions

STEP_S = 0.04
SLOWEST_M_S = 1.0  # a slower flight has no direction that could be told from noise


@dataclass(frozen=True, eq=False)
class Signal:
    """Values [n, c] at rising times, seconds [n]; `axes` whether the columns are the camera's own axes."""

    at_s: Vector
    values: Vector
    axes: bool = True

    @property
    def steps(self) -> tuple[int, int]:
        """The numbers of its first whole step and of the one after its last."""
        return int(np.ceil(self.at_s[0] / STEP_S)), int(self.at_s[-1] / STEP_S) + 1

    @property
    def told_s(self) -> float:
        """How long it tells something, without the gaps."""
        apart_s = np.diff(self.at_s)
        return float(apart_s[apart_s <= MAX_GAP_S].sum())

    def parts(self, silence_s: float) -> list[Signal]:
        """What lies between silences that are longer than that, as a clock makes them that is set by years."""
        cuts = np.flatnonzero(np.diff(self.at_s) > silence_s) + 1
        split = zip(np.split(self.at_s, cuts), np.split(self.values, cuts), strict=True)
        return [replace(self, at_s=at_s, values=values) for at_s, values in split]

    def on_grid(self) -> tuple[int, Vector]:
        """The number n of the first whole step, and values at STEP_S * (n, n + 1, ...), [k, c]; NaN in gaps."""
        first, end = self.steps
        at_s = np.arange(first, end) * STEP_S
        known = np.isfinite(self.values).all(axis=1)
        times, values = self.at_s[known], self.values[known]
        if len(times) < 2:
            return first, np.full((len(at_s), self.values.shape[1]), np.nan)
        after = np.searchsorted(times, at_s).clip(1, len(times) - 1)
        inside = (at_s >= times[0]) & (at_s <= times[-1]) & (times[after] - times[after - 1] <= MAX_GAP_S)
        columns = [np.where(inside, np.interp(at_s, times, column), np.nan) for column in values.T]
        return first, np.stack(columns, axis=1)


def turn_signal(log: Telemetry) -> Signal | None:
    """Turn rates, rad/s: of the camera's attitude, else of its gyroscope, else of the drone; None without any."""
    if len(cameras := log.attitudes) > 2:
        stamps_ns = np.array([each.stamp_ns for each in cameras])
        return attitude_rates(stamps_ns, np.array([each.world_from_camera for each in cameras]))
    if log.gyroscope is not None and len(log.gyroscope.stamps_ns) > 2:
        track = log.gyroscope
        return Signal(track.stamps_ns / NS_PER_S, _smooth(track.rates_rad_s, track.stamps_ns), axes=False)
    if len(bodies := log.body_attitudes) > 2:
        stamps_ns = np.array([each.stamp_ns for each in bodies])
        return attitude_rates(stamps_ns, np.array([each.world_from_body for each in bodies]), axes=False)
    return None


def speed_signal(log: Telemetry) -> Signal:
    """Speeds, m/s."""
    speeds = np.array([np.linalg.norm(each.velocity) for each in log.velocities])
    return Signal(np.array([each.stamp_ns for each in log.velocities]) / NS_PER_S, speeds[:, None])


def direction_signal(log: Telemetry) -> Signal | None:
    """Directions of flight, unit vectors, NaN where it is slow: in the camera's axes where the log tells them.

    Else in the world's, which a camera that does not turn sees in one rotation. None where no direction is told.
    """
    told = log.velocities
    if log.any_direction:
        return None
    at_s = np.array([each.stamp_ns for each in told]) / NS_PER_S
    velocities = np.array([each.velocity for each in told])
    axes = told[0].frame == "camera"
    if not axes and len(cameras := log.attitudes) > 2:
        axes, velocities = True, _in_camera(at_s, velocities, cameras)
    speeds = np.linalg.norm(velocities, axis=1, keepdims=True)
    return Signal(at_s, velocities / np.where(speeds >= SLOWEST_M_S, speeds, np.nan), axes)


def _in_camera(at_s: Vector, velocities_n3: Vector, cameras: list[AttitudeSample]) -> Vector:
    """World velocities [n, 3] in the axes of the camera at those times; NaN where its attitude is not told."""
    turned_s = np.array([each.stamp_ns for each in cameras]) / NS_PER_S
    quaternions = np.array([each.world_from_camera for each in cameras])
    after = np.searchsorted(turned_s, at_s).clip(1, len(turned_s) - 1)
    gap_s = turned_s[after] - turned_s[after - 1]
    share = (at_s - turned_s[after - 1]) / gap_s
    mixed = mixed_quaternions(quaternions[after - 1], quaternions[after], share.clip(0, 1))
    known = (share >= 0) & (share <= 1) & (gap_s <= MAX_GAP_S)
    turned = np.einsum("nji,nj->ni", rotations_from_quaternions(mixed), velocities_n3)
    return np.where(known[:, None], turned, np.nan)


def attitude_rates(stamps_ns: Stamps, quaternions_n4: Vector, *, axes: bool = True) -> Signal:
    """Turn rates midway between successive attitudes [n, 4] (w, x, y, z), in the axes of what turns, rad/s [m, 3].

    `axes`: whether these are the camera's.
    """
    at_s = stamps_ns / NS_PER_S
    turns = rotations_from_quaternions(quaternions_n4)
    steps = np.einsum("kji,kjl->kil", turns[:-1], turns[1:])
    odd = steps - steps.transpose(0, 2, 1)
    vectors = np.stack([odd[:, 2, 1], odd[:, 0, 2], odd[:, 1, 0]], axis=1) / 2  # as long as the turn's sine
    sines = np.linalg.norm(vectors, axis=1)
    turned_rad = np.arctan2(sines, (np.trace(steps, axis1=1, axis2=2) - 1) / 2)
    vectors *= (turned_rad / np.maximum(sines, np.finfo(np.float64).tiny))[:, None]
    span_s = np.diff(at_s)
    sound = (span_s > 0) & (span_s <= MAX_GAP_S)
    middle_s = (at_s[1:] + at_s[:-1]) / 2
    return Signal(middle_s[sound], vectors[sound] / span_s[sound, None], axes)


def _smooth(values: Vector, stamps_ns: Stamps) -> Vector:
    """Means over STEP_S of values [n, c] that come much faster: of an odd number, or they would be half a step late."""
    count = round(STEP_S * NS_PER_S / max(float(np.median(np.diff(stamps_ns))), 1.0)) | 1
    window = np.ones(count if count <= len(values) else 1)
    of = np.convolve(np.ones(len(values)), window, mode="same")  # at either end fewer
    return np.stack([np.convolve(column, window, mode="same") / of for column in values.T], axis=1)
