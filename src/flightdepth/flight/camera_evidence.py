"""What a video and its log tell of the camera without the user: for certain, by its turns, or only probably."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.flight.gopro_settings import GoproSettings, read_gopro_settings
from flightdepth.flight.lenses import CERTAIN_ERROR, Lens, fov_of_equivalent_deg, known_lenses, millimetres
from flightdepth.flight.records import Telemetry, ViewTrack
from flightdepth.flight.stabilisation import Stabilisation, find_stabilisation
from flightdepth.flight.still import EQUIVALENT
from flightdepth.flight.turn_verdict import described_turns, turns_of
from flightdepth.flight.turned_focal import TurnedFocal, ideal_lenses
from flightdepth.flight.video import Video

ZOOMED = 0.02
FIRST_TRIED_DEG = 80.0
NARROW_FOV_DEG, LEAST_FOV_DEG = 5.0, 0.1  # of --hfov: doubted below, refused below
APPLE_EQUIVALENT = "com.apple.quicktime.camera.focal_length.35mm_equivalent"


@dataclass(frozen=True)
class ChosenCamera:
    """The camera of a video's upright pictures.

    source    a line for people: what was taken, from where, and how sure it is
    warnings  a line each
    by_turns  whether the camera's turns told it
    turns_tell  whether turns may yet deny it: not where the lens zooms or software turns or stretches the pictures
    views     the field of view of each picture, where the log tells that it changes; `camera` has `view_deg`
    """

    camera: Camera
    source: str
    warnings: tuple[str, ...] = ()
    by_turns: bool = False
    turns_tell: bool = True
    views: ViewTrack | None = None
    view_deg: float = math.nan

    def at(self, stamp_ns: int) -> Camera:
        """The camera of the picture at a time: the same for pictures whose views differ by less than ZOOMED."""
        if self.views is None:
            return self.camera
        half, base = (math.tan(math.radians(deg) / 2) for deg in (self.views.at(stamp_ns), self.view_deg))
        return self.camera.zoomed(math.exp(round(math.log(base / half) / ZOOMED) * ZOOMED))


class CameraEvidence:
    """What is known of a video without the user: its size, tags, GoPro settings and log."""

    def __init__(self, video: Video, log: Telemetry | None) -> None:
        self.video, self.log = video, log
        self.view = None if log is None else log.view
        self.tags = video.tags
        self.gopro = read_gopro_settings(video.path, self.tags.get("firmware", ""))
        self.stabilisation: Stabilisation | None = find_stabilisation(self.tags, self.gopro)

    @property
    def shown(self) -> tuple[int, int]:
        """Size of the upright pictures in square pixels."""
        width, height = self.video.size
        return round(width * self.video.pixel_aspect), height

    @property
    def landscape(self) -> tuple[int, int]:
        """Size of the pictures as the sensor took them, before they are turned upright, in square pixels."""
        width, height = self.shown
        return (height, width) if self.video.quarter_turns % 2 else (width, height)

    def upright(self, camera: Camera) -> Camera:
        """A camera of the sensor's pictures as that of the upright ones, in their own pixels."""
        turned = camera.turned(self.video.quarter_turns)
        return turned if self.video.pixel_aspect == 1 else turned.resized(*self.video.size)

    def told(self) -> ChosenCamera | None:
        """The camera, where the log or the file tells it for certain."""
        return self._from_log() or self._from_gopro()

    def _from_log(self) -> ChosenCamera | None:
        if self.view is None or self.view.nominal:
            return None
        seen = self.view.between(self.video.start_ns, self.video.end_ns)
        hfov_deg = float(np.median(seen))
        camera = self.upright(Camera.from_fov(*self.landscape, hfov_deg))
        source = f"field of view of {hfov_deg:.1f} degrees, from the log, which tells it for each picture"
        focals = np.tan(np.radians(hfov_deg) / 2) / np.tan(np.radians(seen) / 2)
        if np.abs(focals - 1).max() < ZOOMED:
            return ChosenCamera(camera, source)
        span = f"{seen.min():.1f} to {seen.max():.1f}"
        return ChosenCamera(camera, f"{source}: {span} degrees here", views=self.view, view_deg=hfov_deg)

    def _from_gopro(self) -> ChosenCamera | None:
        gopro = self.gopro
        if gopro is None or not gopro.mode or gopro.warped or gopro.zoomed:
            return None
        width, height = self.landscape
        own = gopro.lens if gopro.stabilised is False else None
        if own is not None and same_shape(own, width, height):
            source = f"calibration of the {gopro.model} in its own file, mode {gopro.mode}"
            camera = self.upright(own.resized(width, height))
            return ChosenCamera(camera, f"{source}: {own.horizontal_fov_deg:.1f} degrees")
        for lens in matching(gopro, width, height):
            if lens.error <= CERTAIN_ERROR:
                source = f"{gopro.model} says {lens.mode}: {described(lens)}"
                return ChosenCamera(self.upright(lens.seen(width, height)), source)
        return None

    def told_by_turns(self) -> ChosenCamera | None:
        """The camera through which the pictures turn as far as the log says, where that is known well enough."""
        found = self.turned
        if found.camera is None or found.share > CERTAIN_ERROR:
            return None
        return ChosenCamera(found.camera.resized(*self.video.size), described_turns(found), by_turns=True)

    @cached_property
    def turned(self) -> TurnedFocal:
        """What the camera's turns tell of its lens; takes a pass over a part of the video."""
        if self.log is None or self.turns_hidden_by:
            return TurnedFocal(None, reason=self.turns_hidden_by or "no log tells how the camera turns")
        watch = turns_of(self.video, self.log, assumed_camera(self.video))
        return watch.focal(ideal_lenses(watch.camera))

    @property
    def zoom(self) -> float:
        """By how much longer the longest focal length of these pictures is than the shortest, by the log."""
        if self.view is None:
            return 1.0
        halves = np.tan(np.radians(self.view.between(self.video.start_ns, self.video.end_ns)) / 2)
        return float(halves.max() / halves.min())

    @property
    def turns_hidden_by(self) -> str:
        """Why the pictures need not turn as the camera does; empty where nothing says so."""
        if self.view is not None:
            return "the lens may zoom"
        if self.stabilisation is not None and self.stabilisation.certain:
            return f"the pictures are stabilised ({self.stabilisation.name}), so they turn otherwise than the camera"
        if self.gopro is not None and self.gopro.warped:
            return "the pictures are stretched"
        return ""

    def likely(self) -> Iterator[str]:
        """Values that are probable, as options of the command line with the reason."""
        if self.view is not None and self.view.nominal:
            hfov_deg = float(np.median(self.view.between(self.video.start_ns, self.video.end_ns)))
            yield self._whole_sensor(hfov_deg, "focal length in the log")
        if equivalent := millimetres(self.tags.get(APPLE_EQUIVALENT, "")):
            yield self._whole_sensor(fov_of_equivalent_deg(equivalent), f"{equivalent:g} mm in its tags")
        if equivalent := millimetres(self.tags.get(EQUIVALENT, "")):
            hfov_deg = fov_of_equivalent_deg(equivalent, self.shown)
            yield f"--hfov {hfov_deg:.1f} if the pictures are not cropped ({equivalent:g} mm in their EXIF tags)"
        for lens in self._lenses_of_model():
            yield f"--camera {lens.name} ({lens.mode}: {lens.horizontal_fov_deg:.1f} degrees)"

    def _whole_sensor(self, hfov_deg: float, source: str) -> str:
        """A field of view across the sensor's long side as the option, which counts across the upright pictures."""
        upright = self.upright(Camera.from_fov(*self.landscape, hfov_deg))
        return f"--hfov {upright.horizontal_fov_deg:.1f} if the video is as wide as the sensor ({source})"

    def _lenses_of_model(self) -> Iterator[Lens]:
        said = " ".join(self.tags.values()).lower()
        for lens in known_lenses():
            if not lens.fits(*self.landscape):
                continue
            if self.gopro is not None:
                mode_may_be = not self.gopro.mode or lens.code == self.gopro.mode
                if self.gopro.model in lens.models and mode_may_be:
                    yield lens
            elif any(model.lower() in said for model in lens.models):
                yield lens


