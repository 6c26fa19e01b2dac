"""`flightdepth run`: flights in, metric depth out."""

from __future__ import annotations

import signal
import time
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from flightdepth.commands.batch import Engine, Job, Outcome, jobs_of, run_jobs
from flightdepth.commands.precision_option import NetworkPrecision, PrecisionOption
from flightdepth.commands.ray_option import check_engine
from flightdepth.commands.terminal import progress_bar, say, warn
from flightdepth.errors import BadInput, FlightDepthError

if TYPE_CHECKING:
    from flightdepth.flight import Flight, Frame
    from flightdepth.outputs import Source, Summary
    from flightdepth.outputs.record import FlightRecord
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
    telemetry_offset: float | Literal["auto"] = 0.0
    mount_pitch: float | None = None
    derotate: bool = True
    align: bool = True
    fallback: str | None = None
    precision: NetworkPrecision = NetworkPrecision.AUTO
    detail: float = 1.0

    def anywhere(self) -> RunSettings:
        """The same, with paths that hold from any folder."""
        found: dict[str, Any] = {
            key: value.absolute()
            for key, value in asdict(self).items()
            if isinstance(value, Path) and value.exists()
        }
        for name in ("network", "fallback"):
            given = getattr(self, name)
            if given is not None and Path(given).exists():
                found[name] = str(Path(given).absolute())
        return replace(self, **found)


