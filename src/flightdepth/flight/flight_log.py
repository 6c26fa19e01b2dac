"""The log that a flight is flown by: the one given, inside the video or beside it, and moved to its clock."""

from __future__ import annotations

import unicodedata
from dataclasses import replace
from pathlib import Path
from typing import Literal

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.flight.apparent_motion import apparent_motion
from flightdepth.flight.gimbal import looking, with_fixed_camera
from flightdepth.flight.inside import read_inside
from flightdepth.flight.offset import ClockOffset, estimate_offset
from flightdepth.flight.recordings import MEND, at_recording, searched_s
from flightdepth.flight.records import (
    FASTEST_M_S,
    LATEST_NS,
    NS_PER_S,
    Telemetry,
    VelocitySample,
    northwards,
    seconds,
)
from flightdepth.flight.telemetry import is_log, read_telemetry
from flightdepth.flight.universal_time import UniversalTime, utc_text
from flightdepth.flight.untold import shown_until_ns, velocities_apart_ns
from flightdepth.flight.video import Video

AUTO: Literal["auto"] = "auto"
WATCHED_S = 120.0  # of the video, to estimate an offset
SAME_CLOCK_S = 0.5  # less apart two clocks may be, or an offset that the pictures tell
SELDOM_NS = 5 * NS_PER_S  # between velocities: what lies in the middle of such a gap is known to nobody
NO_TELEMETRY = "Give --telemetry LOG or --speed M_S."
# What a log's name may end in, where its content is not known; those that are known need no ending.
LOG_SUFFIXES = frozenset(
    {".csv", ".txt", ".srt", ".json", ".ulg", ".bin", ".log", ".tlog", ".bag", ".mcap", ".db3", ".gpx"}
)


def choose_telemetry(
    video: Video,
    telemetry: str | Path | None,
    speed_m_s: float | None,
    offset_s: float | Literal["auto"],
    *,
    mend: str = NO_TELEMETRY,
    which: str = MEND,
) -> tuple[Telemetry | None, bool]:
    """The log given, inside the video or beside it, moved by `offset_s`, and whether it is the one inside.

    None where a constant speed is flown.

    Raises:
        BadInput: there is none, for which `mend` says what to do, or it says nothing of this video, or of several:
            `which` says what to do then.
    """
    moved_ns = 0 if offset_s == AUTO else in_ns(offset_s)
    if speed_m_s is not None:
        if offset_s:
            raise BadInput("--telemetry-offset", expected="a log to move", got="--speed")
        forward_velocity(0, speed_m_s)  # refuses a speed that is not one, before the first frame
        return None, False
    if telemetry is None:
        log, inside = own_telemetry(video.path, mend=mend)
    else:
        log, inside = read_telemetry(Path(telemetry)), False
    log = at_recording(log, video.duration_ns, offset_given=bool(offset_s), mend=which)
    log = at_names(log, video.utc)
    if offset_s == AUTO:
        return log, inside  # moved once the camera is known
    log = log.later_by(moved_ns)
    check_overlap(video, log)
    return log, inside


def in_ns(offset_s: float) -> int:
    """The seconds of --telemetry-offset, of which times can still be told."""
    if not abs(offset_s) * NS_PER_S < LATEST_NS:  # True for NaN too
        raise BadInput("--telemetry-offset", expected="a finite number of seconds", got=f"{offset_s:g}")
    return round(offset_s * NS_PER_S)


def forward_velocity(stamp_ns: int, speed_m_s: float) -> VelocitySample:
    """Of a flight without a log; without an attitude only its length counts."""
    if not 0 <= speed_m_s <= FASTEST_M_S:
        raise BadInput("--speed", expected=f"0 to {FASTEST_M_S:g} m/s", got=f"{speed_m_s:g}")
    return VelocitySample(stamp_ns, northwards(speed_m_s), "world")


def at_names(log: Telemetry, utc: UniversalTime | None) -> Telemetry:
    """The log with its time 0 at the first picture, where that one's name and the log both tell universal time.

    One that counts from the first picture by itself stays; a recording's own first one may be another.
    """
    told = stamped_by(log)
    if utc is None or told is None or (log.time_0_told and told.clock != "computer"):
        return log
    moved_ns = told.ns_at_zero - utc.ns_at_zero
    name = f"{log.name}; moved by {moved_ns / NS_PER_S:+.3f} s to the times that the pictures' names tell"
    return replace(log.later_by(moved_ns), name=name, time_0_told=True)


