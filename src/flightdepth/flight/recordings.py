"""Which of a log's recordings a video is: a drone's log covers the flight, in which videos begin and end.

The log has a row each 0.1 or 0.2 s, so a recording begins between two rows, and its middle is taken: to half a row,
and as late as the app heard of it. `--telemetry-offset auto` finds the rest in the pictures.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flightdepth.errors import BadInput
from flightdepth.flight.records import NS_PER_S, Recording, Telemetry
from flightdepth.motion import Stamps

FIT_NS = 2 * NS_PER_S  # between the length of a recording by the log's flag and that of its video
FLICKER_NS = NS_PER_S  # no camera begins again so soon, and no video is so short
NEAR_S = 3.0  # of the flag's start: where the pictures are asked about the rest
LISTED = 9  # recordings that an error names
SEEK = "run --telemetry-offset auto looks for it in the pictures, or give the seconds"
SOUGHT = "give the seconds, as --telemetry-offset S"  # where the pictures did not tell it
MEND = "Give the offset of the right one, or let run --telemetry-offset auto find it in the pictures."


def recordings_in(stamps_ns: Stamps, recording: NDArray[np.bool_]) -> tuple[Recording, ...]:
    """Where a flag [n] at rising stamps [n] is up, flickers left out."""
    if not len(stamps_ns):
        return ()
    ups = np.flatnonzero(np.diff(np.r_[False, recording, False].astype(np.int8)))
    found: list[Recording] = []
    for first, after in ups.reshape(-1, 2).tolist():
        start_told, end_told = first > 0, after < len(stamps_ns)
        start_ns = _middle(stamps_ns, first) if start_told else int(stamps_ns[0])
        end_ns = _middle(stamps_ns, after) if end_told else int(stamps_ns[-1])
        if found and start_ns - found[-1].end_ns < FLICKER_NS:
            found[-1] = replace(found[-1], end_ns=end_ns, end_told=end_told)
        else:
            found.append(Recording(start_ns, end_ns, start_told, end_told))
    return tuple(each for each in found if each.end_ns - each.start_ns >= FLICKER_NS)


def _middle(stamps_ns: Stamps, at: int) -> int:
    """Midway between a row and the one before."""
    return int(stamps_ns[at - 1] + stamps_ns[at]) // 2


def at_recording(
    log: Telemetry, duration_ns: int, *, offset_given: bool = False, mend: str = MEND
) -> Telemetry:
    """The log with its time 0 at the first picture of the recording whose length fits a video's, and its name told.

    A log that tells no recording stays as it is; so does one where none or several fit, if an offset is given.
    `duration_ns` is 0 where the video does not say.

    Raises:
        BadInput: none or several of the recordings fit, and no offset is given; `mend` says what to do then.
    """
    number = _fitting(log.recordings, duration_ns)
    if number is None:
        if offset_given or not log.recordings:
            return log
        raise _ambiguous(log, duration_ns, mend)
    chosen = log.recordings[number]
    start_ns = _first_picture_ns(chosen, duration_ns)
    which = f"recording {number + 1} of {len(log.recordings)}, {_length(chosen)} long"
    name = f"{log.name}; time 0 is the start of {which}, {start_ns / NS_PER_S:.1f} s after its first velocity"
    moved = log.later_by(-start_ns)
    return replace(moved, name=name, recordings=(chosen.later_by(-start_ns),))


def doubted_length(log: Telemetry, duration_ns: int, *, mend: str = SEEK) -> tuple[str, ...]:
    """A line where the video is not the whole recording, or longer, so that nobody tells when it began.

    `mend` says what to do then.
    """
    elsewhere = f"time 0 may be elsewhere: {mend}"
    if not log.time_0_told:
        return _begun_together(log, duration_ns, elsewhere)
    if len(log.recordings) != 1 or not duration_ns:
        return ()
    [chosen] = log.recordings
    if not chosen.start_told and not chosen.end_told:
        return (f"the camera recorded when the log began, and when it ended: {elsewhere}",)
    seen_ns = chosen.end_ns - chosen.start_ns
    apart_ns = duration_ns - seen_ns
    whole = chosen.start_told and chosen.end_told
    # Of a recording of which the log saw the smaller part, chance may have chosen this one.
    if not -FIT_NS <= apart_ns <= (FIT_NS if whole else max(seen_ns, FIT_NS)):
        return (
            f"the log tells a recording of {_length(chosen)}, the video has {duration_ns / NS_PER_S:.0f} s: "
            f"{elsewhere}",
        )
    return ()


def _begun_together(log: Telemetry, duration_ns: int, elsewhere: str) -> tuple[str, ...]:
    """A line where a log that knows of no video is of another length, so that they hardly began at once."""
    _, last_ns = log.span_ns
    if not duration_ns or abs(duration_ns - last_ns) <= FIT_NS:
        return ()
    lengths = f"the log lasts {last_ns / NS_PER_S:.0f} s, the video {duration_ns / NS_PER_S:.0f} s"
    return (f"{lengths}, and both are taken to begin together; {elsewhere}",)


def searched_s(log: Telemetry, duration_ns: int) -> float | None:
    """How far from time 0 a log of `at_recording` can be off; None where no recording of the video's length tells."""
    sure = len(log.recordings) == 1 and duration_ns > 0 and not doubted_length(log, duration_ns)
    return NEAR_S if sure else None


def _fitting(recordings: Sequence[Recording], duration_ns: int) -> int | None:
    """Number of the one recording that fits: of those that the log saw whole, else of the others; or the only one."""
    if len(recordings) == 1:
        return 0
    if not duration_ns:
        return None
    lacks_ns = [duration_ns - (each.end_ns - each.start_ns) for each in recordings]
    whole = [each.start_told and each.end_told for each in recordings]
    pairs = list(enumerate(zip(lacks_ns, whole, strict=True)))
    fits = [number for number, (lack_ns, all_seen) in pairs if all_seen and abs(lack_ns) <= FIT_NS]
    fits = fits or [number for number, (lack_ns, all_seen) in pairs if not all_seen and lack_ns >= -FIT_NS]
    return fits[0] if len(fits) == 1 else None


def _first_picture_ns(recording: Recording, duration_ns: int) -> int:
    """When a recording began; where the log began later and saw its end, that less the video's length."""
    by_end = not recording.start_told and recording.end_told and duration_ns
    return recording.end_ns - duration_ns if by_end else recording.start_ns


def _ambiguous(log: Telemetry, duration_ns: int, mend: str) -> BadInput:
    listed = []
    for number, each in enumerate(log.recordings[:LISTED], 1):
        offset_s = round(-_first_picture_ns(each, duration_ns) / NS_PER_S, 2) or 0.01  # 0 is none given
        listed.append(f"{number}: {_length(each)}, --telemetry-offset {offset_s:.2f}")
    more = f"; and {len(log.recordings) - LISTED} more" if len(log.recordings) > LISTED else ""
    length = (
        f"of {duration_ns / NS_PER_S:.0f} s, as the video" if duration_ns else "(the video tells no length)"
    )
    return BadInput(
        f"telemetry {log.name}",
        expected=f"one recording {length}",
        got=f"{len(log.recordings)} ({'; '.join(listed)}{more})",
        mend=mend,
    )


def _length(recording: Recording) -> str:
    seen = recording.start_told and recording.end_told
    return f"{'' if seen else 'at least '}{(recording.end_ns - recording.start_ns) / NS_PER_S:.0f} s"
