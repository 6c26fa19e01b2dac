"""Options of every command that flies a recorded video: its log, its lens, the part of it to use."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

TelemetryOption = Annotated[
    Path | None,
    typer.Option(
        metavar="LOG",
        help="Flight log of PX4, ArduPilot, MAVLink, DJI, Parrot, ROS, GPX, CSV, or a trajectory (TUM): told by what "
        "is in it. Without it, the video's own track (GoPro, DJI), or a log of its name beside it.",
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
