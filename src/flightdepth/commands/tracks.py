"""`flightdepth evaluate tracks`: the scale of depth on a flight without ground truth."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

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
from flightdepth.commands.terminal import counted, say
from flightdepth.errors import BadInput

if TYPE_CHECKING:
    from flightdepth.evaluation.tracked_points import TrackedPoints
    from flightdepth.flight import Flight
    from flightdepth.flight.records import Sample
    from flightdepth.ranges import MultiRangeEstimator

DEPTH_BINS = ((0.0, 15.0), (15.0, 30.0), (30.0, 60.0), (60.0, 120.0))


def tracks(
    flight: Annotated[
        Path, typer.Argument(metavar="FLIGHT", help="Video or pictures of a flight straight ahead.")
    ],
    *,
    telemetry: TelemetryOption = None,
    telemetry_offset: OffsetOption = "0",
    camera: CameraOption = None,
    hfov: HfovOption = None,
    mask: MaskOption = None,
    mount_pitch: MountPitchOption = None,
    start: StartOption = None,
    end: EndOption = None,
    rate: RateOption = None,
    network: Annotated[
        str | None, typer.Option(metavar="NAME", help="As of `flightdepth run`. Default: motion.")
    ] = None,
    ranges: Annotated[
        int, typer.Option(metavar="N", help="Earlier pictures that each one is paired with, 1 to 4.")
    ] = 2,
    least_span: Annotated[
        float, typer.Option(metavar="M", help="Metres flown over which a point must be seen.")
    ] = 3.0,
) -> None:
    """Slope of the depth of tracked points against metres flown, by how far away they began.

    A rigid point straight ahead comes 1 m nearer with each metre flown, so the
    slope is -1 where depth is true to scale; -0.8 means 20 % too near.

      flightdepth evaluate tracks flight.mp4 --hfov 73
    """
    from flightdepth.evaluation.provenance import origin_of
    from flightdepth.evaluation.tracked_points import TrackedPoints
    from flightdepth.flight import open_flight
    from flightdepth.ranges import MultiRangeEstimator
    from flightdepth.runtimes.network import load_network, nearest_network

    if not 0 <= least_span < float("inf"):
        raise BadInput("--least-span", expected="0 m or more", got=f"{least_span:g}")
    points = TrackedPoints()
    with open_flight(
        flight,
        telemetry,
        camera,
        telemetry_offset_s=offset_of(telemetry_offset),
        hfov_deg=hfov,
        mount_pitch_deg=mount_pitch,
        start_s=start,
        end_s=end,
        mask=mask,
        rate_hz=rate,
    ) as opened:
        chosen = load_network(network or nearest_network(opened.camera))
        shown = None if opened.mask is None else opened.mask.shown
        estimator = MultiRangeEstimator(chosen, opened.camera, ranges=ranges, mask=shown)
        _follow(opened, estimator, points)
    say(f"{flight.name}, {chosen.card.name}, {ranges} ranges; slope of depth per metre flown (ideal -1)")
    found = points.slopes(least_span_m=least_span)
    for near, far in (*DEPTH_BINS, (0.0, float("inf"))):
        part = found.between(near, far)
        what = "all" if far == float("inf") else f"{near:g}-{far:g} m"
        interval = f"{part.median:6.2f}  [{part.low:.2f}, {part.high:.2f}]" if len(part.slopes) else "     -"
        say(f"  began {what:>9}: {interval}  {len(part.slopes)} points")
    say(origin_of(chosen))


def _follow(flight: Flight, estimator: MultiRangeEstimator, points: TrackedPoints) -> None:
    """Run the estimator over the flight and give every depth map to `points`, with the metres flown."""
    import numpy as np

    from flightdepth.evaluation.tracked_points import PathLength
    from flightdepth.flight import VelocitySample
    from flightdepth.outputs.run import depths

    path = PathLength()

    def fly(sample: Sample) -> None:
        if isinstance(sample, VelocitySample):
            path.add(sample.stamp_ns, float(np.linalg.norm(sample.velocity)))

    flown = depths(flight, estimator, on_sample=fly)
    for frame, result in counted(flown, "tracking", "frames", total=flight.frame_count_hint):
        flown_m = path.at(frame.stamp_ns)
        if flown_m is not None:
            points.add(frame.image, result.depth_m, flown_m)
