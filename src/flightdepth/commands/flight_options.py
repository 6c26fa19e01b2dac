"""Options of every command that flies a recorded video: its log, its lens, the part of it to use."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from flightdepth.errors import BadInput

TelemetryOption = Annotated[
    Path | None,
    typer.Option(
        metavar="LOG",
        help="Flight log of PX4, ArduPilot, MAVLink, DJI, Parrot, ROS, GPX, CSV, or a trajectory (TUM): told by what "
        "is in it. Without it, the video's own track (GoPro, DJI), or a log of its name beside it.",
    ),
]
OffsetOption = Annotated[
    str,
    typer.Option(
        metavar="S|auto",
        help="Seconds to add to the log's times, so that the first picture is at 0. auto: as the pictures tell.",
    ),
]
CameraOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE|NAME",
        help="Calibration (OpenCV, ROS, JSON), a photograph, or a name of `flightdepth cameras`. "
        "Without it, what the video tells.",
    ),
]
HfovOption = Annotated[
    float | None,
    typer.Option(metavar="DEG", help="Horizontal field of view in degrees, instead of --camera."),
]
MountPitchOption = Annotated[
    float | None,
    typer.Option(
        metavar="DEG",
        help="The camera is screwed to the drone and looks up by so many degrees (0 ahead, -90 down): "
        "use the drone's attitude.",
    ),
]
RateOption = Annotated[
    float | None,
    typer.Option(metavar="HZ", help="Pictures a second, of a folder of pictures whose names are no times."),
]
MaskOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="A picture of the video's shape, black where parts of the drone or burned-in text hide the scene, white "
        "elsewhere. Nothing is told of what is black.",
    ),
]
StartOption = Annotated[
    float | None, typer.Option(metavar="S", help="Second of the video to start at. Default: its first.")
]
EndOption = Annotated[
    float | None, typer.Option(metavar="S", help="Second of the video to stop at. Default: its last.")
]


def offset_of(text: str) -> float | Literal["auto"]:
    """Seconds, or "auto", of --telemetry-offset."""
    if text == "auto":
        return "auto"
    try:
        return float(text)
    except ValueError:
        raise BadInput(
            "--telemetry-offset", expected="a number of seconds, or auto", got=repr(text)
        ) from None
