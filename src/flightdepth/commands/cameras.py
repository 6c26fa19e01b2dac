"""`flightdepth cameras`: the lenses that are known by name, and what a video says of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flightdepth.commands.flight_options import MaskOption, RateOption
from flightdepth.commands.terminal import say, warn
from flightdepth.errors import BadInput


def cameras(
    video: Annotated[
        Path | None,
        typer.Argument(
            metavar="VIDEO", help="Say what this video, or folder of pictures, tells of its lens."
        ),
    ] = None,
    *,
    telemetry: Annotated[
        Path | None,
        typer.Option(
            metavar="LOG",
            help="Log that may tell the field of view, or how the camera turned. Without it, the video's own track, or "
            "a log of its name beside it.",
        ),
    ] = None,
    mask: MaskOption = None,
    rate: RateOption = None,
) -> None:
    """List the lenses that `--camera NAME` knows, or what a video tells of its own.

    Each entry holds for one mode of a camera and says how far it may be off:
    depth is proportional to the focal length. A calibration is better.

    Of a video: what its file tells, and where its gyroscope or a log says how
    the camera turned, the focal length at which its pictures turn as far.

      flightdepth cameras

      flightdepth cameras flight.mp4
    """
    if video is None:
        for option, given in {"--telemetry": telemetry, "--mask": mask, "--rate": rate}.items():
            if given is not None:
                raise BadInput(option, expected="a VIDEO beside it", got="none")
        list_lenses()
    else:
        tell(video, telemetry, mask, rate)


def list_lenses() -> None:
    """The table of lenses, a line each, so that it can be searched with grep."""
    from flightdepth.flight.lenses import known_lenses

    for lens in known_lenses():
        view = f"{lens.horizontal_fov_deg:5.1f} deg {lens.model:<8} within {lens.error:>3.0%}"
        say(f"{lens.name:<32} {view}  {lens.camera}: {lens.mode}  [{lens.source}]")


def tell(path: Path, log: Path | None, mask: Path | None, rate_hz: float | None) -> None:
    """What `run` would take for a video without --camera, or what it would ask for."""
    from flightdepth.flight.cameras import choose_camera
    from flightdepth.flight.flight_log import choose_telemetry
    from flightdepth.flight.mask import PictureMask
    from flightdepth.flight.turn_verdict import described_turns, doubted_by_turns, turns_of
    from flightdepth.flight.video import Video

    hidden = None if mask is None else PictureMask.read(mask)
    with Video(path, mask=hidden, rate_hz=rate_hz) as video:
        try:
            told, _ = choose_telemetry(video, log, None, 0.0, mend="", which="")
        except BadInput:
            if log is not None:
                raise
            told = None  # no log is found that tells a velocity
        try:
            chosen = choose_camera(video, None, None, told)
        except BadInput as error:  # no fault of who asks
            say(f"This video does not tell its camera; `flightdepth run` would stop: {error}")
            return
        camera = chosen.camera
        say(f"{path}: {camera.width}x{camera.height}, focal length {camera.fx:.0f} px; {chosen.source}")
        for line in chosen.warnings:
            warn(line)
        if told is not None and chosen.turns_tell:
            watch = turns_of(video, told, camera)
            say(f"Its turns: {described_turns(watch.focal())}")
            if doubt := doubted_by_turns(watch, camera):
                warn(doubt)
