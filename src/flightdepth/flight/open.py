"""Opening a flight: a video, its camera and its telemetry, merged in time order."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Literal

import numpy as np

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.flight.apparent_motion import apparent_motion
from flightdepth.flight.cameras import ChosenCamera, assumed_camera, choose_camera
from flightdepth.flight.constant_speed import forward_velocity
from flightdepth.flight.gimbal import looking, with_fixed_camera
from flightdepth.flight.gpmf_telemetry import read_gpmf
from flightdepth.flight.offset import ClockOffset, estimate_offset
from flightdepth.flight.own_track import disagreements
from flightdepth.flight.recordings import at_recording, doubted_length, searched_s
from flightdepth.flight.records import (
    NS_PER_S,
    AttitudeSample,
    Frame,
    GyroscopeTrack,
    Sample,
    Telemetry,
    VelocitySample,
    seconds,
)
from flightdepth.flight.signals import GAP_S
from flightdepth.flight.steadiness import small_camera
from flightdepth.flight.telemetry import is_log, read_telemetry
from flightdepth.flight.turn_verdict import doubted_by_turns
from flightdepth.flight.turned_focal import TurnWatch
from flightdepth.flight.video import Video

BODY_ONLY = (
    "the log tells how the drone turned, not the camera; --mount-pitch 0 uses it for a camera that is screwed "
    "to the drone and looks ahead (-90: down)"
)
AUTO: Literal["auto"] = "auto"
WATCHED_S = 120.0  # of the video, to estimate an offset
SELDOM_NS = 5 * NS_PER_S  # between velocities: what lies in the middle of such a gap is known to nobody
LEAD_NS = SELDOM_NS  # of samples before the first frame
NO_TELEMETRY = "Give --telemetry LOG or --speed M_S."
# What a log's name may end in, where its content is not known; those that are known need no ending.
LOG_SUFFIXES = frozenset(
    {".csv", ".txt", ".srt", ".json", ".ulg", ".bin", ".log", ".tlog", ".bag", ".mcap", ".db3"}
)


class Flight:
    """Frames, velocities and attitudes of one flight in time order; iterate once, inside `with`.

    Order rule: before each frame come all samples up to the first velocity and, where it is no gap away, the first
    attitude at or after the frame's stamp, if there is one, so that whoever integrates or interpolates knows it on
    both sides of the frame. A sample may thus be ahead of the next frame, by one spacing at most. Later samples are
    left out, and those more than LEAD_NS before the first frame, which tell nothing of it.
    """

    def __init__(
        self,
        video: Video,
        chosen: ChosenCamera,
        telemetry: Telemetry | None,
        speed_m_s: float,
        *,
        clock: ClockOffset | None = None,
        log_warnings: tuple[str, ...] = (),
    ) -> None:
        self._video = video
        self._telemetry = telemetry
        self._speed_m_s = speed_m_s
        self._chosen = chosen
        self.camera = chosen.camera
        self._log_warnings = log_warnings
        self.clock = clock  # as estimated from the pictures, where that was asked for
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
    def camera_source(self) -> str:
        """A line saying where the camera comes from, and how sure it is."""
        return self._chosen.source

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the user should know of the camera and the log, a line each."""
        log, told = self._telemetry, (*self._chosen.warnings, *self._log_warnings)
        if log is None or not log.body_attitudes or any(isinstance(s, AttitudeSample) for s in log.samples):
            return told
        return (*told, BODY_ONLY)

    def lens_doubt(self) -> str | None:
        """A line where the turns that `turns` was shown deny the camera; takes a second or two."""
        return None if self.turns is None else doubted_by_turns(self.turns, self.camera)

    @property
    def video_bytes(self) -> int:
        """Size of the video's file."""
        return self._video.path.stat().st_size

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
) -> Flight:
    """Open a video with its telemetry.

    telemetry  a log file; None looks inside the video (GPMF), then for a log of the video's name beside it (DJI's
               subtitles), unless `speed_m_s` is given
    telemetry_offset_s  is added to the log's times, so that they count from the video's first picture; "auto"
               estimates it from the pictures, which takes a pass over the video, and stays at 0 where they tell none
    camera     a Camera, a calibration file, a photograph with EXIF tags or a name of the table of lenses;
               None takes `hfov_deg`, the horizontal field of view, or what the file tells for certain
    mount_pitch_deg  the camera is screwed to the drone and looks up by so many degrees, -90 is down
    speed_m_s  constant speed in any direction, for flights without a log
    start_s, end_s  part of the video, seconds since its first picture
    """
    if telemetry is not None and speed_m_s is not None:
        raise BadInput("--telemetry and --speed", expected="one of them", got="both")
    video = Video(Path(path), start_s=start_s, end_s=end_s)
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
        told = clock_warnings(clock, inside=inside) + (() if log is None else seldom_told(log))
        if log is not None and telemetry is not None:
            told += disagreements(log, video)
        if log is not None and (not telemetry_offset_s if clock is None else clock.offset_s is None):
            told += doubted_length(log, video.duration_ns)
        return Flight(video, chosen, log, speed_m_s or 0.0, clock=clock, log_warnings=told)
    except BaseException:
        video.close()
        raise


