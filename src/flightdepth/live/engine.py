"""The live engine: a stream and telemetry in, results to the sinks, the newest picture first.

Threads: one reads and decodes the stream, one reads MAVLink, one runs each sink; the caller's runs the
estimator (`run`). Between them stand slots of one item, so nothing queues and the age of a result cannot grow.
"""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol

from flightdepth.camera import Camera
from flightdepth.errors import BadInput, FlightDepthError
from flightdepth.live.depth_stage import DepthStage, NoCalibration, Staged
from flightdepth.live.health import HealthMonitor
from flightdepth.live.lens_watch import LensWatch
from flightdepth.live.meters import Ages, Rate
from flightdepth.live.motion_store import MotionStore
from flightdepth.live.range_control import RangeControl
from flightdepth.live.slots import SinkThread
from flightdepth.live.status import AgeFrom, FrameCounts, LiveResult, LiveStatus, Sink
from flightdepth.live.video_input import VideoInput, VideoListener
from flightdepth.live.video_stream import Picture

TAKE_S = 0.1  # between two looks at whether to stop
NOMINAL_HZ = 30.0  # until the stream's own rate is known


class MotionSource(Protocol):
    """A MAVLink link, or a log that is played."""

    def start(self) -> None:
        """Begin to feed the store."""
        ...

    def close(self) -> None:
        """Stop."""
        ...


@dataclass(frozen=True, eq=False)
class Parts:
    """What an engine is made of; `video` and `motion` are made with the engine's listeners.

    boot_ns            a time of the live clock on the autopilot's
    telemetry_dropped  what telemetry left out, by reason
    untold             what telemetry tells in place of velocities
    lacking            what a sink can't do, and for want of what
    lens               watches whether the camera's turns deny its lens; None where they need not tell it
    """

    stage: DepthStage
    store: MotionStore
    video: Callable[[VideoListener], VideoInput]
    motion: Callable[[LiveEngine], MotionSource]
    boot_ns: Callable[[int], int | None] = lambda live_ns: None
    telemetry_dropped: Callable[[], dict[str, int]] = dict
    untold: Callable[[], str | None] = lambda: None
    lacking: Callable[[], str | None] = lambda: None
    lens: LensWatch | None = None


