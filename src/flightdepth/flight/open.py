"""Opening a flight: a video, its camera and its telemetry, merged in time order."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.flight.camera_file import read_camera
from flightdepth.flight.constant_speed import forward_velocity
from flightdepth.flight.gpmf_telemetry import read_gpmf
from flightdepth.flight.records import (
    NS_PER_S,
    Frame,
    GyroscopeTrack,
    Sample,
    Telemetry,
    VelocitySample,
    seconds,
)
from flightdepth.flight.telemetry import read_telemetry
from flightdepth.flight.video import Video

NO_CAMERA = "Give --hfov DEGREES (the horizontal field of view) or --camera FILE."
NO_TELEMETRY = "Give --telemetry LOG or --speed M_S."


class Flight:
    """Frames, velocities and attitudes of one flight in time order; iterate once, inside `with`.

    Order rule: before each frame come all samples up to the first velocity at or after the frame's stamp,
    if there is one, so that whoever integrates the velocity knows it on both sides of the frame. A sample may
    thus be ahead of the next frame, by one velocity's spacing at most. Later samples are left out.
    """

    def __init__(self, video: Video, camera: Camera, telemetry: Telemetry | None, speed_m_s: float) -> None:
        self._video = video
        self._telemetry = telemetry
        self._speed_m_s = speed_m_s
        self.camera = camera

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
            return merged(self._video.frames(), self._telemetry.samples)
        return with_speed(self._video.frames(), self._speed_m_s)

    @property
    def telemetry_name(self) -> str:
        """A line saying where the velocity comes from."""
        if self._telemetry is not None:
            return self._telemetry.name
        return f"constant speed of {self._speed_m_s:g} m/s straight ahead"

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
    telemetry_offset_s: float = 0.0,
    speed_m_s: float | None = None,
    hfov_deg: float | None = None,
    start_s: float | None = None,
    end_s: float | None = None,
) -> Flight:
    """Open a video with its telemetry.

    telemetry  a log file; None looks inside the video (GPMF), unless `speed_m_s` is given
    telemetry_offset_s  is added to the log's times, so that they count from the video's first picture
    camera     a Camera or a calibration file; None needs `hfov_deg`, the horizontal field of view
    speed_m_s  constant speed straight ahead, for flights without a log
    start_s, end_s  part of the video, seconds since its first picture
    """
    if telemetry is not None and speed_m_s is not None:
        raise BadInput("--telemetry and --speed", expected="one of them", got="both")
    video = Video(Path(path), start_s=start_s, end_s=end_s)
    try:
        log = choose_telemetry(video, telemetry, speed_m_s, telemetry_offset_s)
        return Flight(video, choose_camera(video, camera, hfov_deg), log, speed_m_s or 0.0)
    except BaseException:
        video.close()
        raise


def choose_telemetry(
    video: Video, telemetry: str | Path | None, speed_m_s: float | None, offset_s: float
) -> Telemetry | None:
    """The log given, or the one inside the video, moved by `offset_s`; None where a constant speed is flown."""
    if not math.isfinite(offset_s):
        raise BadInput("--telemetry-offset", expected="a finite number of seconds", got=str(offset_s))
    if speed_m_s is not None:
        forward_velocity(0, speed_m_s)  # refuses a speed that is not one, before the first frame
        return None
    log = read_gpmf(video.path) if telemetry is None else read_telemetry(Path(telemetry))
    if log is None:
        got = "none inside the video"
        raise BadInput(f"telemetry of {video.path}", expected="a velocity", got=got, mend=NO_TELEMETRY)
    log = log.later_by(round(offset_s * NS_PER_S)) if offset_s else log
    check_overlap(video, log)
    return log


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


def choose_camera(video: Video, camera: Camera | str | Path | None, hfov_deg: float | None) -> Camera:
    """The camera given, at the size of the upright pictures."""
    width, height = video.size
    if camera is not None and hfov_deg is not None:
        raise BadInput("--camera and --hfov", expected="one of them", got="both")
    if hfov_deg is not None:
        return Camera.from_fov(width, height, hfov_deg)
    if camera is None:
        raise BadInput(f"camera of {video.path}", expected="a focal length", got="none", mend=NO_CAMERA)
    known = camera if isinstance(camera, Camera) else read_camera(Path(camera))
    if abs(known.width * height - known.height * width) > max(known.width, width):
        got = f"one for {known.width}x{known.height}"
        raise BadInput("camera", expected=f"a calibration for {width}x{height} or its shape", got=got)
    return known.resized(width, height)


def merged(frames: Iterator[Frame], samples: tuple[Sample, ...]) -> Iterator[Frame | Sample]:
    """Frames and samples by the order rule of `Flight`."""
    given, ahead_ns = 0, None
    for frame in frames:
        while given < len(samples) and (ahead_ns is None or ahead_ns < frame.stamp_ns):
            sample = samples[given]
            if isinstance(sample, VelocitySample):
                ahead_ns = sample.stamp_ns
            yield sample
            given += 1
        # An attitude may share the stamp of the velocity before it.
        while given < len(samples) and ahead_ns is not None and samples[given].stamp_ns <= ahead_ns:
            yield samples[given]
            given += 1
        yield frame


def with_speed(frames: Iterator[Frame], speed_m_s: float) -> Iterator[Frame | Sample]:
    """Each frame after a velocity with its own stamp."""
    for frame in frames:
        yield forward_velocity(frame.stamp_ns, speed_m_s)
        yield frame
