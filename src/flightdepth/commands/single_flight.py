"""One flight of `flightdepth run`: what is said before it, its depth into its folder, what is said after it."""

from __future__ import annotations

import math
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from flightdepth.commands.batch import Outcome, named
from flightdepth.commands.full_disk import room_on_the_disk
from flightdepth.commands.network_options import check_align, precision_of
from flightdepth.commands.run_settings import RunSettings
from flightdepth.commands.signals import heed_interrupt, interrupts_heeded
from flightdepth.commands.terminal import progress_bar, say, warn
from flightdepth.errors import BadInput

if TYPE_CHECKING:
    from flightdepth.camera import Camera
    from flightdepth.flight import Flight, Frame
    from flightdepth.outputs import Source, Summary
    from flightdepth.outputs.record import FlightRecord
    from flightdepth.outputs.run import Progress
    from flightdepth.ranges import RangedDepth
    from flightdepth.runtimes.network import Network


def run_one(path: Path, target: Path, settings: RunSettings, *, resume: bool = False) -> Outcome:
    """One flight into `target`; with `resume`, not again where the same result stands."""
    from flightdepth.flight import open_flight
    from flightdepth.outputs.interrupted import check_alone, keep_interrupted
    from flightdepth.outputs.writer import check_target
    from flightdepth.runtimes.network import load_network, nearest_network

    check_target(target)
    check_alone(target)
    for place in keep_interrupted(target):
        warn(f"an earlier run was killed: {what_stands(place)}")
    name = named(path).name
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
        mask=settings.mask,
        rate_hz=settings.rate,
    ) as flight:
        network = load_network(
            settings.network or nearest_network(flight.camera),
            precision=precision_of(settings.precision),
            aligned=settings.align,
        ).finer(settings.detail)
        check_options(network, settings)
        source = source_of(name, flight, network, settings)
        if resume and (found := standing(target, source)) is not None:
            return Outcome.STOOD if found.counts.frames_with_depth else Outcome.STOOD_EMPTY
        introduce(path, flight, network)
        if (other := other_flight(target, name, flight.video_bytes)) is not None:
            warn(f"{target} holds the result of {other}, which this one replaces when it is done")
        started = time.monotonic()
        summary = write_depth(source, flight, network, target, settings, keeps=not resume)
        elapsed_s = time.monotonic() - started
    conclude(summary, elapsed_s, target)
    return Outcome.DONE if summary.counts.frames_with_depth else Outcome.EMPTY


def introduce(path: Path, flight: Flight, network: Network) -> None:
    """Say what is about to run, and where the network sees too little of the picture."""
    camera, grid = flight.camera, network.grid(flight.camera)
    say(
        f"{path}: {camera.width}x{camera.height}, focal length {camera.fx:.0f} px"
        f" -> {network.card.name} at {grid.camera.width}x{grid.camera.height}; {flight.telemetry_name}"
    )
    say(f"camera: {flight.camera_source}")
    if flight.mask is not None:
        say(f"mask: {flight.mask}")
    if flight.clock is not None and flight.clock.offset_s is not None:  # else a warning says why
        say(f"offset between video and log: {flight.clock}")
    if flight.utc is not None:
        say(f"universal time of the first picture: {flight.utc}, if {sure_if(flight)}")
    for line in warnings_of(flight, network):
        warn(line)


def sure_if(flight: Flight) -> str:
    """What must be so for a flight's universal time to be right, beside the clock that told it."""
    if flight.utc is not None and flight.utc.clock == "names":
        return "whoever named them had the right time"
    return (
        "video and log began together"
        if flight.begun_together
        else "the offset between video and log is right"
    )


def write_depth(
    source: Source,
    flight: Flight,
    network: Network,
    target: Path,
    settings: RunSettings,
    *,
    watch: Progress | None = None,
    keeps: bool = False,
) -> Summary:
    """Depth of an open flight into `target`, with a progress bar; `watch` sees each frame and its result.

    keeps  whether what was flown stays where Ctrl-C ends it
    """
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
        mask=None if flight.mask is None else flight.mask.shown,
    )
    preview = Preview(
        camera.width,
        camera.height,
        range_panels=ranges if settings.preview_ranges else 0,
        to_source=estimator.to_source if settings.preview_ranges else None,
    )
    network.warm_up(network.grid(camera).camera, ranges)

    def progress(frame: Frame, result: RangedDepth) -> None:
        heed_interrupt()
        bar.step()
        if watch is not None:
            watch(frame, result)

    writer = FlightWriter(target, source, preview, depth_format=settings.depth_format, stopped=keeps)
    try:
        with (
            room_on_the_disk(target, left="nothing of this flight was written"),
            writer,
            progress_bar(source.flight, flight.frame_count_hint, "frames") as bar,
            interrupts_heeded(),
        ):
            run_flight(flight, estimator, writer, progress)
    except KeyboardInterrupt:
        if writer.kept is None:
            warn(f"stopped: nothing of this flight was written, and {target} is as it was")
        else:
            warn(f"stopped: {what_stands(writer.kept)}")
        raise
    return writer.summary