def choose_telemetry(
    video: Video, telemetry: str | Path | None, speed_m_s: float | None, offset_s: float | Literal["auto"]
) -> tuple[Telemetry | None, bool]:
    """The log given, inside the video or beside it, moved by `offset_s`, and whether it is the one inside.

    None where a constant speed is flown.
    """
    if offset_s != AUTO and not math.isfinite(offset_s):
        raise BadInput(
            "--telemetry-offset", expected="a finite number of seconds, or auto", got=str(offset_s)
        )
    if speed_m_s is not None:
        forward_velocity(0, speed_m_s)  # refuses a speed that is not one, before the first frame
        return None, False
    if telemetry is None:
        log, inside = own_telemetry(video.path, mend=NO_TELEMETRY)
    else:
        log, inside = read_telemetry(Path(telemetry)), False
    log = at_recording(log, video.duration_ns, offset_given=bool(offset_s))
    if offset_s == AUTO:
        return log, inside  # moved once the camera is known
    log = log.later_by(round(offset_s * NS_PER_S)) if offset_s else log
    check_overlap(video, log)
    return log, inside


def own_telemetry(video: Path, *, mend: str) -> tuple[Telemetry, bool]:
    """The log inside a video, or else the one beside it, and whether it is the one inside.

    Raises:
        BadInput: there is none; `mend` says what to do then.
    """
    inside = read_gpmf(video)
    return (read_telemetry(log_beside(video, mend)), False) if inside is None else (inside, True)


def log_beside(video: Path, mend: str) -> Path:
    """The one log that has the video's name but for its ending, as DJI's cameras write it."""
    named = (path for path in video.parent.iterdir() if path.stem == video.stem and path.name != video.name)
    others = sorted(path for path in named if path.is_file())
    logs = [path for path in others if is_log(path)]
    if len(logs) == 1:
        return logs[0]
    got = "none inside the video"
    if logs:
        got += f", and beside it {', '.join(path.name for path in logs)}"
    elif alike := [path for path in others if path.suffix.lower() in LOG_SUFFIXES]:
        got += (
            f", and {alike[0].name} beside it is no log that is known: --telemetry {alike[0].name} tells why"
        )
    raise BadInput(f"telemetry of {video}", expected="a velocity", got=got, mend=mend)


def synchronised(video: Video, camera: Camera, log: Telemetry) -> tuple[Telemetry, ClockOffset]:
    """The log moved by what the pictures tell, and what that was."""
    start_s = video.start_ns / NS_PER_S
    last_s = (
        start_s + WATCHED_S if video.end_ns is None else min(start_s + WATCHED_S, video.end_ns / NS_PER_S)
    )
    with Video(video.path, start_s=start_s, end_s=last_s) as watched:
        within_s = searched_s(log, video.duration_ns)
        clock = estimate_offset(apparent_motion(watched.frames(), camera), log, within_s)
    try:
        if clock.offset_s is not None:
            log = log.later_by(round(clock.offset_s * NS_PER_S))
        elif len(log.recordings) > 1:  # of which none is this video: refused
            log = at_recording(log, video.duration_ns, mend="Give the offset of the right one.")
        check_overlap(video, log)
    except BadInput as error:
        raise BadInput(f"--telemetry-offset auto: {clock}; {error}") from None
    return log, clock


def clock_warnings(clock: ClockOffset | None, *, inside: bool) -> tuple[str, ...]:
    """What the user should know of an estimated offset; `inside`: the video's own container times the log."""
    if clock is None:
        return ()
    if clock.offset_s is None:
        return (f"--telemetry-offset auto: {clock}; the log's times are taken as they are",)
    if inside and clock.contradicts(0.0):
        return (f"--telemetry-offset auto: {clock}: contradicts the times in the video's own file",)
    return ()


