"""The offset between a video and its log, from what both say: how the camera turns, how fast and which way it flies.

The log's signal is moved along the video's; the normalised cross-correlation peaks where the two fit. A peak is
believed only if it is high, alone and narrow: a straight flight at an even speed, or one that turns to and fro
evenly, tells no offset, and is said to tell none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from flightdepth.flight.apparent_motion import ApparentMotion
from flightdepth.flight.correlation import LEAST_OVERLAP_S, Curve, correlations
from flightdepth.flight.records import NS_PER_S, Telemetry
from flightdepth.flight.signals import STEP_S, Signal, direction_signal, speed_signal, turn_signal
from flightdepth.motion import Vector

Witness = Literal["turn rate", "speed", "direction"]

LEAST_TURN_RAD_S = 0.02  # deviation over time; less is what tracking makes of a steady camera
LEAST_SPEED_SHARE = 0.1  # deviation of a speed over its mean
LEAST_DIRECTION = (
    0.2  # deviation of a direction, radians; on a straight flight pictures show less than half of it
)
LEAST_CORRELATION = 0.6
WORST_DOUBT = 0.01
BEST_CORRELATION = 0.98  # more is not believed: the model is not as good as that
FOOT = 0.7  # of the peak: where another one may begin
WORST_SIGMA_S = 0.25
DISAGREEMENT_S = 0.2


@dataclass(frozen=True)
class ClockOffset:
    """offset_s is added to the log's times so that they count from the first picture; None where it is not known.

    sigma_s      standard deviation of the offset, from the peak's width and height
    correlation  at the peak, -1..1
    doubt        odds of the next best peak against this one, 0..1: near 1 is ambiguous
    witness      what told it
    reason       why it is not known, empty where it is
    """

    offset_s: float | None
    sigma_s: float | None
    correlation: float
    doubt: float | None
    witness: Witness
    reason: str = ""

    def contradicts(self, told_s: float) -> bool:
        """Whether an offset told by someone else, seconds, can't be true."""
        if self.offset_s is None or self.sigma_s is None:
            return False
        return abs(self.offset_s - told_s) > max(DISAGREEMENT_S, 4 * self.sigma_s)

    def __str__(self) -> str:
        if self.offset_s is None or self.doubt is None:
            return f"unknown: {self.reason}"
        return (
            f"{self.offset_s:+.3f} s, give or take {self.sigma_s:.3f} s, by the {self.witness}"
            f" (correlation {self.correlation:.2f}, odds of another offset {self.doubt:.1g})"
        )


def estimate_offset(motion: ApparentMotion, log: Telemetry, within_s: float | None = None) -> ClockOffset:
    """What to add to the log's times; the witness with the narrower peak decides, if it is believed at all.

    Where neither turns nor speeds tell it, the direction may: a flight that goes ahead, then aside.
    `within_s`: larger offsets are not looked at, where the log tells about when the video began.
    """
    turns = Signal(motion.stamps_ns / NS_PER_S, motion.turn_rad_s)
    flow = Signal(motion.stamps_ns / NS_PER_S, motion.flow_1_s[:, None])
    tries = [
        _compared("turn rate", turns, turn_signal(log), within_s),
        _compared("speed", flow, speed_signal(log), within_s),
    ]
    known = [each for each in tries if each.offset_s is not None]
    if not known:
        tries.append(_by_direction(motion, turns, log, within_s))
        known = [each for each in tries if each.offset_s is not None]
    if not known:
        reasons = "; ".join(f"{each.witness}: {each.reason}" for each in tries)
        best = max(tries, key=lambda each: each.correlation)
        return replace(best, reason=reasons)
    best = min(known, key=lambda each: each.sigma_s or 0.0)
    if any(other.contradicts(best.offset_s or 0.0) for other in known):
        return replace(best, offset_s=None, reason="turn rate and speed disagree")
    return best


def _by_direction(
    motion: ApparentMotion, turns: Signal, log: Telemetry, within_s: float | None
) -> ClockOffset:
    """The offset by the direction of flight in the camera's axes, or in unknown ones of a camera that hardly turns."""
    told = direction_signal(log)
    turning = len(turns.at_s) and _too_even("turn rate", turns.on_grid()[1], few="few") is None
    if told is not None and not told.axes and turning:
        return _unknown("direction", "the camera turns, and the log does not tell how")
    seen = Signal(motion.stamps_ns / NS_PER_S, motion.direction)
    return _compared("direction", seen, told, within_s)


