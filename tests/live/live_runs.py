"""A live engine as the tests run it: on a thread, patient, its results kept."""

from __future__ import annotations

import threading
import time
from contextlib import contextmanager

from live_peers import FOV_DEG, until

from flightdepth.live.autopilot_feed import AutopilotFeed, AutopilotListener
from flightdepth.live.depth_stage import DepthStage, Lens
from flightdepth.live.engine import LiveEngine, Parts
from flightdepth.live.health import Limits
from flightdepth.live.lens_watch import LensWatch
from flightdepth.live.log_player import LogPlayer
from flightdepth.live.mavlink_link import MavlinkLink
from flightdepth.live.motion_store import MotionStore
from flightdepth.live.video_address import video_address
from flightdepth.live.video_input import VideoInput
from flightdepth.motion import NED_FROM_CAMERA

# Tests share their machine, which may stand still for tenths of a second. What the usual limits do is tested with
# times that are passed in (test_health.py).
PATIENT = Limits(late_ns=2 * 10**9, no_depth_ns=2 * 10**9, old_ms=5000, slow_hz=0.2)


class Run:
    """A running engine: its results, the newest last, and what it said."""

    def __init__(
        self, network, video, *, port=None, telemetry=None, camera=None, ranges=2, sender_clock=False
    ):
        self.results, self.said, self.store = [], [], MotionStore(NED_FROM_CAMERA)
        lens = Lens(hfov_deg=FOV_DEG) if camera is None else Lens(camera)
        self.feed = None
        epoch_ns = self.epoch_ns = time.monotonic_ns() + 1_000_000_000

        def motion(engine):
            if telemetry is not None:
                return LogPlayer(telemetry, self.store, epoch_ns=epoch_ns, on_velocity=engine.on_velocity)
            self.feed = AutopilotFeed(self.store, AutopilotListener(engine.on_velocity, engine.on_reboot))
            address = f"udpin:127.0.0.1:{port}"
            return MavlinkLink(address, self.feed, rate_hz=self.store.rate_hz, on_error=engine.on_link_error)

        self.engine = LiveEngine(
            Parts(
                stage=DepthStage(network, lens, self.store, ranges=ranges, fixed=True),
                store=self.store,
                video=lambda listener: VideoInput(
                    video_address(video), listener, sender_clock=sender_clock, epoch_ns=epoch_ns
                ),
                motion=motion,
                boot_ns=lambda live_ns: self.feed and self.feed.boot_ns(live_ns),
                lens=LensWatch(self.store),
            ),
            say=self.said.append,
        )
        self.engine._monitor._limits = PATIENT
        self.engine.add_sink("test", self.results.append)

    @property
    def health(self):
        return self.engine.status().health

    def until(self, state, reason="", within_s=20.0):
        """Seconds until the health is so."""

        def told():
            health = self.health
            return health.state is state and (health.reason or "").startswith(reason)

        try:
            return until(told, within_s)
        except AssertionError as error:
            raise AssertionError(f"{state} {reason}: it is {self.health}, said {self.said[-3:]}") from error


@contextmanager
def running(*arguments, **keywords):
    run, stop = Run(*arguments, **keywords), threading.Event()
    thread = threading.Thread(target=run.engine.run, args=(stop,))
    with run.engine:
        thread.start()
        try:
            yield run
        finally:
            stop.set()
            thread.join()