def assumed_camera(video: Video) -> Camera:
    """For what depends little on the lens, where that is not known yet."""
    return fov_camera(video, FIRST_TRIED_DEG)


def check_hfov(hfov_deg: float) -> None:
    """Refuse a --hfov at which a picture's rays are all one."""
    if 0 < hfov_deg < LEAST_FOV_DEG:  # what is no angle is refused with the camera
        raise BadInput("--hfov", expected=f"{LEAST_FOV_DEG:g} degrees or more", got=f"{hfov_deg:g}")


def doubted_hfov(hfov_deg: float) -> tuple[str, ...]:
    """A line where a --hfov may be radians."""
    if hfov_deg >= NARROW_FOV_DEG:
        return ()
    as_radians = f"{hfov_deg:g} radians were {math.degrees(hfov_deg):.0f}"
    return (
        f"--hfov {hfov_deg:g} is in degrees, the view of a telescope ({as_radians}): depths may be far too large",
    )


def fov_camera(video: Video, hfov_deg: float) -> Camera:
    """An ideal lens for the upright pictures, whose pixels need not be square."""
    check_hfov(hfov_deg)
    camera = Camera.from_fov(*video.size, hfov_deg)
    return replace(camera, fy=camera.fx * video.pixel_aspect)


def same_shape(camera: Camera, width: int, height: int) -> bool:
    """Whether a camera's pictures have the shape of a size, to a pixel."""
    return abs(camera.width * height - camera.height * width) <= max(camera.width, width)


def matching(gopro: GoproSettings, width: int, height: int) -> Iterator[Lens]:
    """The table's lenses for what a GoPro says of its model, mode and stabilisation."""
    for lens in known_lenses():
        named = gopro.model in lens.models and lens.code == gopro.mode and lens.fits(width, height)
        off = not lens.stabilised and gopro.stabilised is False
        if named and (off or gopro.stabilisation in lens.stabilised):
            yield lens


def described(lens: Lens) -> str:
    """A lens in a few words: how wide, how sure, by whom."""
    return f"{lens.horizontal_fov_deg:.1f} degrees, within {lens.error:.0%}, after {lens.source}"
