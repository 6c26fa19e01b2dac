"""Opening a flight: a video, its camera and its telemetry, merged in time order."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Literal

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.flight.camera_evidence import ChosenCamera, assumed_camera
from flightdepth.flight.cameras import choose_camera
from flightdepth.flight.flight_log import (
    AUTO,
    SELDOM_NS,
    choose_telemetry,
    clock_warnings,
    clocks_apart,
    forward_velocity,
    mounted,
    synchronised,
)
from flightdepth.flight.mask import PictureMask
from flightdepth.flight.offset import ClockOffset
from flightdepth.flight.own_track import disagreements
from flightdepth.flight.places import PlaceTrack
from flightdepth.flight.recordings import SEEK, SOUGHT, doubted_length
from flightdepth.flight.records import (
    MAX_GAP_S,
    NS_PER_S,
    Frame,
    GyroscopeTrack,
    Sample,
    Telemetry,
)
from flightdepth.flight.steadiness import small_camera
from flightdepth.flight.turn_verdict import doubted_by_turns
from flightdepth.flight.turned_focal import TurnWatch
from flightdepth.flight.universal_time import UniversalTime
from flightdepth.flight.untold import untold
from flightdepth.flight.video import Video
from flightdepth.flight.way_length import lengths_apart

BODY_ONLY = (
    "the log tells how the drone turned, not the camera; --mount-pitch 0 uses it for a camera that is screwed "
    "to the drone and looks ahead (-90: down)"
)
LEAD_NS = SELDOM_NS  # of samples before the first frame


class Flight:
    """Frames, velocities and attitudes of one flight in time order; iterate once, inside `with`.

    Order rule: before each frame come all samples up to its stamp, and up to the first of each kind at or after it that
    is no gap away, so that whoever integrates or interpolates knows both sides of the frame. A sample may thus be ahead
    of the next frame, by MAX_GAP_S at most. Later samples are left out, and those more than LEAD_NS before the first
    frame, which tell nothing of it.
    """

    def __init__(
        self,
        video: Video,
        chosen: ChosenCamera,
        telemetry: Telemetry | None,
        speed_m_s: float,
        *,
        clock: ClockOffset | None = None,
        begun_together: bool = False,
        log_warnings: tuple[str, ...] = (),
    ) -> None:
        self._video = video
        self._telemetry = telemetry
        self._speed_m_s = speed_m_s
        self._chosen = chosen
        self.camera = chosen.camera
        self._log_warnings = log_warnings
        self.clock = clock  # as estimated from the pictures, where that was asked for
        self.begun_together = begun_together  # only taken to have: nothing tells the offset of the log
        self.turns: TurnWatch | None = None  # to be shown the points that are followed
        if telemetry is not None and chosen.turns_tell:
            self.turns = TurnWatch(telemetry, small_camera(chosen.camera))

    def __enter__(self) -> Flight:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the video."""
        self._video.close()

    def __iter__(self) -> Iterator[Frame | Sample]:
        if self._telemetry is not None:
            return merged(self._frames(), self._telemetry.samples)
        return with_speed(self._frames(), self._speed_m_s)

    def _frames(self) -> Iterator[Frame]:
        if self._chosen.views is None:
            return self._video.frames()
        return (replace(frame, camera=self._chosen.at(frame.stamp_ns)) for frame in self._video.frames())

    @property
    def any_direction(self) -> bool:
        """Whether no log tells which way it flies, only how fast."""
        return self._telemetry is None or self._telemetry.any_direction

    @property
    def mask(self) -> PictureMask | None:
        """What was given as such, at the size of the pictures."""
        return self._video.mask

    @property
    def camera_source(self) -> str:
        """A line saying where the camera comes from, and how sure it is."""
        return self._chosen.source

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the user should know of the camera and the log, a line each."""
        log, told = self._telemetry, (*self._chosen.warnings, *self._log_warnings)
        if log is None or not log.body_attitudes or log.attitudes:
            return told
        return (*told, BODY_ONLY)

    def lens_doubt(self) -> str | None:
        """A line where the turns that `turns` was shown deny the camera; takes a second or two."""
        return None if self.turns is None else doubted_by_turns(self.turns, self.camera)

    @property
    def video_bytes(self) -> int:
        """Size of the video's file, or of all pictures of a folder."""
        return self._video.size_bytes

    @property
    def telemetry_name(self) -> str:
        """A line saying where the velocity comes from."""
        if self._telemetry is not None:
            return self._telemetry.name
        return f"constant speed of {self._speed_m_s:g} m/s, any direction"

    @property
    def telemetry_digest(self) -> str | None:
        """Tells the log from another one; None where there is none."""
        return None if self._telemetry is None else self._telemetry.digest

    @property
    def places(self) -> PlaceTrack | None:
        """Where on Earth the drone was, where the log tells it."""
        return None if self._telemetry is None else self._telemetry.places

    @property
    def utc(self) -> UniversalTime | None:
        """When the video's first picture was taken; None where neither the pictures' names nor the log tell it.

        By the log it is as sure as the offset between video and log.
        `flight.utc.at(frame.stamp_ns)` is a frame's, ns since 1970.
        """
        return self._video.utc or (None if self._telemetry is None else self._telemetry.utc)

    @property
    def true_north(self) -> bool:
        """Whether the velocities' north is the Earth's."""
        return self._telemetry is not None and self._telemetry.true_north

    @property
    def gyroscope(self) -> GyroscopeTrack | None:
        """The camera's own gyroscope, where the file holds one."""
        return None if self._telemetry is None else self._telemetry.gyroscope

    @property
    def counts(self) -> dict[str, int]:
        """What was dropped so far, and why."""
        dropped = Counter(self._video.counts)
        dropped.update({} if self._telemetry is None else self._telemetry.counts)
        return dict(dropped)

    @property
    def frame_count_hint(self) -> int | None:
        """About how many frames will come; None where the file does not say."""
        return self._video.frame_count_hint

    @property
    def duration_s(self) -> float:
        """Length of the whole video, 0 where the file does not say."""
        return self._video.duration_ns / NS_PER_S


