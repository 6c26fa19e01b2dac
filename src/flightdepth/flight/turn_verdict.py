"""What the turns of a video's camera say of its lens: which it is, or that another was given (`turned_focal`)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.flight.apparent_motion import followed
from flightdepth.flight.lenses import CERTAIN_ERROR, CONTRADICTION
from flightdepth.flight.records import NS_PER_S, Telemetry
from flightdepth.flight.signals import Signal
from flightdepth.flight.steadiness import small_camera
from flightdepth.flight.turned_focal import TurnedFocal, TurnPoints, TurnWatch, ideal_lenses
from flightdepth.flight.video import Video

WATCHED_S = 60.0  # of the video
SIGMAS = 3.0  # of what turns tell


def turns_of(video: Video, log: Telemetry, camera: Camera) -> TurnWatch:
    """The part of the file in which the camera turns most, watched through `camera`, whatever part `video` shows.

    No part where the log turns most after the pictures end: a video that is cut, or streamed, need not tell its length.
    """
    watch = TurnWatch(log, small_camera(camera))
    last_s = (video.duration_ns or math.inf) / NS_PER_S
    start_s = watch.busiest_s(0.0, last_s, WATCHED_S)
    try:
        watched = video.again(start_s=start_s, end_s=min(start_s + WATCHED_S, last_s))
    except BadInput:
        return watch
    with watched:
        frames = (frame for frame in watched.frames() if watch.wants(frame.stamp_ns))
        for pair in followed(frames, camera, video.mask):
            watch.add(*pair)
    return watch


@dataclass(frozen=True)
class TurnVerdict:
    """What turns say of a camera: `found` of its lens, and `doubt`, a line where they deny its focal length.

    off  by which share it differs from what they tell, where they tell one and do not deny it; NaN otherwise
    """

    found: TurnedFocal
    doubt: str | None = None
    off: float = math.nan

    @property
    def agrees(self) -> bool:
        """Whether the turns tell the focal length well enough, and the same."""
        return self.doubt is None and self.found.share <= CERTAIN_ERROR and self.off < CONTRADICTION

    @property
    def decided(self) -> bool:
        """Whether they say one or the other."""
        return self.agrees or self.doubt is not None

    def __str__(self) -> str:
        if self.doubt is not None:
            return self.doubt
        if self.agrees:
            return f"agrees with its turns within {max(self.off, self.found.share):.0%}"
        return f"its turns do not settle it: {described_turns(self.found)}"


def judged_by_turns(points: TurnPoints, told: Signal | None, camera: Camera) -> TurnVerdict:
    """Whether a camera can be the one through which pictures turned as told, rad/s. A second or two.

    It is denied where both the lens given and the one that fits best have another focal length.
    """
    own = points.focal(told)
    if turns_deny(own, camera) is None:
        off = math.nan if own.camera is None else abs(math.log(focal_share(own.camera, camera)))
        return TurnVerdict(own, off=off)
    best = points.focal(told, (points.camera, *ideal_lenses(points.camera)))
    return TurnVerdict(best, turns_deny(best, camera))


def doubted_by_turns(watch: TurnWatch, camera: Camera) -> str | None:
    """A line where a video's camera can't be the one through which its pictures turned as its log says."""
    return judged_by_turns(watch.points, watch.told, camera).doubt


def focal_share(told: Camera, camera: Camera) -> float:
    """Focal length of a camera over that of another, at the same size."""
    return camera.fx / told.resized(camera.width, camera.height).fx


def turns_deny(found: TurnedFocal, camera: Camera) -> str | None:
    """A line where turns tell another focal length than that of a video's camera."""
    if found.camera is None:
        return None
    share = focal_share(found.camera, camera)
    if abs(math.log(share)) < max(CONTRADICTION, SIGMAS * found.share):
        return None
    return (
        f"focal length {camera.fx:.0f} px, where the turns tell {camera.fx / share:.0f} ({described_turns(found)}): "
        f"depths flying sideways are {share:.2f} times those of the latter; calibrate, or see "
        "`flightdepth cameras VIDEO`"
    )


def described_turns(found: TurnedFocal) -> str:
    """What turns tell, in a few words."""
    if found.camera is None:
        return found.reason
    lens = "an ideal lens" if found.camera.model == "pinhole" else "a fisheye"
    view = f"field of view of {found.camera.horizontal_fov_deg:.1f} degrees through {lens}, within {found.share:.0%}"
    return f"{view}, as its pictures moved when it turned by {found.turned_deg:.0f} degrees"
