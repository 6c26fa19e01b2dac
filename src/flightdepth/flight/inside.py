"""Telemetry that a video carries itself: GoPro's track, DJI's metadata, DJI's subtitles."""

from __future__ import annotations

from pathlib import Path

from flightdepth.errors import BadInput
from flightdepth.flight.dji_metadata import read_dji_metadata
from flightdepth.flight.dji_srt import read_dji_subtitle_track
from flightdepth.flight.gpmf_telemetry import read_gpmf
from flightdepth.flight.records import Telemetry

READERS = (read_gpmf, read_dji_metadata, read_dji_subtitle_track)  # a track that tells most goes first


def read_inside(path: Path) -> Telemetry | None:
    """What the first track that tells a velocity says; None where there is none, as in a folder.

    Raises:
        BadInput: there is a track of a known kind, without a velocity.
    """
    silent: BadInput | None = None
    for read in READERS:
        try:
            if (log := read(path)) is not None:
                return log
        except BadInput as error:
            silent = silent or error
    if silent is not None:
        raise silent
    return None
