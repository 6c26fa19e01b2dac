"""Which camera took a video: what the user gives, else what the file or its log tells for certain.

A wrong focal length makes every depth wrong by the same share, silently; so nothing is guessed. What is only
probable is named in the refusal, for the user to choose from.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.flight.camera_evidence import (
    ZOOMED,
    CameraEvidence,
    ChosenCamera,
    described,
    doubted_hfov,
    fov_camera,
    same_shape,
)
from flightdepth.flight.camera_file import read_camera
from flightdepth.flight.lenses import CONTRADICTION, Lens, find_lens
from flightdepth.flight.photograph import is_photograph, read_photograph
from flightdepth.flight.records import Telemetry
from flightdepth.flight.turn_verdict import described_turns
from flightdepth.flight.video import Video

WIDEST_IDEAL_DEG = 110.0  # lenses beyond it are fisheyes, nearly always
NO_CAMERA = (
    "Give --hfov DEGREES (the horizontal field of view), --camera NAME (one that `flightdepth cameras` lists) "
    "or --camera FILE (a calibration)."
)


def choose_camera(
    video: Video,
    given: Camera | str | Path | None,
    hfov_deg: float | None,
    log: Telemetry | None = None,
) -> ChosenCamera:
    """The camera given, else the one that the video tells; at the size of the upright pictures."""
    if given is not None and hfov_deg is not None:
        raise BadInput("--camera and --hfov", expected="one of them", got="both")
    evidence = CameraEvidence(video, log)
    told = evidence.told()
    if hfov_deg is not None:
        camera, source = fov_camera(video, hfov_deg), by_hfov(hfov_deg)
        chosen = ChosenCamera(camera, source, warnings=doubted_hfov(hfov_deg))
    elif given is not None:
        chosen = from_user(evidence, given)
    elif (own := told or evidence.told_by_turns()) is not None:
        chosen = own
    else:
        raise unknown_camera(evidence)
    said = tuple(warnings(evidence, chosen, told))
    return replace(chosen, warnings=said, turns_tell=not (chosen.by_turns or evidence.turns_hidden_by))


def from_user(evidence: CameraEvidence, given: Camera | str | Path) -> ChosenCamera:
    """The camera of --camera: a calibration, a photograph by the same camera, or a name in the table."""
    if isinstance(given, Camera):
        return ChosenCamera(upright_calibration(given, evidence), "given")
    path = Path(given)
    if not path.is_file() and path.suffix == "":  # a folder may bear a lens's name
        lens = find_lens(path.name)
        camera = evidence.upright(lens.seen(*evidence.landscape))
        return ChosenCamera(camera, by_table(lens))
    if is_photograph(path):
        photograph = read_photograph(path)
        camera = upright_calibration(photograph.camera, evidence, evidence.shown)
        return ChosenCamera(camera, f"{photograph.source}, if the video is not cropped")
    calibrated = read_camera(path, evidence.video.size)
    return ChosenCamera(upright_calibration(calibrated, evidence), by_calibration(path))


def by_hfov(hfov_deg: float) -> str:
    """Where a camera comes from, for people, as of `by_table` and `by_calibration`."""
    return f"--hfov {hfov_deg:g}, an ideal lens"


def by_table(lens: Lens) -> str:
    """Of a lens of the table: which, of what camera, how wide and how sure."""
    return f"{lens.name} in the table of lenses: {lens.camera}, {described(lens)}"


def by_calibration(path: Path) -> str:
    """Of a calibration's file: its name."""
    return f"calibration {path.name}"


def upright_calibration(
    camera: Camera, evidence: CameraEvidence, size: tuple[int, int] | None = None
) -> Camera:
    """A calibration at the size of the upright pictures; one of the sensor's pictures is turned as they are.

    `size` is that of the upright pictures in the calibration's pixels; without it these are as the video's are stored,
    or as they are shown, square.
    """
    as_shown = same_shape(camera, *evidence.shown)
    width, height = size or (evidence.shown if as_shown else evidence.video.size)
    sideways = evidence.video.quarter_turns % 2 and not same_shape(camera, width, height)
    if sideways and same_shape(camera, height, width):
        return evidence.upright(camera.resized(height, width))
    return camera_of_size(camera, width, height).resized(*evidence.video.size)


def camera_of_size(known: Camera, width: int, height: int) -> Camera:
    """A calibration at the size of the pictures, which must have its shape."""
    if not same_shape(known, width, height):
        got = f"one for {known.width}x{known.height}"
        mend = "Pictures of another shape are cropped: calibrate in the video's own mode, or give --hfov."
        expected = f"a calibration for {width}x{height} or its shape"
        raise BadInput("camera", expected=expected, got=got, mend=mend)
    return known.resized(width, height)


def warnings(evidence: CameraEvidence, chosen: ChosenCamera, told: ChosenCamera | None) -> Iterator[str]:
    """What the user should know of the camera before an hour is spent on wrong depths."""
    yield from chosen.warnings
    if chosen.camera.model == "pinhole" and chosen.camera.horizontal_fov_deg > WIDEST_IDEAL_DEG:
        yield (
            f"{chosen.camera.horizontal_fov_deg:.0f} degrees through an ideal lens: the wide modes of action cameras "
            "are fisheyes, whose depths would come out far too near; take a name of `flightdepth cameras` or calibrate"
        )
    if evidence.stabilisation is not None and not chosen.by_turns:
        yield evidence.stabilisation.warning
    if evidence.gopro is not None and evidence.gopro.warped:
        yield f"mode {evidence.gopro.mode} of the {evidence.gopro.model} stretches the picture: depth bends"
    if evidence.gopro is not None and evidence.gopro.zoomed:
        yield f"the {evidence.gopro.model} zoomed digitally: a figure for its mode without zoom is too wide"
    if chosen.views is None and evidence.zoom > 1 + ZOOMED:
        yield (
            f"the lens zooms by {evidence.zoom:.2f} meanwhile, by the log, and one focal length is taken for all: "
            "depths will be wrong by so much; run parts of one zoom, with --start and --end"
        )
    if told is not None and abs(chosen.camera.fx / told.camera.fx - 1) > CONTRADICTION:
        share = chosen.camera.fx / told.camera.fx
        yield (
            f"focal length {chosen.camera.fx:.0f} px given, {told.camera.fx:.0f} px told ({told.source}): "
            f"depths will be {share:.2f} times those of the latter"
        )


def unknown_camera(evidence: CameraEvidence) -> BadInput:
    """The refusal where nothing tells the focal length for certain, with what it probably is."""
    likely = list(evidence.likely())
    mend = f"Likely: {'; '.join(likely)}. Or another --hfov, or --camera FILE." if likely else NO_CAMERA
    what = f"camera of {evidence.video.path}"
    got = "none"
    if evidence.gopro is not None:
        mode = evidence.gopro.mode and f" in mode {evidence.gopro.mode}"
        got = f"a {evidence.gopro.model}{mode}, which does not settle it"
    if evidence.log is not None:
        got += f"; of its turns: {described_turns(evidence.turned)}"
    return BadInput(what, expected="a focal length", got=got, mend=mend)
