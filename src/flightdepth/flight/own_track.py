"""Whether a log that was given for a video fits the track that the video carries itself."""

from __future__ import annotations

import math

import numpy as np

from flightdepth.errors import BadInput
from flightdepth.flight.inside import read_inside
from flightdepth.flight.records import NS_PER_S, Telemetry
from flightdepth.flight.signals import speed_signal
from flightdepth.flight.video import Video

LEAST_M_S = 1.0  # speeds that differ by less are not held against a log
LEAST_SHARE = 0.3  # nor by less than this of the track's


def disagreements(log: Telemetry, video: Video) -> tuple[str, ...]:
    """A line where the log flies at another speed than the track inside the video; none without such a track."""
    try:
        inside = read_inside(video.path)
    except BadInput:
        return ()  # a track that tells nothing contradicts nothing
    if inside is None:
        return ()
    told, track = speed_signal(log), speed_signal(inside)
    end_s = math.inf if video.end_ns is None else video.end_ns / NS_PER_S
    first_s, last_s = max(told.at_s[0], video.start_ns / NS_PER_S), min(told.at_s[-1], end_s)
    both = (first_s <= track.at_s) & (track.at_s <= last_s)
    if not both.any():
        return ()
    here_m_s = np.interp(track.at_s[both], told.at_s, told.values[:, 0])
    there_m_s = track.values[both, 0]
    apart_m_s = float(np.median(np.abs(here_m_s - there_m_s)))
    if apart_m_s <= max(LEAST_M_S, LEAST_SHARE * float(np.median(there_m_s))):
        return ()
    return (
        f"the log flies at {np.median(here_m_s):.1f} m/s, the track inside the video at {np.median(there_m_s):.1f}"
        f" ({apart_m_s:.1f} apart, median): is it this flight's log, and do its times count from the first picture?",
    )