def _compared(witness: Witness, seen: Signal, told: Signal | None, within_s: float | None) -> ClockOffset:
    """The offset by one witness."""
    if told is None:
        return _unknown(witness, "the log has none")
    if not len(seen.at_s):
        return _unknown(witness, "fewer than two pictures")
    video = seen.on_grid()
    reason = _too_even(witness, video[1], few="too few points in the pictures")
    reason = reason or _too_even(witness, told.values, few="the log tells too few")
    if reason is not None:
        return _unknown(witness, reason)
    curve = correlations(video, told, within_s)
    if not np.isfinite(curve.values).any():
        return _unknown(witness, f"less than {LEAST_OVERLAP_S:g} s in common")
    return _judged(witness, curve, video[1])


def _too_even(witness: Witness, values: Vector, *, few: str) -> str | None:
    """Why a signal [n, c] tells nothing, `few` where it is short; None where it tells something."""
    known = values[np.isfinite(values).all(axis=1)]
    if len(known) < 3:
        return few
    deviation = float(np.sqrt(known.var(axis=0).sum()))
    if witness == "direction":
        return None if deviation >= LEAST_DIRECTION else f"even within {np.degrees(deviation):.0f} degrees"
    if witness == "turn rate":
        return None if deviation >= LEAST_TURN_RAD_S else f"even within {np.degrees(deviation):.1f} degrees/s"
    share = deviation / max(float(known.mean()), 1e-9)
    return None if share >= LEAST_SPEED_SHARE else f"even within {share:.0%}"


def _judged(witness: Witness, curve: Curve, video: Vector) -> ClockOffset:
    """The peak between its steps, and whether it can be believed."""
    values = np.where(np.isfinite(curve.values), curve.values, -1.0)
    top = int(values.argmax())
    peak = float(values[top])
    inside = np.isfinite(curve.values[max(top - 1, 0) : top + 2]).sum() == 3  # else it may rise further
    if not inside or peak < LEAST_CORRELATION:
        return ClockOffset(None, None, peak, None, witness, f"no fit (correlation {peak:.2f} at best)")
    before, after = values[top - 1], values[top + 1]
    bend = max(2 * peak - before - after, 1e-12)
    offset_s = (curve.lags[top] + (after - before) / 2 / bend) * STEP_S
    # A correlation c that bends by c'' is off by sqrt((1 - c^2) / (n c'')), n the independent samples that tell of it.
    independent = max(curve.samples[top] * STEP_S / _memory_s(video) * _telling_share(video), 1.0)
    sigma_s = float(np.sqrt(_unexplained(peak) / (independent * bend / STEP_S**2)))
    doubt = float((_unexplained(peak) / _unexplained(_runner_up(values, top))) ** (independent / 2))
    reason = ""
    if doubt > WORST_DOUBT:
        reason = f"another offset fits nearly as well (odds {doubt:.2g})"
    elif sigma_s > WORST_SIGMA_S:
        reason = f"the peak is too wide ({sigma_s:.2f} s)"
    return ClockOffset(None if reason else float(offset_s), sigma_s, peak, doubt, witness, reason)


def _unexplained(correlation: float) -> float:
    """The share of a signal's variance that a fit leaves: the likelihood of n samples goes with its power -n / 2."""
    return 1 - min(correlation, BEST_CORRELATION) ** 2


def _runner_up(values: Vector, top: int) -> float:
    """The highest value beyond the peak's feet, where the curve has fallen to FOOT of it."""
    low = values < FOOT * values[top]
    left, right = np.flatnonzero(low[:top]), np.flatnonzero(low[top:])
    beyond_left = values[: left[-1]] if len(left) else values[:0]
    beyond_right = values[top + right[0] :] if len(right) else values[:0]
    return float(max(beyond_left.max(initial=0.0), beyond_right.max(initial=0.0)))


def _telling_share(values: Vector) -> float:
    """The share of a signal's samples [n, c] that tell of its offset: all of noise, but of one turn only the turn.

    (sum of e)^2 over n times the sum of e^2, e the squares of the samples; 1/3 for noise of one column.
    """
    squares = np.square(np.nan_to_num(values - np.nanmean(values, axis=0))).sum(axis=1)
    fourth = float(np.square(squares).sum()) * np.count_nonzero(np.isfinite(values).all(axis=1))
    return min(3 * float(squares.sum()) ** 2 / fourth, 1.0) if fourth else 1.0


def _memory_s(values: Vector) -> float:
    """How long a signal [n, c] on the grid stays like itself: until its autocorrelation is half."""
    known = np.nan_to_num(values - np.nanmean(values, axis=0))
    size = float((known**2).sum())
    for lag in range(1, len(known)):
        if float((known[lag:] * known[:-lag]).sum()) < size / 2:
            return lag * STEP_S
    return len(known) * STEP_S


def _unknown(witness: Witness, reason: str) -> ClockOffset:
    return ClockOffset(None, None, 0.0, None, witness, reason)
