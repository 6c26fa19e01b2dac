"""A sink that writes what `flightdepth run` writes; results that come while the disk is busy are missed."""

from __future__ import annotations

import math
import shutil
import time
from collections import Counter
from contextlib import ExitStack
from pathlib import Path
from threading import Lock

from flightdepth.errors import BadInput, FlightDepthError
from flightdepth.flight.records import AttitudeSample, Frame, VelocitySample
from flightdepth.flight.universal_time import UniversalTime
from flightdepth.live.picture_clock import AHEAD_NS
from flightdepth.live.status import LiveResult
from flightdepth.outputs.poses import FramePose, PoseTrack
from flightdepth.outputs.preview import Preview
from flightdepth.outputs.record import Source
from flightdepth.outputs.writer import FlightWriter, check_target
from flightdepth.weights.card import NetworkCard

LEAST_FREE_BYTES = 500 * 10**6  # to finish a recording before nothing fits any more
OTHER_SIZE = "of another size than the first"
MISTIMED = "from the future, or not later than the one before in the recording"
NO_ROOM = "all that came when the disk was nearly full"


class Recorder:
    """Writes results into `target`, which appears when `close` has finished it. Times begin with the first."""

    def __init__(
        self,
        target: Path,
        network: NetworkCard,
        telemetry: str,
        settings: dict[str, bool | int | float | str | None],
        camera_source: str = "",
        *,
        mask_digest: str | None = None,
        dated: bool = True,
    ) -> None:
        """Where the velocity and the camera come from, the mask's digest, and `settings`, are as they shall stand in
        flight.json. `dated` is False where pictures are not of now: of a file that is played.
        """
        check_target(target)  # now, not after the flight
        self._target, self._network, self._telemetry, self._settings = target, network, telemetry, settings
        self._camera_source, self._mask_digest, self._dated = camera_source, mask_digest, dated
        self._name = f"recording {target}"  # in what is said of it
        self._stack = ExitStack()
        self._writer: FlightWriter | None = None
        self._size = (0, 0)
        self._first_ns, self._last_ns = 0, -math.inf
        self._told_ns: int | None = None  # the last velocity that the track was given
        self._count = self._lost = 0
        self._left_out: Counter[str] = Counter()
        self._warnings: tuple[str, ...] = ()
        self._over = False
        self._lock = Lock()  # `close` may come while a slow disk still takes a result

    def __call__(self, result: LiveResult) -> None:
        """Write one result; none after the end. On a disk that is nearly full the folder is finished."""
        with self._lock:
            if not self._over:
                self._write(result)

    def _write(self, result: LiveResult) -> None:
        size = (result.camera.width, result.camera.height)
        if self._writer is not None and size != self._size:
            self._left_out[OTHER_SIZE] += 1
            began, other = ("x".join(map(str, each)) for each in (self._size, size))
            raise BadInput(self._name, expected=f"pictures of {began}, as it began", got=f"{other}: left out")
        index = self._count
        self._count += 1  # whatever comes of it: no two frames share an index
        # Times step back after one that was wrong, or when the sender's clock becomes known; a recording's rise. None
        # in it is from the future, so pictures are left out for no longer than they are old.
        if not self._last_ns < result.stamp_ns <= result.ready_ns + AHEAD_NS:
            self._left_out[MISTIMED] += 1
            return
        writer = self._writer or self._begin(result)
        self._last_ns = result.stamp_ns
        free = shutil.disk_usage(self._target.parent).free
        if free < LEAST_FREE_BYTES:
            self._finish({NO_ROOM: 1})
            expected = f"{LEAST_FREE_BYTES // 10**6} MB free on its disk"
            raise BadInput(self._name, expected=expected, got=f"{free // 10**6} MB: it ends here")
        own = None if result.camera == self._camera else result.camera  # where the lens zooms
        frame = Frame(index, result.stamp_ns - self._first_ns, result.image, camera=own)
        writer.add(frame, result.depth, self._pose(frame, result))
        if writer.lost > self._lost:  # earlier frames: their files are written meanwhile
            self._lost = writer.lost
            raise FlightDepthError(f"{self._name}: a frame is left out: {writer.loss}")

    def _pose(self, frame: Frame, result: LiveResult) -> FramePose | None:
        """Where the camera was, summed from result to result; None where telemetry tells not enough."""
        motion = result.motion
        velocity_ned, world_from_camera = motion.velocity_ned, motion.world_from_camera
        if velocity_ned is None or world_from_camera is None:
            return None
        if motion.velocity_told_ns != self._told_ns:  # else it is held: given again, it would shorten a gap
            self._told_ns = motion.velocity_told_ns
            self._track.add(VelocitySample(frame.stamp_ns, velocity_ned))
        self._track.add(AttitudeSample(frame.stamp_ns, world_from_camera))
        return self._track.at(frame, result.depth)

    @property
    def begun(self) -> bool:
        """Whether a result came, and with it a folder."""
        return self._writer is not None

    def close(self, dropped: dict[str, int]) -> tuple[str, ...]:
        """Finish the folder; what the user should know of it. `dropped`: pictures missing from it, by reason."""
        with self._lock:
            if not self._over:
                self._finish(dropped)
            return self._warnings

    def _finish(self, dropped: dict[str, int]) -> None:
        self._over = True
        if self._writer is not None:
            self._writer.note_dropped(dropped | self._left_out)
        try:
            self._stack.close()
        except FlightDepthError as error:
            self._warnings = (f"{self._name}: {error}",)
            raise
        if self._writer is not None:
            self._warnings = tuple(f"{self._name}: {line}" for line in self._writer.summary.warnings)

    def _begin(self, result: LiveResult) -> FlightWriter:
        ago_ns = time.monotonic_ns() - result.stamp_ns
        utc = UniversalTime.of(time.time_ns() - ago_ns, "computer") if self._dated else None
        self._track = PoseTrack(utc=utc)
        source = Source(
            flight=str(self._settings["video"]),
            telemetry=self._telemetry,
            camera=result.camera,
            camera_source=self._camera_source,
            mask_digest=self._mask_digest,
            utc=utc,
            network=self._network,
            settings=self._settings,
        )
        self._camera, self._first_ns = result.camera, result.stamp_ns
        self._size = (result.camera.width, result.camera.height)
        writer = FlightWriter(self._target, source, Preview(*self._size), once=True)
        self._writer = self._stack.enter_context(writer)
        return self._writer