class LiveEngine:
    """Runs from `__enter__` to `__exit__`; `run` is the estimator's loop. `status` may be asked by any thread."""

    def __init__(self, parts: Parts, *, say: Callable[[str], None] = lambda text: None) -> None:
        self._stage, self._store, self._parts, self._tell = parts.stage, parts.store, parts, say
        self._lock = threading.Lock()
        self._start_ns = time.monotonic_ns()
        self._monitor = HealthMonitor(self._start_ns, faster=parts.stage.faster)
        self._control = RangeControl(parts.stage.ranges)
        self._pictures, self._taken, self._results, self._ages = Rate(), Rate(), Rate(), Ages()
        self._used = 0
        self._size: tuple[int, int] | None = None  # of the last picture used
        self._refused: Counter[str] = Counter()
        self._age_from: AgeFrom = "reception"
        self._shifts: tuple[int, ...] = ()
        self._displacements_m: tuple[float, ...] = ()
        self._sinks: list[SinkThread] = []
        self._video = parts.video(
            VideoListener(self._on_picture, self._on_stream_error, self._on_distrusted, self._on_cut)
        )
        self._motion = parts.motion(self)

    def __enter__(self) -> LiveEngine:
        if self._parts.lens is not None:
            self.add_sink("lens watch", self._parts.lens.take)
        self._motion.start()
        self._video.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._video.close()
        for sink in self._sinks:
            sink.close()
        self._motion.close()

    def add_sink(self, name: str, sink: Sink) -> None:
        """Give every result, or the newest where it is slow, to `sink`, on a thread of its own."""
        self._sinks.append(SinkThread(name, sink, self._on_sink_failure))

    def run(self, stop: threading.Event, duration_s: float | None = None) -> None:
        """Turn pictures into results until `stop`, the end of a file, or `duration_s`."""
        end_ns = None if duration_s is None else time.monotonic_ns() + round(duration_s * 1e9)
        while not stop.is_set() and (end_ns is None or time.monotonic_ns() < end_ns):
            picture = self._video.slot.take(TAKE_S)
            if picture is not None:
                self._work(picture)
            elif self._video.ended.is_set():
                break
        if self._video.error is not None:
            raise self._video.error

    def status(self) -> LiveStatus:
        """How things stand now."""
        now_ns = time.monotonic_ns()
        lens = None if self._parts.lens is None else self._parts.lens.verdict
        with self._lock:
            monitor = self._monitor
            monitor.pictures_hz, monitor.taken_hz = self._pictures.hz(now_ns), self._taken.hz(now_ns)
            monitor.instead, monitor.lacking = self._video.instead, self._parts.lacking()
            monitor.untold = self._parts.untold()
            monitor.lens_doubt = None if lens is None else lens.doubt
            self._ages.forget(now_ns)
            return LiveStatus(
                stamp_ns=now_ns,
                health=monitor.judge(now_ns),
                age_ms=self._ages.last_ms,
                age_from=self._age_from,
                distrusted=self._video.distrusted,
                age_p95_ms=self._ages.p95_ms,
                frames=FrameCounts(self._video.received, self._used, self._dropped()),
                ranges=self._stage.ranges,
                shifts=self._shifts,
                displacements_m=self._displacements_m,
                fps_in=monitor.pictures_hz,
                fps=self._results.hz(now_ns),
                telemetry_hz=self._store.rate_hz(now_ns),
                telemetry_age_ms=self._store.age_ms(now_ns),
                uptime_s=(now_ns - self._start_ns) / 1e9,
                reconnects=self._video.reconnects,
                sinks={sink.name: sink.counts for sink in self._sinks},
                telemetry_dropped=self._parts.telemetry_dropped(),
                lens=lens,
            )

    def _say(self, text: str) -> None:
        """Nobody may listen, as when the terminal is gone or a log's disk is full: no reason to stop."""
        with suppress(OSError, SystemExit):
            self._tell(text)

    def on_velocity(self, now_ns: int) -> None:
        """A velocity came; called on the telemetry's thread."""
        with self._lock:
            self._monitor.velocity(now_ns)

    def on_link_error(self, why: str) -> None:
        """The telemetry's connection broke, or cannot be opened; called on the telemetry's thread."""
        with self._lock:
            news = self._monitor.link_failed(why)
        if news:
            self._say(f"{why}; opening it again")

    def on_reboot(self, now_ns: int) -> None:
        """The autopilot rebooted; called on the telemetry's thread."""
        with self._lock:
            self._monitor.rebooted(now_ns)
        self._say("the autopilot rebooted: its clock began again")

    def _on_picture(self, now_ns: int) -> None:
        with self._lock:
            self._pictures.add(now_ns)
            self._monitor.picture(now_ns)

    def _on_stream_error(self, why: str) -> None:
        with self._lock:
            news = self._monitor.stream_failed(why)
        if news:
            self._say(f"video: {why}; opening it again")

    def _on_distrusted(self, why: str) -> None:
        self._say(f"video: ages count from reception, not by the sender's clock: {why}")

    def _on_cut(self, why: str) -> None:
        self._say(f"video: it cannot be read on, the rest of it is lost: {why}")

    def _on_sink_failure(self, name: str, error: Exception) -> None:
        kind = "" if isinstance(error, FlightDepthError) else f"{type(error).__name__}: "
        self._say(f"{name} failed, the estimator goes on: {kind}{error}")

    def _work(self, picture: Picture) -> None:
        """One picture from the slot to the sinks."""
        began_ns = time.monotonic_ns()
        with self._lock:
            self._taken.add(began_ns)
        try:
            image = picture.rgb()
            height, width, _ = image.shape
            with self._lock:
                self._monitor.preparing = not self._stage.is_prepared(width, height)
            staged = self._stage.take(picture.stamp_ns, image)
        except NoCalibration as error:  # the stream's size changed
            self._refuse("size without a calibration", str(error))
            return
        except BadInput as error:  # counted by what is wrong, without its figures
            self._refuse(f"refused: {str(error).split(':', maxsplit=1)[0]}", str(error))
            return
        finally:
            with self._lock:
                self._monitor.preparing = False
        if staged is None:
            return
        self._look_at_size(staged.camera)
        ready_ns = time.monotonic_ns()
        self._note(staged, picture, ready_ns)
        self._publish(staged, picture, ready_ns)
        # Neither tells what one with depth takes: seconds that no other of its size does, or next to nothing.
        if staged.compiled or staged.depth.reason is not None:
            return
        busy_ms = (time.monotonic_ns() - began_ns) / 1e6
        with self._lock:
            pictures_hz = self._pictures.hz(ready_ns) or NOMINAL_HZ
        self._stage.ranges = self._control.add(ready_ns, busy_ms, 1000 / pictures_hz)

    def _look_at_size(self, camera: Camera) -> None:
        """Say what is taken for the lens of pictures of another size: nobody knows whether they were cropped."""
        size = camera.width, camera.height
        if self._size not in (None, size):
            self._say(
                f"video: the pictures are {size[0]}x{size[1]} now; their focal length is taken to be {camera.fx:.0f} px"
            )
        self._size = size

    def _note(self, staged: Staged, picture: Picture, ready_ns: int) -> None:
        # No other picture waits for the network.
        age_ms = 0.0 if staged.compiled else (ready_ns - picture.stamp_ns) / 1e6
        with self._lock:
            self._used += 1
            # Figures, and not the result itself: its last holder frees megabytes, which takes milliseconds.
            self._age_from, depth = picture.age_from, staged.depth
            self._shifts = tuple(depth.shifts.tolist())
            self._displacements_m = tuple(depth.displacements_m.tolist())
            self._results.add(ready_ns)
            if not staged.compiled:
                self._ages.add(ready_ns, age_ms)
            self._monitor.result(ready_ns, no_depth=depth.reason, age_ms=age_ms, doubt=depth.doubt)

    def _publish(self, staged: Staged, picture: Picture, ready_ns: int) -> None:
        result = LiveResult(
            depth=staged.depth,
            image=staged.image,
            camera=staged.camera,
            stamp_ns=picture.stamp_ns,
            ready_ns=ready_ns,
            boot_ns=self._parts.boot_ns(picture.stamp_ns),
            motion=self._store.at(picture.stamp_ns),
            status=self.status(),
        )
        for sink in self._sinks:
            sink.put(result)

    def _refuse(self, reason: str, why: str) -> None:
        with self._lock:
            first = reason not in self._refused
            self._refused[reason] += 1
            self._monitor.refused(why)
        if first:
            self._say(why)

    def _dropped(self) -> dict[str, int]:
        # The stage counts on the thread of `run`: copied in one step, since a sum of it would see it grow.
        return dict(Counter(self._video.dropped) + Counter(self._stage.counts) + self._refused)
