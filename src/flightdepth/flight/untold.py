"""What a log does not tell of the part of a video that is shown: told before the flight, a line each."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from flightdepth.flight.records import HOLD_S, LATEST_NS, MAX_GAP_S, NS_PER_S, Telemetry, seconds
from flightdepth.flight.video import Video

MOST_UNTOLD = 0.1  # of the time shown: a log may begin a little late


def shown_until_ns(video: Video) -> int | None:
    """When the chosen part of a video ends, None where it does not say."""
    return min(
        (end_ns for end_ns in (video.end_ns, video.duration_ns or None) if end_ns is not None), default=None
    )


def untold(video: Video, log: Telemetry) -> tuple[str, ...]:
    """What a log does not tell of the part of a video that is shown, a line each."""
    return (seldom_told(log) or interrupted(video, log)) + partly_told(video, log)


def interrupted(video: Video, log: Telemetry) -> tuple[str, ...]:
    """A line where a log tells no velocity for a while amid what is shown."""
    end_ns, hold_ns = shown_until_ns(video) or LATEST_NS, HOLD_S * NS_PER_S
    gaps = [
        (start, end)
        for start, end in pairwise(velocity.stamp_ns for velocity in log.velocities)
        if end - start > MAX_GAP_S * NS_PER_S and end > video.start_ns and start + hold_ns < end_ns
    ]
    if not gaps:
        return ()
    start, end = max(gaps, key=lambda gap: gap[1] - gap[0])
    often = ""
    if len(gaps) > 1:
        all_ns = sum(end - start for start, end in gaps)
        often = f"{len(gaps)} times, for {seconds(all_ns)} in all, the longest "
    return (
        f"the log tells no velocity {often}from {seconds(start)} to {seconds(end)} of the video: frames in there have "
        f"no depth, but for the first {HOLD_S:g} s",
    )


def partly_told(video: Video, log: Telemetry) -> tuple[str, ...]:
    """A line where a log tells nothing of a good part of what is shown."""
    end_ns = shown_until_ns(video)
    if end_ns is None or end_ns <= video.start_ns:
        return ()
    first_ns, last_ns = log.span_ns
    shown_ns = end_ns - video.start_ns
    untold_ns = shown_ns - (min(last_ns, end_ns) - max(first_ns, video.start_ns))
    if untold_ns <= max(MOST_UNTOLD * shown_ns, HOLD_S * NS_PER_S):
        return ()
    return (
        f"the log tells of {seconds(first_ns)} to {seconds(last_ns)}, the pictures are of {seconds(video.start_ns)} to "
        f"{seconds(end_ns)}: beyond it no frame has depth; are its times in the unit that their column says, and "
        "counted from the first picture?",
    )


def velocities_apart_ns(log: Telemetry) -> int:
    """Median time between two velocities of a log, 0 where there is only one."""
    stamps_ns = [velocity.stamp_ns for velocity in log.velocities]
    return int(np.median(np.diff(stamps_ns))) if len(stamps_ns) > 1 else 0


def seldom_told(log: Telemetry) -> tuple[str, ...]:
    """A line where so much time lies between two velocities that nobody knows how the drone flew meanwhile."""
    apart_ns = velocities_apart_ns(log)
    if apart_ns <= MAX_GAP_S * NS_PER_S:
        return ()
    return (
        f"the log tells a velocity every {apart_ns / NS_PER_S:.1f} s only, and more than "
        f"{MAX_GAP_S:g} s between two are not bridged: most frames will have no depth; log it more often",
    )
