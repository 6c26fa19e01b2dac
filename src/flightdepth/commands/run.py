"""`flightdepth run`: flights in, metric depth out."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import typer

from flightdepth.commands.batch import Engine, Job, Outcome, jobs_of, named, run_jobs
from flightdepth.commands.flight_options import (
    CameraOption,
    EndOption,
    HfovOption,
    MaskOption,
    MountPitchOption,
    OffsetOption,
    RateOption,
    StartOption,
    TelemetryOption,
    offset_of,
)
from flightdepth.commands.network_options import METHOD, AlignOption, NetworkOption, PrecisionOption
from flightdepth.commands.ray_option import check_engine
from flightdepth.commands.recorded_options import refuse_name
from flightdepth.commands.run_settings import RunSettings
from flightdepth.commands.signals import stopped_as_by_ctrl_c
from flightdepth.commands.single_flight import run_one
from flightdepth.errors import BadInput, FlightDepthError

SEVERAL = "Several flights"  # a panel of --help
BESIDE = (
    "A log beside each video, with its name (DJI_0001.SRT), is found without --telemetry;"
    " for several files of one recording see docs/telemetry.md."
)


def run(
    flights: Annotated[
        list[Path], typer.Argument(metavar="FLIGHT", help="Stabilised video, or a folder of pictures.")
    ],
    *,
    telemetry: TelemetryOption = None,
    telemetry_offset: OffsetOption = "0",
    camera: CameraOption = None,
    hfov: HfovOption = None,
    mask: MaskOption = None,
    mount_pitch: MountPitchOption = None,
    speed: Annotated[
        float | None,
        typer.Option(metavar="M_S", help="Constant speed in m/s, any direction, where there is no log."),
    ] = None,
    start: StartOption = None,
    end: EndOption = None,
    rate: RateOption = None,
    network: NetworkOption = None,
    ranges: Annotated[
        int,
        typer.Option(
            metavar="N",
            help="Earlier pictures that each one is paired with, 1 to 4. Three know more far pixels, "
            "in half as much time again.",
        ),
    ] = 2,
    detail: Annotated[
        float,
        typer.Option(
            metavar="TIMES",
            help="How much finer the network looks, 0.2 to 5, up to the video's own pixels: 2 takes four times as "
            "long. Networks for any lens only.",
        ),
    ] = 1.0,
    precision: PrecisionOption = "auto",
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Output folder; a sub-folder each for several flights.")
    ] = Path("out"),
    depth_format: Annotated[
        Literal["png", "npz"], typer.Option(help="png: centimetres, up to 655.35 m. npz: float32 metres.")
    ] = "png",
    preview_ranges: Annotated[
        bool, typer.Option("--preview-ranges", help="Show the depth of each pair in the preview, too.")
    ] = False,
    fusion: Annotated[
        Literal["saturation", "paper"],
        typer.Option(
            metavar="HOW",
            help="saturation: ends of a range are bounds, not depths. paper: as published.",
            rich_help_panel=METHOD,
        ),
    ] = "saturation",
    derotate: Annotated[
        bool,
        typer.Option(
            help="Take out of each pair what rotation and wrong direction its two pictures show.",
            rich_help_panel=METHOD,
        ),
    ] = True,
    align: AlignOption = True,
    fallback: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="A DepthNet for frames whose direction of motion is unknown, which else have no depth; "
            "rough: see docs/motionnet.md.",
            rich_help_panel=METHOD,
        ),
    ] = None,
    engine: Annotated[
        Engine,
        typer.Option(
            help="local: one flight after the other; ray: many at once, on a Ray cluster.",
            rich_help_panel=SEVERAL,
        ),
    ] = "local",
    address: Annotated[
        str | None,
        typer.Option(
            metavar="HOST:PORT|auto",
            help="The Ray cluster; without it, one on this machine.",
            rich_help_panel=SEVERAL,
        ),
    ] = None,
) -> None:
    """Depth of every frame of one or more flights, in metres.

    Each output folder holds depth/, confidence/, sigma/, bounds, frames.csv,
    poses.csv, flight.json and preview.mp4. It appears when all of it stands;
    after an error there is none.

    A video that carries its own telemetry (GoPro), which tells the lens too
    where the camera turns:

      flightdepth run flight.mp4

    A log and a calibration:

      flightdepth run flight.mp4 --telemetry log.csv --camera camera.yaml

    Neither log nor calibration, ten seconds of it:

      flightdepth run flight.mp4 --speed 5 --hfov 80 --start 10 --end 20

    A folder of pictures, 20 a second:

      flightdepth run images --rate 20 --telemetry log.csv --hfov 90

    Several flights, each into its own folder (depth/a, depth/b):

      flightdepth run a.mp4 b.mp4 --hfov 73 --out depth

    Stopped (Ctrl-C)? What was flown of a single flight stays, in
    DIR.interrupted-1, and a line says with which --start to go on; after a
    kill the next run into DIR does both. Of several flights the same command
    skips those that stand, and begins anew with the one that was under way. On
    many machines that share a disk: --engine ray --address auto. A single
    flight replaces what an earlier run left in its folder, once it is done.

    How to load the files: docs/files.md. Which camera to give: docs/cameras.md.
    """
    from flightdepth.ranges.estimator import check_ranges

    check_engine("flightdepth run", engine, address)
    for path in flights:
        refuse_name("flight", named(path).name)
    several = len(flights) > 1
    if several and telemetry is not None:
        raise BadInput(
            "--telemetry", expected="one flight with it", got=f"{len(flights)} flights", mend=BESIDE
        )
    if several:
        refuse_logs(flights)
    check_ranges(ranges)
    settings = RunSettings(
        telemetry=telemetry,
        camera=camera,
        hfov=hfov,
        mask=mask,
        network=network,
        ranges=ranges,
        speed=speed,
        start=start,
        end=end,
        rate=rate,
        depth_format=depth_format,
        preview_ranges=preview_ranges,
        fusion=fusion,
        telemetry_offset=offset_of(telemetry_offset),
        mount_pitch=mount_pitch,
        derotate=derotate,
        align=align,
        fallback=fallback,
        precision=precision,
        detail=detail,
    )
    with stopped_as_by_ctrl_c():
        if several or engine == "ray":
            jobs = jobs_of(flights, out) if several else [Job(flights[0], out)]
            one = partial(run_one, settings=settings.anywhere(), resume=several)
            if worst := run_jobs(jobs, one, engine, address):
                raise typer.Exit(worst)
        elif run_one(flights[0], out, settings) is Outcome.EMPTY:
            raise typer.Exit(FlightDepthError.exit_code)


def refuse_logs(flights: list[Path]) -> None:
    """Refuse a log among several flights, before the first of them is flown."""
    from flightdepth.flight.telemetry import is_log

    for path in flights:
        if path.is_file() and is_log(path):  # a folder of pictures may look like a bag
            mend = f"Give it as --telemetry {path}." if len(flights) == 2 else BESIDE
            raise BadInput(f"flight {path}", expected="a video", got="a log", mend=mend)
