"""The frame loop: one flight through the estimator into its folder."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator

from flightdepth.flight import Flight, Frame, Steadiness
from flightdepth.flight.records import Sample, give
from flightdepth.flight.still_parts import StillParts
from flightdepth.outputs.poses import PoseTrack
from flightdepth.outputs.writer import FlightWriter
from flightdepth.ranges import MultiRangeEstimator, RangedDepth

Progress = Callable[[Frame, RangedDepth], None]


def ignore(sample: Sample) -> None:
    """What nobody wants to see."""


def run_flight(
    flight: Flight, estimator: MultiRangeEstimator, writer: FlightWriter, progress: Progress
) -> None:
    """Give every sample and frame of `flight` to `estimator`, and every result to `writer` and `progress`.

    `writer.summary` is complete once the writer is closed. Where the camera's turns deny its lens, or show what stands
    still in the pictures, that is written too.
    """
    track = PoseTrack(flight.places, flight.utc, any_direction=flight.any_direction)
    still = StillParts(flight.camera, estimator.shown)
    if flight.mask is not None:
        writer.keep_mask(flight.mask.shown)
    try:
        for frame, result in depths(flight, estimator, on_sample=track.add):
            pose = track.at(frame, result)
            writer.add(frame, result, pose)
            if pose is not None and pose.attitude == "log":
                still.add(frame.image, pose.ned_from_camera)
            elif result.orientation is not None:
                seen = result.orientation
                still.add(frame.image, seen.rotation, seen.axes(frame.stamp_ns))
            progress(frame, result)
    finally:  # of what was flown when it was stopped, too
        writer.note_dropped(Counter(flight.counts) + Counter(estimator.dropped))
    if doubt := flight.lens_doubt():
        writer.warn(doubt)
    if (part := still.found()) is not None:
        writer.propose_mask(part)


def depths(
    flight: Flight,
    estimator: MultiRangeEstimator,
    *,
    on_sample: Callable[[Sample], None] = ignore,
) -> Iterator[tuple[Frame, RangedDepth]]:
    """Give every sample and frame of `flight` to `estimator`; each frame with its result."""
    steadiness = Steadiness(
        flight.camera,
        flight.gyroscope,
        on_followed=None if flight.turns is None else flight.turns.add,
        shown=estimator.shown,
    )
    for event in flight:
        match event:
            case Frame():
                if event.camera is not None:
                    estimator.see_through(event.camera)
                    steadiness.see_through(event.camera)
                limit_rad = estimator.max_turn_rad(event.stamp_ns)
                unusable = steadiness.add(event.stamp_ns, event.image, limit_rad).unusable
                if event.after_damage:
                    estimator.forget_frames()
                yield event, estimator.add_frame(event.stamp_ns, event.image, unusable=unusable)
            case sample:
                give(sample, estimator)
                on_sample(sample)
