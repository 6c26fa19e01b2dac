"""Whether a log's velocities sum to a way as long as that between its own positions: depth is to scale with theirs.

A way is a plane of complex numbers, east + i north, metres [n].
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flightdepth.flight.positions import local_ned
from flightdepth.flight.records import LATEST_NS, MAX_GAP_S, NS_PER_S, Telemetry
from flightdepth.flight.untold import shown_until_ns
from flightdepth.flight.video import Video

Plane = NDArray[np.complex128]
ROUNDS = 30
NEAREST_M = 0.01  # distances below weigh alike
WANDER_M = 0.5  # on the mean, from a way so placed: a receiver's error wanders by more than its scatter tells
LONGER_TOLD = 0.02  # of a way's length: by less, receivers and velocities differ as a rule


def lengths_apart(video: Video, log: Telemetry) -> tuple[str, ...]:
    """A line where a log's velocities sum to another length than its positions do, in the part that is shown."""
    flown, told = both_ways(log, video.start_ns, shown_until_ns(video) or LATEST_NS)
    return said_longer(longer(flown, told)) if len(told) else ()


def both_ways(log: Telemetry, start_ns: int, end_ns: int) -> tuple[Plane, Plane]:
    """The way by a log's velocities, and by its positions, at its fixes [n] of a time.

    Of those between two gaps in the velocities, the most; none where positions or the world's directions are not told.
    """
    velocities, nowhere = log.velocities, np.zeros(0, dtype=np.complex128)
    if log.places is None or log.any_direction or velocities[0].frame == "camera":
        return nowhere, nowhere
    stamps_ns = np.array([each.stamp_ns for each in velocities])
    fixes_ns = log.places.stamps_ns
    shown = (fixes_ns >= start_ns) & (fixes_ns <= end_ns)
    parts = np.split(stamps_ns, np.flatnonzero(np.diff(stamps_ns) > MAX_GAP_S * NS_PER_S) + 1)
    within = (shown & (fixes_ns >= part[0]) & (fixes_ns <= part[-1]) for part in parts)
    kept = max(within, key=np.count_nonzero)
    if not kept.any():
        return nowhere, nowhere
    fixes_ns, told_ned = fixes_ns[kept], local_ned(log.places.places[kept, :2], np.zeros(kept.sum()))
    at_ns = np.union1d(stamps_ns, fixes_ns)  # between two velocities they run straight
    speeds = np.interp(at_ns, stamps_ns, [each.velocity[1] + 1j * each.velocity[0] for each in velocities])
    steps = np.diff(at_ns) / NS_PER_S * (speeds[1:] + speeds[:-1]) / 2
    flown = np.concatenate([[0], np.cumsum(steps)])[np.searchsorted(at_ns, fixes_ns)]
    return flown, told_ned[:, 1] + 1j * told_ned[:, 0]


def longer(flown: Plane, told: Plane) -> float:
    """By what share `flown` is longer than `told`; 0 where the error of `told` may hide that, or all of it.

    That error is twice its scatter, and at least WANDER_M.
    """
    turn, shift = fitted(flown, told, turns=True, stretches=True)
    scatter_m = np.median(np.abs(turn * flown + shift - told))
    spread_m = np.abs(flown - flown.mean()).mean()
    least_m = min(abs(turn), abs(1 - abs(turn))) * spread_m
    return 1 / abs(turn) - 1 if least_m > max(2 * scatter_m, WANDER_M) else 0.0


def said_longer(share: float) -> tuple[str, ...]:
    """What `longer` means for depth, a line; none where it is little."""
    if abs(share) < LONGER_TOLD:
        return ()
    more, far = ("longer", "far") if share > 0 else ("shorter", "near")
    return (
        f"the way by the log's velocities is {100 * abs(share):.1f} % {more} than the log's positions tell:"
        f" where these are right, depth is so much too {far}",
    )


def fitted(flown: Plane, told: Plane, *, turns: bool, stretches: bool = False) -> tuple[complex, complex]:
    """Turn (of length 1 unless it `stretches`) and shift that bring `flown` to `told`; 1 where it `turns` not.

    Least squares, weighed anew by the inverse of each distance (Weiszfeld): the least sum of distances.
    """
    turn, shift, weights = 1 + 0j, 0j, np.ones(len(flown))
    for _ in range(ROUNDS):
        from_, to = np.average(flown, weights=weights), np.average(told, weights=weights)
        arrow = np.sum(weights * (told - to) * (flown - from_).conj()) if turns else 0j
        length = np.sum(weights * np.abs(flown - from_) ** 2) if stretches else abs(arrow)
        turn = arrow / length if arrow else 1 + 0j
        shift = to - turn * from_
        weights = 1 / np.maximum(np.abs(turn * flown + shift - told), NEAREST_M)
    return complex(turn), complex(shift)