def what_stands(folder: Path) -> str:
    """Where an interrupted flight stands, and the option that flies what it did not come to."""
    from flightdepth.flight.records import NS_PER_S
    from flightdepth.outputs import FlightFolder

    where = f"what was flown stands in {folder}"
    try:
        last = FlightFolder(folder).rows[-1]
    except (BadInput, IndexError):  # power was lost before it came to the disk
        return where
    return f"{where}; --start {last.stamp_ns / NS_PER_S:.2f} goes on from there"


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
        if math.isfinite(summary.sigma_share_median):
            say(
                f"error bar: {summary.sigma_share_median:.1%} of the depth in the median, meant to hold two errors"
                " in three; a wrong lens is not in it, nor a speed that is wrong throughout"
            )
    else:
        warn("no frame has depth: the reasons stand above")
    say(f"preview: {target / 'preview.mp4'}")


def source_of(name: str, flight: Flight, network: Network, settings: RunSettings) -> Source:
    """What is run, and with what."""
    from flightdepth.outputs import Source

    return Source(
        flight=name,
        video_bytes=flight.video_bytes,
        telemetry=flight.telemetry_name,
        telemetry_digest=flight.telemetry_digest,
        altitude_above=None if flight.places is None else flight.places.above,
        true_north=flight.true_north,
        camera=flight.camera,
        camera_source=flight.camera_source,
        mask_digest=None if flight.mask is None else flight.mask.digest,
        clock=flight.clock,
        utc=flight.utc,
        network=network.card,
        settings=settings.for_record,
        warnings=warnings_of(flight, network),
    )


def warnings_of(flight: Flight, network: Network) -> tuple[str, ...]:
    """What the user should know before the flight is run, a line each."""
    narrow = network.grid(flight.camera).warning
    return flight.warnings if narrow is None else (*flight.warnings, narrow + closer(network, flight.camera))


def closer(network: Network, camera: Camera) -> str:
    """What sees a narrow picture finer, where it has more pixels than the network takes."""
    if network.focal_px(camera) >= camera.fx:
        return ""
    return f"; `{'--detail 2' if network.card.any_lens else '--network motion'}` looks closer"


def check_options(network: Network, settings: RunSettings) -> None:
    """Refuse what a frame would find out too late, or would do nothing."""
    from flightdepth.weights.store import find_network, read_card

    check_align(network.card, align=settings.align)
    if settings.fallback is None:
        return
    if not network.card.knows_direction:
        expected = "a network beside it that needs the direction"
        raise BadInput("--fallback", expected=expected, got=f"--network {network.card.name}")
    if read_card(find_network(settings.fallback)).knows_direction:
        expected = "a network that needs no direction, a DepthNet"
        raise BadInput("--fallback", expected=expected, got=settings.fallback)


def standing(target: Path, source: Source) -> FlightRecord | None:
    """What a finished result of the same says of itself, where `target` holds one."""
    from flightdepth import __version__

    record = record_in(target)
    if record is None or record.flightdepth != __version__ or not record.whole:
        return None
    # Some warnings come up in flight only.
    known, wanted = (each.model_dump(exclude={"warnings"}) for each in (record.source, source))
    return record if known == wanted else None


def other_flight(target: Path, name: str, video_bytes: int) -> str | None:
    """The flight whose result `target` holds, where it is another one: cameras begin to count anew on each card."""
    record = record_in(target)
    if record is None or (record.source.flight, record.source.video_bytes) == (name, video_bytes):
        return None
    return record.source.flight if record.source.flight != name else f"another {name}"


def record_in(target: Path) -> FlightRecord | None:
    """What `flight.json` in `target` says, where a finished result stands there."""
    from flightdepth.outputs import FlightFolder

    try:
        return FlightFolder(target).record
    except BadInput:
        return None