def open_flight(
    path: str | Path,
    telemetry: str | Path | None = None,
    camera: Camera | str | Path | None = None,
    *,
    telemetry_offset_s: float | Literal["auto"] = 0.0,
    speed_m_s: float | None = None,
    hfov_deg: float | None = None,
    mount_pitch_deg: float | None = None,
    start_s: float | None = None,
    end_s: float | None = None,
    mask: str | Path | None = None,
    rate_hz: float | None = None,
) -> Flight:
    """Open a video, or a folder of pictures, with its telemetry.

    telemetry  a log file; None looks inside the video (GoPro, DJI), then for a log of the video's name beside it,
               unless `speed_m_s` is given
    telemetry_offset_s  is added to the log's times, so that they count from the video's first picture; "auto"
               estimates it from the pictures, which takes a pass over the video, and stays at 0 where they tell none
    camera     a Camera, a calibration file, a photograph with EXIF tags or a name of the table of lenses;
               None takes `hfov_deg`, the horizontal field of view, or what the file tells for certain
    mount_pitch_deg  the camera is screwed to the drone and looks up by so many degrees, -90 is down
    speed_m_s  constant speed in any direction, for flights without a log
    start_s, end_s  part of the video, seconds since its first picture
    mask       a picture, black where others show no scene: nothing there tells of the offset, nor of the lens
    rate_hz    pictures a second, of a folder of pictures whose names are no times
    """
    if telemetry is not None and speed_m_s is not None:
        raise BadInput("--telemetry and --speed", expected="one of them", got="both")
    hidden = None if mask is None else PictureMask.read(Path(mask))
    video = Video(Path(path), start_s=start_s, end_s=end_s, mask=hidden, rate_hz=rate_hz)
    try:
        log, inside = choose_telemetry(video, telemetry, speed_m_s, telemetry_offset_s)
        log = mounted(log, mount_pitch_deg)
        clock = None
        if log is not None and telemetry_offset_s == AUTO:
            # When turns go up and down shows through any lens; how far they go tells the lens at the right time only.
            given = camera is not None or hfov_deg is not None
            lens = choose_camera(video, camera, hfov_deg, log).camera if given else assumed_camera(video)
            log, clock = synchronised(video, lens, log)
        chosen = choose_camera(video, camera, hfov_deg, log)
        told = clock_warnings(clock, inside=inside)
        if log is not None:
            told += untold(video, log) + lengths_apart(video, log) + clocks_apart(log, video.utc)
        if log is not None and telemetry is not None:
            told += disagreements(log, video)
        untold_offset = not telemetry_offset_s if clock is None else clock.offset_s is None
        if log is not None and untold_offset:
            told += doubted_length(log, video.duration_ns, mend=SEEK if clock is None else SOUGHT)
        together = log is not None and not log.time_0_told and untold_offset
        return Flight(
            video, chosen, log, speed_m_s or 0.0, clock=clock, begun_together=together, log_warnings=told
        )
    except BaseException:
        video.close()
        raise


def merged(frames: Iterator[Frame], samples: tuple[Sample, ...]) -> Iterator[Frame | Sample]:
    """Frames and samples by the order rule of `Flight`."""
    given = -1
    kinds: defaultdict[type[Sample], list[int]] = defaultdict(list)
    for sample in samples:
        kinds[type(sample)].append(sample.stamp_ns)
    for frame in frames:
        if given < 0:
            given = bisect_left(samples, frame.stamp_ns - LEAD_NS, key=lambda sample: sample.stamp_ns)
        until_ns = max(_near(stamps_ns, frame.stamp_ns) for stamps_ns in kinds.values())
        while given < len(samples) and samples[given].stamp_ns <= until_ns:
            yield samples[given]
            given += 1
        yield frame


def _near(stamps_ns: Sequence[int], stamp_ns: int) -> int:
    """The first of rising stamps at or after a time; the time itself where the next is a gap away, or none."""
    index = bisect_left(stamps_ns, stamp_ns)
    near = index < len(stamps_ns) and stamps_ns[index] - stamp_ns <= MAX_GAP_S * NS_PER_S
    return stamps_ns[index] if near else stamp_ns


def with_speed(frames: Iterator[Frame], speed_m_s: float) -> Iterator[Frame | Sample]:
    """Each frame after a velocity with its own stamp."""
    for frame in frames:
        yield forward_velocity(frame.stamp_ns, speed_m_s)
        yield frame
