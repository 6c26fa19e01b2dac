"""Whether the turns of a live camera deny the focal length that was given: a sink, so on a thread of its own.

Attitudes come later than pictures, so these wait, small and grey, until it is known whether the camera turned about
their time; points are followed in those only. What turns tell is `flight.turned_focal`'s business.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from flightdepth.camera import Camera
from flightdepth.flight.mask import PictureMask
from flightdepth.flight.records import NS_PER_S
from flightdepth.flight.signals import attitude_rates
from flightdepth.flight.steadiness import Grey, follow, small_camera, small_grey
from flightdepth.flight.turn_comparison import LEAST_RATE_RAD_S
from flightdepth.flight.turn_verdict import TurnVerdict, judged_by_turns
from flightdepth.flight.turned_focal import AROUND_S, LONGEST_PAIR_S, TurnPoints
from flightdepth.live.motion_store import MotionStore
from flightdepth.live.status import LiveResult
from flightdepth.ranges.repeats import FROZEN
from flightdepth.ranges.timeline import Timeline

STEP_NS = 90_000_000  # between two pictures that are compared, at least
AROUND_NS = round(AROUND_S * NS_PER_S)
RIPE_NS = AROUND_NS + 3 * NS_PER_S // 10  # by then attitudes have come that long after a picture
MOST_WAITING = 32
MOST_ATTITUDES = 32768  # 11 minutes at 50 Hz; of turns before that nothing is known any more
APART_NS = 30 * NS_PER_S  # between two judgements
# Pairs of pictures near turns: on 120 and fewer, pictures that software stabilises denied the right lens now and then.
ENOUGH = 150
MOST_PAIRS = 400  # a judgement takes 0.2 s of a core, or 1.4 where the lens is denied
LEAST_NEW = 45  # since the last judgement


class LensWatch:
    """Give `take` every result; `verdict` may be asked by any thread.

    Judges at most each APART_NS, and only after new turns; no more once it said the same of the lens twice in a row.
    A stream that is cropped otherwise begins anew.
    """

    def __init__(self, store: MotionStore, *, mask: PictureMask | None = None) -> None:
        self.verdict: TurnVerdict | None = None
        self.settled = False
        self._store, self._mask = store, mask
        self._small: Camera | None = None
        self._new = self._next_ns = 0

    def take(self, result: LiveResult) -> None:
        """One picture, its camera and its time; a judgement takes a second or two."""
        small = small_camera(result.camera)
        if self._small is None or not _alike(self._small, small):
            self.settled, self.verdict = False, None
            self._begin(small)
        if self._waiting and result.stamp_ns < self._waiting[-1][0]:  # their times were wrong
            self._waiting.clear()
            self._next_ns = 0
        soon = len(self._waiting) > 0 and result.stamp_ns - self._waiting[-1][0] < STEP_NS
        if self.settled or soon or (result.depth.reason or "").startswith(FROZEN):
            return
        self._waiting.append((result.stamp_ns, small_grey(result.image, small)))
        self._hear()
        self._follow(result.stamp_ns - RIPE_NS)
        turned = len(self._points) >= ENOUGH and self._new >= LEAST_NEW
        if turned and result.stamp_ns >= self._next_ns:
            self._new, self._next_ns = 0, result.stamp_ns + APART_NS
            told = attitude_rates(*self._attitudes.between(0, self._attitudes.newest_ns or 0))
            self._note(judged_by_turns(self._points, told, result.camera))

    def _begin(self, small: Camera) -> None:
        """Nothing is known yet of pictures of this camera."""
        self._small, self._points = small, TurnPoints(small, most=MOST_PAIRS)
        self._shown = None if self._mask is None else self._mask.at(small.width, small.height).shown
        self._waiting: deque[tuple[int, Grey]] = deque(maxlen=MOST_WAITING)
        self._attitudes = Timeline(4, limit=MOST_ATTITUDES)
        self._new = self._next_ns = 0

    def _hear(self) -> None:
        """Take over the camera's attitudes since the last time."""
        for stamp_ns, row in zip(*self._store.cameras_after(self._attitudes.newest_ns or 0), strict=True):
            self._attitudes.add(int(stamp_ns), row)

    def _follow(self, ripe_ns: int) -> None:
        """Points of each two pictures in a row up to a time, where the camera turned about then."""
        while len(self._waiting) > 1 and self._waiting[1][0] <= ripe_ns:
            before_ns, before = self._waiting.popleft()
            after_ns, after = self._waiting[0]
            if after_ns - before_ns <= LONGEST_PAIR_S * NS_PER_S and self._turned(after_ns):
                start, end, _ = follow(before, after, self._shown)
                self._new += self._points.add(start, end, before_ns, after_ns)

    def _turned(self, stamp_ns: int) -> bool:
        """Whether the camera turned at about this time."""
        stamps, rows = self._attitudes.between(stamp_ns - AROUND_NS, stamp_ns + AROUND_NS)
        rates: NDArray[np.float64] = np.linalg.norm(attitude_rates(stamps, rows).values, axis=1)
        return bool((rates > LEAST_RATE_RAD_S).any())

    def _note(self, verdict: TurnVerdict) -> None:
        """Keep what is said last: it knows most."""
        before, self.verdict = self.verdict, verdict
        decided = before is not None and before.decided and verdict.decided
        self.settled = before is not None and decided and before.agrees == verdict.agrees
        if self.settled:
            self._begin(self._points.camera)  # what was kept is of no more use


def _alike(one: Camera, other: Camera) -> bool:
    """Whether two small cameras, of the same lens, show the same part of its view."""
    return one.height == other.height and math.isclose(one.fx, other.fx, rel_tol=1e-3)
