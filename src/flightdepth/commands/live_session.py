"""What `flightdepth live` puts together: the engine, its sources and sinks; and what it says meanwhile."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack

from flightdepth.camera import Camera
from flightdepth.commands.live_report import missing, summary, told
from flightdepth.commands.live_settings import LiveSettings
from flightdepth.commands.live_sources import doubt_of_obstacles, recorded, refuse_idle
from flightdepth.commands.network_options import precision_of
from flightdepth.commands.signals import stop_request
from flightdepth.commands.terminal import mention, say, warn
from flightdepth.errors import FlightDepthError
from flightdepth.flight.camera_evidence import ChosenCamera
from flightdepth.flight.gimbal import looking
from flightdepth.flight.mask import PictureMask
from flightdepth.live.autopilot_feed import AutopilotFeed, AutopilotListener
from flightdepth.live.depth_stage import DepthStage, Lens
from flightdepth.live.engine import LiveEngine, MotionSource, Parts
from flightdepth.live.lens_watch import LensWatch
from flightdepth.live.log_player import LogPlayer
from flightdepth.live.mavlink_link import MavlinkLink
from flightdepth.live.motion_store import MotionStore
from flightdepth.live.obstacle_memory import ObstacleMap
from flightdepth.live.obstacle_messages import ObstaclePacker, in_tlog
from flightdepth.live.obstacle_sender import ObstacleFeed, ObstacleSender, Write
from flightdepth.live.obstacles import Sight
from flightdepth.live.page import Page, PageServer
from flightdepth.live.recorder import Recorder
from flightdepth.live.still_watch import StillWatch
from flightdepth.live.video_address import video_address
from flightdepth.live.video_input import VideoInput, VideoListener
from flightdepth.outputs.interrupted import keep_interrupted
from flightdepth.runtimes.network import Network, load_network, nearest_network

# A file and a log begin so long after the start, so that both are open by then.
LEAD_NS = 300_000_000
ELSEWHERE = ", from elsewhere under this machine's name; whoever reaches it can look"
NOMINAL_SIZE = (640, 360)  # stands for the pictures before the first has come


class Session:
    """One run of `flightdepth live`."""

    def __init__(self, settings: LiveSettings) -> None:
        self.settings = settings
        self.address = video_address(settings.video)
        self.mask = None if settings.mask is None else PictureMask.read(settings.mask)
        self.log, chosen = recorded(settings, self.address, self.mask)
        if chosen is None:
            self.lens = Lens.given(settings.camera, settings.hfov)
        else:
            self.lens = Lens(chosen.camera, source=chosen.source)
        nominal = self.lens.nominal(*NOMINAL_SIZE)
        self.network: Network = load_network(
            settings.network or nearest_network(nominal),
            precision=precision_of(settings.precision),
            aligned=settings.align,
        )
        refuse_idle(settings, self.address, self.network.card)
        self.telemetry_name = str(settings.mavlink if self.log is None else self.log.name)
        say(f"{self.address.name} -> {self.network.card.name}; {self.telemetry_name}")
        say(f"camera: {self.lens.source}")
        if self.mask is not None:
            say(f"mask: {self.mask}")
        for warning in () if chosen is None else chosen.warnings:
            warn(warning)
        if settings.seeks_obstacles and (doubt := doubt_of_obstacles(self.network.card)):
            warn(doubt)
        fixed = settings.mount == "fixed"
        self.store = MotionStore(looking(settings.mount_pitch or 0.0) if fixed else None)
        # Obstacles join two results in a row, so with one range these look near and far in turn.
        turns = 2 if settings.seeks_obstacles else 1
        self.stage = DepthStage(
            self.network,
            self.lens,
            self.store,
            ranges=settings.ranges,
            fixed=fixed,
            turns=turns,
            zoom=self._zoomed(chosen) if chosen is not None and chosen.views is not None else None,
            mask=self.mask,
        )
        if chosen is not None:  # a file must not run on while the network is prepared
            self.stage.prepare(chosen.camera.width, chosen.camera.height)
        self.epoch_ns = time.monotonic_ns() + LEAD_NS
        self.feed: AutopilotFeed | None = None
        self.link: MavlinkLink | None = None
        self.sender: ObstacleSender | None = None
        self.obstacles: ObstacleFeed | None = None
        self.still = StillWatch(self.mask)
        self.engine = LiveEngine(
            Parts(
                stage=self.stage,
                store=self.store,
                video=self._video,
                motion=self._motion,
                boot_ns=lambda live_ns: None if self.feed is None else self.feed.boot_ns(live_ns),
                telemetry_dropped=self._telemetry_dropped,
                untold=lambda: None if self.link is None else self.link.instead(),
                lacking=self._lacking,
                lens=LensWatch(self.store, mask=self.mask) if chosen is None or chosen.turns_tell else None,
            ),
            say=warn,
        )

    def _zoomed(self, chosen: ChosenCamera) -> Callable[[int], Camera]:
        """The camera at a time of the live clock."""
        return lambda stamp_ns: chosen.at(stamp_ns - self.epoch_ns)

    def run(self) -> None:
        """Until Ctrl-C, SIGTERM, the end of a file, or --duration."""
        settings, engine = self.settings, self.engine
        with stop_request() as stop, ExitStack() as stack:
            self._add_sinks(stack)
            stack.enter_context(engine)
            if self.sender is not None:  # within the engine's time: its link is open for as long
                stack.enter_context(self.sender)
            stack.enter_context(told(engine))
            engine.run(stop, settings.duration)
        status = engine.status()
        say(summary(status))
        if self.sender is not None:
            say(f"  obstacles: {self.sender.sent} messages sent")
        if not (stop.is_set() or status.frames.received):  # nobody stopped it
            raise FlightDepthError(f"video {self.address.name}: no picture came")

    def _video(self, listener: VideoListener) -> VideoInput:
        return VideoInput(
            self.address,
            listener,
            delay_ns=round(self.settings.camera_delay_ms * 1e6),
            sender_clock=self.settings.sender_clock,
            epoch_ns=self.epoch_ns,
        )

    def _motion(self, engine: LiveEngine) -> MotionSource:
        settings = self.settings
        if settings.mavlink is not None:
            listener = AutopilotListener(engine.on_velocity, engine.on_reboot)
            self.feed = AutopilotFeed(self.store, listener, system=settings.vehicle)
            self.link = MavlinkLink(
                settings.mavlink, self.feed, rate_hz=self.store.rate_hz, on_error=engine.on_link_error
            )
            return self.link
        assert self.log is not None
        return LogPlayer(self.log, self.store, epoch_ns=self.epoch_ns, on_velocity=engine.on_velocity)

    def _add_sinks(self, stack: ExitStack) -> None:
        settings, obstacles = self.settings, self._add_obstacles()
        if settings.serve is not None:
            page = Page(self.engine.status, obstacles)
            server = stack.enter_context(PageServer(page, settings.serve))
            self.engine.add_sink("page", page.take)
            say(f"page: {server.address}" + (ELSEWHERE if server.everywhere else ""))
        if settings.out is not None:
            facts = settings.for_record | {"video": self.address.name}
            digest = None if self.mask is None else self.mask.digest
            recorder = Recorder(
                settings.out,
                self.network.card,
                self.telemetry_name,
                facts,
                self.lens.source,
                mask_digest=digest,
                dated=not self.address.paced,
            )
            for place in keep_interrupted(settings.out):
                warn(f"an earlier recording was interrupted: what was written of it stands in {place}")
            stack.callback(self._end_recording, recorder)
            self.engine.add_sink("recorder", recorder)
        self.engine.add_sink("still parts", self.still.take)
        is_sent = settings.mavlink is not None or settings.dry_run is not None  # else for the page alone
        if obstacles is not None and is_sent:  # the last: it empties an older log
            self.sender = ObstacleSender(obstacles, self._obstacle_writer(stack), heard=self._is_heard)

    def _end_recording(self, recorder: Recorder) -> None:
        for warning in recorder.close(missing(self.engine.status())):
            warn(warning)
        if recorder.begun:
            mention(f"recording: {self.settings.out}")

    def _add_obstacles(self) -> ObstacleFeed | None:
        settings = self.settings
        if not settings.seeks_obstacles:
            return None
        obstacles = ObstacleMap(self._sight)
        packer = ObstaclePacker(obstacles.settings, system=self._vehicle)
        fixed = settings.mount == "fixed"
        feed = self.obstacles = ObstacleFeed(obstacles, packer, motion_at=self.store.at, camera_ahead=fixed)
        self.engine.add_sink("obstacles", feed.take)
        return feed

    def _lacking(self) -> str | None:
        """Why obstacles are unknown, or what makes some of the depth wrong."""
        return (None if self.obstacles is None else self.obstacles.lacking) or self.still.doubt

    def _sight(self, camera: Camera) -> Sight:
        return Sight.of(self.network.card, self.network.focal_px(camera))

    def _telemetry_dropped(self) -> dict[str, int]:
        """What did not come in, was of no use, or did not go out."""
        dropped = self.stage.telemetry_dropped
        if self.feed is not None and self.link is not None:
            dropped += Counter(self.feed.counts) + Counter(self.link.counts)
        if self.sender is not None and self.sender.failed:
            dropped["obstacle messages that could not be made or written"] = self.sender.failed
        return dict(dropped)

    def _vehicle(self) -> int | None:
        """The number of the system whose autopilot was heard."""
        return None if self.feed is None or self.feed.vehicle is None else self.feed.vehicle.system

    def _is_heard(self) -> bool:
        """Whether it is known as whose messages the obstacles go out."""
        return self.link is None or self._vehicle() is not None

    def _obstacle_writer(self, stack: ExitStack) -> Write:
        """To the autopilot, or with --dry-run to a file and nowhere else."""
        if self.settings.dry_run is not None:
            tlog = stack.enter_context(self.settings.dry_run.open("wb"))
            return lambda message: tlog.write(in_tlog(time.time_ns() // 1000, message))
        assert self.link is not None
        return self.link.write
