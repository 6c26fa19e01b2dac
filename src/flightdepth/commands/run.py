"""`flightdepth run`: flights in, metric depth out."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from flightdepth.commands.terminal import progress_bar, report, say, warn
from flightdepth.errors import BadInput, FlightDepthError

if TYPE_CHECKING:
    from flightdepth.flight import Flight, Frame
    from flightdepth.outputs import Summary
    from flightdepth.outputs.run import Progress
    from flightdepth.ranges import RangedDepth
    from flightdepth.runtimes.network import Network


@dataclass(frozen=True)
class RunSettings:
    """The options of `flightdepth run` that hold for each of its flights."""

    telemetry: Path | None
    camera: Path | None
    hfov: float | None
    network: str | None
    ranges: int
    speed: float | None
    start: float | None
    end: float | None
    depth_format: Literal["png", "npz"]
    preview_ranges: bool
    fusion: Literal["saturation", "paper"]
    telemetry_offset: float = 0.0


def run(
    flights: Annotated[list[Path], typer.Argument(metavar="FLIGHT", help="Stabilised video.")],
    *,
    telemetry: Annotated[
        Path | None,
        typer.Option(metavar="LOG", help="Velocity log. Without it, the GPMF track inside the video."),
    ] = None,
    telemetry_offset: Annotated[
        float, typer.Option(metavar="S", help="Seconds added to the log's times: 0 is the first picture.")
    ] = 0.0,
    camera: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Calibration: OpenCV, ROS or JSON.")
    ] = None,
    hfov: Annotated[
        float | None, typer.Option(metavar="DEG", help="Horizontal field of view, instead of --camera.")
    ] = None,
    network: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="See `flightdepth networks`; or an ONNX file. Default: the nearest."
        ),
    ] = None,
    ranges: Annotated[int, typer.Option(metavar="N", help="Frame pairs a frame, 1 to 4.")] = 2,
    speed: Annotated[
        float | None,
        typer.Option(metavar="M_S", help="Constant speed straight ahead, where there is no log."),
    ] = None,
    start: Annotated[
        float | None, typer.Option(metavar="S", help="First second of the video to use.")
    ] = None,
    end: Annotated[float | None, typer.Option(metavar="S", help="Second of the video to stop at.")] = None,
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Output folder; a sub-folder each for several.")
    ] = Path("out"),
    depth_format: Annotated[
        Literal["png", "npz"], typer.Option(help="png: centimetres, up to 655.35 m. npz: float32 metres.")
    ] = "png",
    preview_ranges: Annotated[
        bool, typer.Option("--preview-ranges", help="Show each range in the preview.")
    ] = False,
    fusion: Annotated[
        Literal["saturation", "paper"],
        typer.Option(help="saturation: ends of a range are bounds, not depths. paper: as published."),
    ] = "saturation",
) -> None:
    """Depth of every frame of one or more flights, in metres.

    Each output folder holds depth/, confidence/, frames.csv, flight.json and
    preview.mp4. It appears when all of it stands; after an error there is none.

    A video that carries its own telemetry (GoPro):

      flightdepth run flight.mp4 --hfov 64.4

    A log and a calibration:

      flightdepth run flight.mp4 --telemetry log.csv --camera camera.yaml

    Neither log nor calibration, ten seconds of it:

      flightdepth run flight.mp4 --speed 5 --hfov 80 --start 10 --end 20

    Several flights, each into its own folder (depth/a, depth/b):

      flightdepth run a.mp4 b.mp4 --hfov 64.4 --out depth
    """
    settings = RunSettings(
        telemetry,
        camera,
        hfov,
        network,
        ranges,
        speed,
        start,
        end,
        depth_format,
        preview_ranges,
        fusion,
        telemetry_offset,
    )
    if len(flights) == 1:
        run_one(flights[0], out, settings)
    else:
        run_several(flights, out, settings)


def run_several(flights: Sequence[Path], out: Path, settings: RunSettings) -> None:
    """Run each flight into its own folder; one that fails is reported and does not stop the others."""
    if settings.telemetry is not None:
        raise BadInput("--telemetry", expected="one flight with it", got=f"{len(flights)} flights")
    worst = 0
    for flight, target in zip(flights, sub_folders(flights, out), strict=True):
        try:
            run_one(flight, target, settings)
        except FlightDepthError as error:
            report(error)
            worst = max(worst, error.exit_code)
    if worst:
        raise typer.Exit(worst)


def sub_folders(flights: Sequence[Path], out: Path) -> list[Path]:
    """A folder in `out` for each flight, named after it; the second of a name gets -2, and so on."""
    seen: Counter[str] = Counter()
    folders = []
    for flight in flights:
        seen[flight.stem] += 1
        number = seen[flight.stem]
        folders.append(out / (flight.stem if number == 1 else f"{flight.stem}-{number}"))
    return folders


def run_one(path: Path, target: Path, settings: RunSettings) -> None:
    """One flight into `target`."""
    from flightdepth.flight import open_flight
    from flightdepth.runtimes.network import load_network, nearest_network

    with open_flight(
        path,
        settings.telemetry,
        settings.camera,
        telemetry_offset_s=settings.telemetry_offset,
        speed_m_s=settings.speed,
        hfov_deg=settings.hfov,
        start_s=settings.start,
        end_s=settings.end,
    ) as flight:
        network = load_network(settings.network or nearest_network(flight.camera))
        introduce(path, flight, network)
        started = time.monotonic()
        summary = write_depth(path.name, flight, network, target, settings)
        elapsed_s = time.monotonic() - started
    conclude(summary, elapsed_s, target)


def write_depth(
    name: str,
    flight: Flight,
    network: Network,
    target: Path,
    settings: RunSettings,
    *,
    watch: Progress | None = None,
) -> Summary:
    """Depth of an open flight into `target`, with a progress bar; `watch` sees each frame and its result."""
    from flightdepth.outputs import FlightWriter, Preview, Source, run_flight
    from flightdepth.ranges import MultiRangeEstimator

    camera, ranges = flight.camera, settings.ranges
    grid = network.grid(camera)
    estimator = MultiRangeEstimator(network, camera, ranges=ranges, fusion=settings.fusion)
    preview = Preview(
        camera.width,
        camera.height,
        range_panels=ranges if settings.preview_ranges else 0,
        to_source=grid.to_source if settings.preview_ranges else None,
    )
    options = {
        key: str(value) if isinstance(value, Path) else value for key, value in asdict(settings).items()
    }
    source = Source(
        flight=name, telemetry=flight.telemetry_name, camera=camera, network=network.card, settings=options
    )
    network.warm_up(grid.camera, ranges)

    def progress(frame: Frame, result: RangedDepth) -> None:
        bar.advance(bar.task_ids[0])
        if watch is not None:
            watch(frame, result)

    with (
        FlightWriter(target, source, preview, depth_format=settings.depth_format) as writer,
        progress_bar(name, flight.frame_count_hint, "frames") as bar,
    ):
        run_flight(flight, estimator, writer, progress)
    return writer.summary


def introduce(path: Path, flight: Flight, network: Network) -> None:
    """Say what is about to run, and where the network sees too little of the picture."""
    camera, grid = flight.camera, network.grid(flight.camera)
    say(
        f"{path}: {camera.width}x{camera.height}, focal length {camera.fx:.0f} px"
        f" -> {network.card.name} at {grid.camera.width}x{grid.camera.height}; {flight.telemetry_name}"
    )
    if grid.warning is not None:
        warn(grid.warning)


def conclude(summary: Summary, elapsed_s: float, target: Path) -> None:
    """Say what came of it, and where it lies."""
    counts = summary.counts
    say(
        f"{counts.frames} frames in {elapsed_s:.1f} s ({counts.frames / elapsed_s:.1f} frames/s),"
        f" {counts.frames_with_depth} with depth"
    )
    for reason, frames in counts.frames_without_depth.items():
        say(f"  {frames} without: {reason}")
    for reason, dropped in counts.dropped.items():
        say(f"  {dropped} dropped: {reason}")
    for note in summary.notes:
        say(f"  note: {note}")
    if counts.frames_with_depth:
        say(
            f"median frame: depth at {summary.valid_fraction_median:.0%} of the pixels;"
            f" latency {summary.latency_median_ms:.1f} ms median, {summary.latency_p95_ms:.1f} ms p95"
        )
    say(f"preview: {target / 'preview.mp4'}")
