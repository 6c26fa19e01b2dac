"""A track of data or text beside a video's pictures: its packets, with the time that each spans."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal, NamedTuple

from av.error import FFmpegError
from av.stream import Discard

from flightdepth.flight.container import main_stream, open_container
from flightdepth.flight.payload_clock import Interval
from flightdepth.flight.records import NS_PER_S

# A trimmed video's edit list says where each track begins; FFmpeg cuts pictures there, and a track of data it moves.
WHOLE_TRACKS = {"advanced_editlist": "0"}
DAMAGED = "damaged telemetry payloads"


class TrackPacket(NamedTuple):
    """One packet: the time that it spans since the first picture, its bytes, the name of the track's codec."""

    interval: Interval
    data: bytes
    codec: str


def track_packets(
    path: Path, kind: Literal["data", "subtitle"], tells: Callable[[bytes], bool]
) -> Iterator[TrackPacket]:
    """The packets of the first track of a kind that begins with one of which `tells` is True, until it is cut off."""
    with open_container(path) as container:
        if not any(stream.type == kind for stream in container.streams):
            return
        video = main_stream(container)
        zero = video.start_time * video.time_base if video is not None and video.start_time else Fraction(0)
    with open_container(path, WHOLE_TRACKS) as container:
        tracks = [stream for stream in container.streams if stream.type == kind]
        _leave_out(container, tracks)
        chosen = None
        for packet in _packets(container, tracks):
            data = bytes(packet)
            if chosen is None and tells(data):
                chosen = packet.stream
                _leave_out(container, [chosen])
            if packet.stream is chosen and packet.pts is not None:
                codec = chosen.codec_context.name if chosen.codec_context is not None else ""
                yield TrackPacket(_interval(packet, zero), data, codec)


def _leave_out(container: Any, tracks: list[Any]) -> None:
    """All streams but `tracks` are skipped, not read."""
    for stream in container.streams:
        if stream not in tracks:
            stream.discard = Discard.all


def _packets(container: Any, tracks: list[Any]) -> Iterator[Any]:
    try:
        yield from (packet for packet in container.demux(tracks) if packet.size)
    except FFmpegError:
        return  # a file cut off: the packets before the cut are good


def _interval(packet: Any, zero: Fraction) -> Interval:
    start = packet.pts * packet.time_base - zero
    end = start + (packet.duration or 0) * packet.time_base
    return Interval(int(start * NS_PER_S), int(end * NS_PER_S))