def check_overlap(video: Video, log: Telemetry) -> None:
    """Refuse a log that says nothing about the chosen part of the video."""
    first_ns, last_ns = log.span_ns
    ends = [end_ns for end_ns in (video.end_ns, video.duration_ns or None) if end_ns is not None]
    end_ns = min(ends, default=None)
    if last_ns < video.start_ns or (end_ns is not None and first_ns > end_ns):
        end = "its end" if end_ns is None else seconds(end_ns)
        raise BadInput(
            f"telemetry {log.name}",
            expected=f"times within {seconds(video.start_ns)} to {end} of the video",
            got=f"{seconds(first_ns)} to {seconds(last_ns)}",
            mend="Times count from the video's first picture; --telemetry-offset S adds S seconds to the log's.",
        )
    apart_ns = velocities_apart_ns(log)
    if apart_ns > SELDOM_NS:
        raise BadInput(
            f"telemetry {log.name}",
            expected=f"a velocity every {seconds(SELDOM_NS)} at least",
            got=f"one in {seconds(apart_ns)}",
            mend="Are its times in the unit that their column says?",
        )


def velocities_apart_ns(log: Telemetry) -> int:
    """Median time between two velocities of a log, 0 where there is only one."""
    stamps_ns = [sample.stamp_ns for sample in log.samples if isinstance(sample, VelocitySample)]
    return int(np.median(np.diff(stamps_ns))) if len(stamps_ns) > 1 else 0


def seldom_told(log: Telemetry) -> tuple[str, ...]:
    """A line where so much time lies between two velocities that nobody knows how the drone flew meanwhile."""
    apart_ns = velocities_apart_ns(log)
    if apart_ns <= GAP_S * NS_PER_S:
        return ()
    return (
        f"the log tells a velocity every {apart_ns / NS_PER_S:.1f} s only, and more than "
        f"{GAP_S:g} s between two are not bridged: most frames will have no depth; log it more often",
    )


def mounted(log: Telemetry | None, pitch_deg: float | None) -> Telemetry | None:
    """The log with the attitude of a camera that is screwed to the drone, where the user says that it is."""
    if pitch_deg is None:
        return log
    if not -90 <= pitch_deg <= 90:
        raise BadInput("--mount-pitch", expected="-90 (down) to 90 (up) degrees", got=str(pitch_deg))
    if log is None or not log.body_attitudes:
        got = "none" if log is None else log.name
        raise BadInput("--mount-pitch", expected="a log with the attitude of the drone", got=got)
    return with_fixed_camera(log, looking(math.radians(pitch_deg)))


def merged(frames: Iterator[Frame], samples: tuple[Sample, ...]) -> Iterator[Frame | Sample]:
    """Frames and samples by the order rule of `Flight`."""
    given, end_ns = -1, samples[-1].stamp_ns
    velocities = [sample.stamp_ns for sample in samples if isinstance(sample, VelocitySample)]
    attitudes = [sample.stamp_ns for sample in samples if isinstance(sample, AttitudeSample)]
    for frame in frames:
        if given < 0:
            given = bisect_left(samples, frame.stamp_ns - LEAD_NS, key=lambda sample: sample.stamp_ns)
        until_ns = _next(velocities, frame.stamp_ns, end_ns)
        turned_ns = _next(attitudes, frame.stamp_ns, until_ns)
        if turned_ns - frame.stamp_ns <= GAP_S * NS_PER_S:
            until_ns = max(until_ns, turned_ns)
        while given < len(samples) and samples[given].stamp_ns <= until_ns:
            yield samples[given]
            given += 1
        yield frame


def _next(stamps_ns: Sequence[int], stamp_ns: int, otherwise_ns: int) -> int:
    """The first of rising stamps at or after a time."""
    index = bisect_left(stamps_ns, stamp_ns)
    return stamps_ns[index] if index < len(stamps_ns) else otherwise_ns


def with_speed(frames: Iterator[Frame], speed_m_s: float) -> Iterator[Frame | Sample]:
    """Each frame after a velocity with its own stamp."""
    for frame in frames:
        yield forward_velocity(frame.stamp_ns, speed_m_s)
        yield frame
