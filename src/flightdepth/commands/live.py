"""`flightdepth live`: a stream and a flight controller in, depth as it happens."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flightdepth.commands.flight_options import MaskOption
from flightdepth.commands.live_settings import LiveSettings, Mount
from flightdepth.commands.network_options import METHOD, AlignOption, NetworkOption, PrecisionOption

RESULTS = "Results"  # a panel of --help


def live(
    *,
    video: Annotated[
        str,
        typer.Option(metavar="ADDRESS", help="RTSP, RTP, MPEG-TS, camera or file: see above."),
    ],
    mavlink: Annotated[
        str | None,
        typer.Option(
            metavar="LINK",
            help="The autopilot: udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, serial:/dev/X[:BAUD] or "
            "serial:COM3[:BAUD].",
        ),
    ] = None,
    vehicle: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=255,
            metavar="N",
            help="Which vehicle of --mavlink, by its system's number. Default: the first one heard.",
        ),
    ] = None,
    telemetry: Annotated[
        Path | None,
        typer.Option(
            metavar="LOG",
            help="A recorded log, played beside a video file. Default: the one inside it (GoPro), or of its name.",
        ),
    ] = None,
    telemetry_offset: Annotated[
        float, typer.Option(metavar="S", help="Seconds to add to the log's times.")
    ] = 0.0,
    camera: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE|NAME",
            help="Calibration, or a name of `flightdepth cameras`; a file's own lens needs none where it is told.",
        ),
    ] = None,
    hfov: Annotated[
        float | None, typer.Option(metavar="DEG", help="Horizontal field of view, instead of --camera.")
    ] = None,
    mask: MaskOption = None,
    mount: Annotated[
        Mount,
        typer.Option(help="gimbal: stabilised, attitude from the gimbal. fixed: screwed to the drone."),
    ] = "gimbal",
    mount_pitch: Annotated[
        float | None,
        typer.Option(metavar="DEG", help="A fixed camera looks up by DEG (0 ahead, -90 down; without it 0)."),
    ] = None,
    camera_delay_ms: Annotated[
        float,
        typer.Option(
            metavar="MS", help="Milliseconds from exposure to the first byte sent: exposure and encoder."
        ),
    ] = 0.0,
    sender_clock: Annotated[
        bool, typer.Option("--sender-clock", help="Camera and this machine are set by NTP or PTP: use RTCP.")
    ] = False,
    network: NetworkOption = None,
    precision: PrecisionOption = "auto",
    align: AlignOption = True,
    ranges: Annotated[
        int,
        typer.Option(
            metavar="N",
            help="Earlier pictures that each one is paired with at most, 1 to 4; fewer where time is short.",
            rich_help_panel=METHOD,
        ),
    ] = 2,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Also write what `flightdepth run` writes.", rich_help_panel=RESULTS
        ),
    ] = None,
    serve: Annotated[
        str | None,
        typer.Option(
            metavar="HOST:PORT", help="A page to watch, and /metrics for Prometheus.", rich_help_panel=RESULTS
        ),
    ] = None,
    obstacles: Annotated[
        bool,
        typer.Option(
            "--obstacles",
            help="Send OBSTACLE_DISTANCE over --mavlink, and show it on the page.",
            rich_help_panel=RESULTS,
        ),
    ] = False,
    dry_run: Annotated[
        Path | None,
        typer.Option(
            metavar="TLOG",
            help="Write the obstacle messages here instead of sending them; needs no --mavlink.",
            rich_help_panel=RESULTS,
        ),
    ] = None,
    duration: Annotated[
        float | None, typer.Option(metavar="S", help="Stop after so many seconds. Default: Ctrl-C.")
    ] = None,
) -> None:
    """Depth of a live stream, in metres, at a delay that does not grow.

    A camera that speaks RTSP and an autopilot on UDP, with a page to watch:

      flightdepth live --video rtsp://192.168.1.10/main --hfov 80 \\
        --mavlink udpin:0.0.0.0:14550 --serve 127.0.0.1:8080

    A camera on this computer, screwed to the drone, 15 degrees down; the
    autopilot on a serial port hears of obstacles:

      flightdepth live --video /dev/video0 --camera camera.yaml --mount fixed \\
        --mount-pitch -15 --mavlink serial:/dev/ttyAMA0:921600 --obstacles

    A recorded flight as if it were live, sending nothing:

      flightdepth live --video flight.mp4 --telemetry log.csv --hfov 80 \\
        --serve 127.0.0.1:8080

    --video takes rtsp://HOST/PATH (TCP; rtsp+udp:// for UDP),
    rtp://0.0.0.0:5600 (H.264), a .sdp file, udp://0.0.0.0:5600 (MPEG-TS),
    a camera, /dev/videoN (Linux), dshow:NAME (Windows) or avfoundation:NAME
    (macOS), or a file. Health, ages and drops are explained in docs/live.md.
    Ctrl-C ends it.
    """
    from flightdepth.commands.live_session import Session

    Session(
        LiveSettings(
            video=video,
            mavlink=mavlink,
            vehicle=vehicle,
            telemetry=telemetry,
            telemetry_offset=telemetry_offset,
            camera=camera,
            hfov=hfov,
            mask=mask,
            mount=mount,
            mount_pitch=mount_pitch,
            camera_delay_ms=camera_delay_ms,
            sender_clock=sender_clock,
            network=network,
            precision=precision,
            align=align,
            ranges=ranges,
            out=out,
            serve=serve,
            obstacles=obstacles,
            dry_run=dry_run,
            duration=duration,
        )
    ).run()
