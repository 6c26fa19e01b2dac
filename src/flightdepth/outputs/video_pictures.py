"""The pictures of a flight, from the video that it was run on: at their full size, packed once only."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from flightdepth.errors import BadInput
from flightdepth.flight.records import seconds
from flightdepth.flight.video import Video
from flightdepth.outputs.palette import Picture
from flightdepth.outputs.read import FlightFolder


def video_pictures(folder: FlightFolder, path: Path, every: int = 1) -> Iterator[tuple[int, Picture]]:
    """Index and picture, uint8 RGB [H, W, 3] at the camera's size, of each `every`-th frame.

    path  the video, or the folder of pictures, as it was given to `flightdepth run`

    Raises:
        BadInput: it is another: of another size, or without a picture at the time of a frame.
    """
    source = folder.record.source
    start_s, end_s, rate_hz = (_seconds(source.settings.get(name)) for name in ("start", "end", "rate"))
    wanted = {row.stamp_ns: row.index for row in folder.rows[::every]}
    with Video(path, start_s=start_s, end_s=end_s, rate_hz=rate_hz) as video:
        _check(folder, video)
        for frame in video.frames():
            if frame.stamp_ns in wanted:
                yield wanted.pop(frame.stamp_ns), frame.image
            if not wanted:
                return
    raise _another(folder, path, f"a picture at {seconds(min(wanted))}", "none")


def _seconds(setting: bool | float | str | None) -> float | None:
    return None if setting is None else float(setting)


def _check(folder: FlightFolder, video: Video) -> None:
    """Refuse another video by what is known of it before it is decoded."""
    source = folder.record.source
    if source.video_bytes not in (None, video.size_bytes):
        raise _another(folder, video.path, f"{source.video_bytes:,} bytes", f"{video.size_bytes:,}")
    size = source.camera.width, source.camera.height
    if video.size != size:
        expected, got = (f"{width}x{height} px" for width, height in (size, video.size))
        raise _another(folder, video.path, expected, got)


def _another(folder: FlightFolder, path: Path, expected: str, got: str) -> BadInput:
    mend = f"Give what {folder.folder} was made of: {folder.record.source.flight}."
    return BadInput(f"--video {path}", expected=expected, got=got, mend=mend)
