"""The engine's loop and its state with parts made by hand: nothing is opened, no network runs."""

from __future__ import annotations

import threading
from collections import Counter
from types import SimpleNamespace

import numpy as np

from flightdepth.camera import Camera
from flightdepth.live.depth_stage import Staged
from flightdepth.live.engine import LiveEngine, Parts
from flightdepth.live.meters import Rate
from flightdepth.live.motion_store import MotionStore
from flightdepth.live.slots import Newest
from flightdepth.ranges.result import RangedDepth

CAMERA = Camera.from_fov(6, 4, 90)
IMAGE = np.zeros((4, 6, 3), np.uint8)
PICTURE = SimpleNamespace(stamp_ns=1_000, age_from="sender", rgb=lambda: IMAGE)


class Stage:
    """Says of every picture that it has no depth."""

    ranges = 1

    def __init__(self, counts: Counter[str]) -> None:
        self.counts = counts

    def take(self, stamp_ns, image):
        depth = RangedDepth.unknown(CAMERA.height, CAMERA.width, "hovering", 1.0)
        return Staged(depth, image, CAMERA, changed=True)


class Video:
    """One picture, and the end."""

    def __init__(self) -> None:
        self.slot, self.ended, self.error = Newest(), threading.Event(), None
        self.received, self.reconnects, self.dropped = 1, 0, {}
        self.slot.put(PICTURE)
        self.ended.set()


def engine(counts: Counter[str] | None = None) -> LiveEngine:
    stage = Stage(Counter() if counts is None else counts)
    parts = Parts(stage, MotionStore(), video=lambda listener: Video(), motion=lambda engine: None)
    return LiveEngine(parts)


def test_a_picture_becomes_a_result():
    run = engine()
    run.run(threading.Event())
    status = run.status()
    assert (status.frames.received, status.frames.used) == (1, 1)
    assert status.age_from == "sender"


def test_rates_are_read_under_the_lock_alone():
    """Reading forgets old events: two threads at once could each take the last."""

    class Guarded(Rate):
        def hz(self, now_ns):
            assert run._lock.locked()
            return super().hz(now_ns)

    run = engine()
    run._pictures, run._results = Guarded(), Guarded()
    run.run(threading.Event())
    run.status()


def test_the_state_can_be_asked_while_a_picture_is_dropped_for_a_new_reason():
    class Growing(Counter):
        """As the estimator's thread makes it grow while another sums it up."""

        def items(self):
            for item in super().items():
                self["the same picture again"] += 1
                yield item

    dropped = engine(Growing({"not later than the one before": 2})).status().frames.dropped
    assert dropped["not later than the one before"] == 2