def stamped_by(log: Telemetry) -> UniversalTime | None:
    """By the clock that its times come from where they counted from 1970, else as the log tells."""
    return log.since_1970 or log.utc


def clocks_apart(log: Telemetry, utc: UniversalTime | None) -> tuple[str, ...]:
    """What the user should know where a log that stands at its place tells universal time, and pictures' names too."""
    told = stamped_by(log)
    if utc is None or log.utc is None or told is None:
        return ()
    apart_s = (log.utc.ns_at_zero - utc.ns_at_zero) / NS_PER_S
    if abs(apart_s) > SAME_CLOCK_S:
        return (
            f"at the first picture it was {utc_text(utc.ns_at_zero)} by its name, and {log.utc} of the log,"
            f" {abs(apart_s):.1f} s apart",
        )
    if told.clock == "computer":  # the one that named the pictures, as far as anybody can know
        return ()
    clock = f"the log's clock ({told.clock}) and that of the pictures' names"
    return (f"pictures and log are brought together as if {clock} agreed; --telemetry-offset auto checks it",)


def own_telemetry(video: Path, *, mend: str) -> tuple[Telemetry, bool]:
    """The log inside a video, or else the one beside it, and whether it is the one inside.

    Raises:
        BadInput: there is none, or one inside without a velocity and none beside; `mend` says what to do then.
    """
    silent = None
    try:
        inside = read_inside(video)
    except BadInput as error:
        inside, silent = None, error
    if inside is not None:
        return inside, True
    try:
        beside = log_beside(video, mend)
    except BadInput as error:
        raise silent or error from None
    return read_telemetry(beside), False


def log_beside(video: Path, mend: str) -> Path:
    """The one log that has the video's name but for its ending and its case, as DJI's cameras write it."""
    of_pictures = video.is_dir()
    video = video.absolute()  # the name of the folder . is not in it
    own = video.name if of_pictures else video.stem
    named = (path for path in video.parent.iterdir() if _bare_name(path.stem) == _bare_name(own))
    others = sorted(path for path in named if path.name != video.name and path.is_file())
    logs = [path for path in others if is_log(path)]
    if len(logs) == 1:
        return logs[0]
    got = "a folder of pictures" if of_pictures else "none inside the video"
    if logs:
        got += f", and beside it {', '.join(path.name for path in logs)}"
    elif alike := [path for path in others if path.suffix.lower() in LOG_SUFFIXES]:
        got += (
            f", and {alike[0].name} beside it is no log that is known: --telemetry {alike[0].name} tells why"
        )
    else:
        got += f", and no log beside it whose name is {own} and an ending"
    raise BadInput(f"telemetry of {video}", expected="a velocity", got=got, mend=mend)


def _bare_name(name: str) -> str:
    """Without its case, and with accents as one letter: disks of Macs keep them apart."""
    return unicodedata.normalize("NFC", name).casefold()


def synchronised(video: Video, camera: Camera, log: Telemetry) -> tuple[Telemetry, ClockOffset]:
    """The log moved by what the pictures tell, and what that was."""
    start_s = video.start_ns / NS_PER_S
    last_s = (
        start_s + WATCHED_S if video.end_ns is None else min(start_s + WATCHED_S, video.end_ns / NS_PER_S)
    )
    with video.again(start_s=start_s, end_s=last_s) as watched:
        within_s = searched_s(log, video.duration_ns)
        motion = apparent_motion(watched.frames(), camera, video.mask)
        clock = estimate_offset(motion, log, within_s)
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
    end_ns = shown_until_ns(video)
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


def mounted(log: Telemetry | None, pitch_deg: float | None) -> Telemetry | None:
    """The log with the attitude of a camera that is screwed to the drone, where the user says that it is."""
    if pitch_deg is None:
        return log
    if not -90 <= pitch_deg <= 90:
        raise BadInput("--mount-pitch", expected="-90 (down) to 90 (up) degrees", got=str(pitch_deg))
    if log is None or not log.body_attitudes:
        got = "none" if log is None else log.name
        raise BadInput("--mount-pitch", expected="a log with the attitude of the drone", got=got)
    return with_fixed_camera(log, looking(pitch_deg))