def run(
    flights: Annotated[list[Path], typer.Argument(metavar="FLIGHT", help="Stabilised video.")],
    *,
    telemetry: Annotated[
        Path | None,
        typer.Option(
            metavar="LOG",
            help="Flight log. Without it, the video's own track, or a log of the video's name beside it.",
        ),
    ] = None,
    telemetry_offset: Annotated[
        str,
        typer.Option(
            metavar="S|auto",
            help="Seconds added to the log's times: 0 is the first picture. auto: as the pictures tell.",
        ),
    ] = "0",
    camera: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE|NAME",
            help="Calibration (OpenCV, ROS, JSON), a photograph, or a name of `flightdepth cameras`. "
            "Without it, what the video tells.",
        ),
    ] = None,
    hfov: Annotated[
        float | None, typer.Option(metavar="DEG", help="Horizontal field of view, instead of --camera.")
    ] = None,
    mount_pitch: Annotated[
        float | None,
        typer.Option(
            metavar="DEG",
            help="The camera is screwed to the drone and looks up by DEG (0 ahead, -90 down): use its attitude.",
        ),
    ] = None,
    network: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="See `flightdepth networks`; or an ONNX file. Default: one for any lens."
        ),
    ] = None,
    ranges: Annotated[
        int,
        typer.Option(
            metavar="N",
            help="Frame pairs a frame, 1 to 4. Three know more far pixels, at half as much again.",
        ),
    ] = 2,
    speed: Annotated[
        float | None,
        typer.Option(metavar="M_S", help="Constant speed, any direction, where there is no log."),
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
    derotate: Annotated[
        bool,
        typer.Option(help="Take out of each pair what rotation and wrong direction its two pictures show."),
    ] = True,
    align: Annotated[
        bool,
        typer.Option(
            help="Align depth with the pictures by optical flow; without it: rougher, sooner. "
            "Only networks that know the direction do."
        ),
    ] = True,
    fallback: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="A DepthNet for frames whose direction of motion is unknown, which else have no depth; "
            "rough (docs/networks.md).",
        ),
    ] = None,
    precision: PrecisionOption = NetworkPrecision.AUTO,
    detail: Annotated[
        float,
        typer.Option(
            metavar="TIMES",
            help="How much finer the network looks, up to the video's own pixels: 2 takes four times as long. "
            "Networks for any lens only.",
        ),
    ] = 1.0,
    engine: Annotated[
        Engine, typer.Option(help="local: one flight after the other; ray: many at once, on a Ray cluster.")
    ] = Engine.LOCAL,
    address: Annotated[
        str | None,
        typer.Option(metavar="HOST:PORT|auto", help="The Ray cluster; without it, one on this machine."),
    ] = None,
) -> None:
    """Depth of every frame of one or more flights, in metres.

    Each output folder holds depth/, confidence/, sigma/, bounds, frames.csv, poses.csv, flight.json
    and preview.mp4. It appears when all of it stands; after an error there is none.

    A video that carries its own telemetry (GoPro), which tells the lens too where the camera turns:

      flightdepth run flight.mp4

    A log and a calibration:

      flightdepth run flight.mp4 --telemetry log.csv --camera camera.yaml

    Neither log nor calibration, ten seconds of it:

      flightdepth run flight.mp4 --speed 5 --hfov 80 --start 10 --end 20

    Several flights, each into its own folder (depth/a, depth/b):

      flightdepth run a.mp4 b.mp4 --hfov 73 --out depth

    Stopped or killed? The same command skips the flights that stand. On many machines
    that share a disk: --engine ray --address auto. A single flight replaces what an earlier
    run left in its folder, once it is done.
    """
    from flightdepth.ranges.estimator import check_ranges

    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C: what was begun is cleared away
    check_engine("flightdepth run", engine, address)
    several = len(flights) > 1
    if several and telemetry is not None:
        mend = "A log beside each video, with its name (DJI_0001.SRT), is found without --telemetry."
        raise BadInput("--telemetry", expected="one flight with it", got=f"{len(flights)} flights", mend=mend)
    check_ranges(ranges)
    settings = RunSettings(
        telemetry=telemetry,
        camera=camera,
        hfov=hfov,
        network=network,
        ranges=ranges,
        speed=speed,
        start=start,
        end=end,
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
    jobs = jobs_of(flights, out) if several else [Job(flights[0], out)]
    if several or engine is Engine.RAY:
        one = partial(run_one, settings=settings.anywhere(), resume=several)
        if worst := run_jobs(jobs, one, engine, address):
            raise typer.Exit(worst)
    elif run_one(flights[0], out, settings) is Outcome.EMPTY:
        raise typer.Exit(FlightDepthError.exit_code)


def run_one(path: Path, target: Path, settings: RunSettings, *, resume: bool = False) -> Outcome:
    """One flight into `target`; with `resume`, not again where the same result stands."""
    from flightdepth.flight import open_flight
    from flightdepth.outputs.writer import check_target
    from flightdepth.runtimes.network import load_network, nearest_network

    check_target(target)
    with open_flight(
        path,
        settings.telemetry,
        settings.camera,
        telemetry_offset_s=settings.telemetry_offset,
        speed_m_s=settings.speed,
        hfov_deg=settings.hfov,
        mount_pitch_deg=settings.mount_pitch,
        start_s=settings.start,
        end_s=settings.end,
    ) as flight:
        network = load_network(
            settings.network or nearest_network(flight.camera),
            precision=settings.precision.chosen,
            aligned=settings.align,
        ).finer(settings.detail)
        check_fallback(settings.fallback)
        if resume and stands(target, source_of(path.name, flight, network, settings)):
            return Outcome.STOOD
        introduce(path, flight, network)
        if (other := other_flight(target, path.name)) is not None:
            warn(f"{target} holds the result of {other}, which this one replaces when it is done")
        started = time.monotonic()
        summary = write_depth(path.name, flight, network, target, settings)
        elapsed_s = time.monotonic() - started
    conclude(summary, elapsed_s, target)
    return Outcome.DONE if summary.counts.frames_with_depth else Outcome.EMPTY


def check_fallback(name: str | None) -> None:
    """Refuse one that does not exist, or needs the direction too, before a frame needs it."""
    from flightdepth.weights.store import find_network, read_card

    if name is not None and read_card(find_network(name)).knows_direction:
        raise BadInput("--fallback", expected="a network that needs no direction, a DepthNet", got=name)


def offset_of(text: str) -> float | Literal["auto"]:
    """Seconds, or "auto"."""
    if text == "auto":
        return "auto"
    try:
        return float(text)
    except ValueError:
        raise BadInput(
            "--telemetry-offset", expected="a number of seconds, or auto", got=repr(text)
        ) from None


def source_of(name: str, flight: Flight, network: Network, settings: RunSettings) -> Source:
    """What is run, and with what."""
    from flightdepth.outputs import Source

    options = {
        key: str(value) if isinstance(value, Path) else value for key, value in asdict(settings).items()
    }
    return Source(
        flight=name,
        video_bytes=flight.video_bytes,
        telemetry=flight.telemetry_name,
        telemetry_digest=flight.telemetry_digest,
        camera=flight.camera,
        camera_source=flight.camera_source,
        clock=flight.clock,
        network=network.card,
        settings=options,
        warnings=warnings_of(flight, network),
    )


def warnings_of(flight: Flight, network: Network) -> tuple[str, ...]:
    """What the user should know before the flight is run, a line each."""
    narrow = network.grid(flight.camera).warning
    return flight.warnings if narrow is None else (*flight.warnings, narrow)


def stands(target: Path, source: Source) -> bool:
    """Whether `target` holds a finished result of the same."""
    from flightdepth import __version__

    record = record_in(target)
    if record is None:
        return False
    known, wanted = (each.model_dump(exclude={"warnings"}) for each in (record.source, source))
    return record.flightdepth == __version__ and known == wanted  # some warnings come up in flight only


def other_flight(target: Path, name: str) -> str | None:
    """The flight whose result `target` holds, where it is another one."""
    record = record_in(target)
    return None if record is None or record.source.flight == name else record.source.flight


def record_in(target: Path) -> FlightRecord | None:
    """What `flight.json` in `target` says, where a finished result stands there."""
    from flightdepth.outputs import FlightFolder

    try:
        return FlightFolder(target).record
    except BadInput:
        return None


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
    from flightdepth.outputs import FlightWriter, Preview, run_flight
    from flightdepth.ranges import MultiRangeEstimator
    from flightdepth.runtimes.network import load_network

    camera, ranges = flight.camera, settings.ranges
    estimator = MultiRangeEstimator(
        network,
        camera,
        ranges=ranges,
        fusion=settings.fusion,
        derotate=settings.derotate,
        fallback=None if settings.fallback is None else partial(load_network, settings.fallback),
    )
    preview = Preview(
        camera.width,
        camera.height,
        range_panels=ranges if settings.preview_ranges else 0,
        to_source=estimator.to_source if settings.preview_ranges else None,
    )
    source = source_of(name, flight, network, settings)
    network.warm_up(network.grid(camera).camera, ranges)

    def progress(frame: Frame, result: RangedDepth) -> None:
        bar.advance(bar.task_ids[0])
        if watch is not None:
            watch(frame, result)

    try:
        with (
            FlightWriter(target, source, preview, depth_format=settings.depth_format) as writer,
            progress_bar(name, flight.frame_count_hint, "frames") as bar,
        ):
            run_flight(flight, estimator, writer, progress)
    except KeyboardInterrupt:
        warn(f"stopped: nothing of this flight was written, and {target} is as it was")
        raise
    return writer.summary


def introduce(path: Path, flight: Flight, network: Network) -> None:
    """Say what is about to run, and where the network sees too little of the picture."""
    camera, grid = flight.camera, network.grid(flight.camera)
    say(
        f"{path}: {camera.width}x{camera.height}, focal length {camera.fx:.0f} px"
        f" -> {network.card.name} at {grid.camera.width}x{grid.camera.height}; {flight.telemetry_name}"
    )
    say(f"camera: {flight.camera_source}")
    if flight.clock is not None:
        say(f"offset between video and log: {flight.clock}")
    for line in warnings_of(flight, network):
        warn(line)


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
    for line in summary.warnings:
        warn(line)
    if counts.frames_with_depth:
        say(
            f"median frame: depth at {summary.valid_fraction_median:.0%} of the pixels;"
            f" latency {summary.latency_median_ms:.1f} ms median, {summary.latency_p95_ms:.1f} ms p95"
        )
    else:
        warn("no frame has depth: the reasons stand above")
    say(f"preview: {target / 'preview.mp4'}")
