"""A video file as FFmpeg opens it, or the reason why it is none."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import av
from av.error import FFmpegError
from av.format import Flags

from flightdepth.errors import BadInput

VIDEO_EXPECTED = "a video such as MP4, MOV or MKV"
SNIFFED_BYTES = 4096


def open_container(path: Path, options: dict[str, str] | None = None) -> Any:
    """Open a video file with FFmpeg, and options of its reader; what cannot be one is refused with the reason."""
    refuse_non_video(path)
    try:
        # A relative name with a colon would be an address; tags are not always UTF-8.
        return av.open(str(path.absolute()), options=options or {}, metadata_errors="replace")
    except (FFmpegError, OSError, ValueError) as error:
        raise BadInput(f"video {path}", expected=VIDEO_EXPECTED, **_explain(path, error)) from error


def main_stream(container: Any) -> Any:
    """The video stream that players show, None without any; not a thumbnail, which may stand before it."""
    best = container.streams.best("video")
    if best is None or best.frames != 1:
        return best
    return max(container.streams.video, key=lambda stream: stream.frames)


def timed_stream(path: Path, container: Any) -> Any:
    """The `main_stream` of a video file, which must be one whose pictures have times."""
    if not container.streams.video:
        raise BadInput(f"video {path}", expected="a video stream", got="only sound or data")
    if container.format.flags & Flags.no_timestamps.value:
        raise BadInput(
            f"video {path}",
            expected="pictures with times",
            got="a raw stream without a container",
            mend="Tell its rate and give it one: ffmpeg -r 30 -i IN -c copy OUT.mp4",
        )
    return main_stream(container)


def refuse_non_video(path: Path) -> None:
    """Refuse missing, empty and text files; FFmpeg draws some texts as pictures or follows links in them."""
    if not path.is_file():
        got = "a folder" if path.is_dir() else "no such file"
        raise BadInput(f"video {path}", expected=VIDEO_EXPECTED, got=got)
    if not (head := _read_head(path)):
        raise BadInput(f"video {path}", expected=VIDEO_EXPECTED, got="an empty file")
    if is_text(head):
        raise BadInput(
            f"video {path}", expected=VIDEO_EXPECTED, got="a text file", mend="A log goes to --telemetry."
        )


def is_text(head: bytes) -> bool:
    """Whether the first bytes of a file are UTF-8 text; a character cut at the end is allowed."""
    try:
        text = head.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if error.start < len(head) - 3:
            return False
        text = head[: error.start].decode("utf-8-sig")
    return all(character.isprintable() or character in "\t\r\n\f" for character in text)


def _read_head(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(SNIFFED_BYTES)
    except OSError as error:
        raise BadInput(
            f"video {path}", expected="a readable file", got=error.strerror or str(error)
        ) from error


def _explain(path: Path, error: Exception) -> dict[str, str]:
    if _read_head(path)[4:8] == b"ftyp":
        return {
            "got": "an MP4 without a usable index, so it was cut off",
            "mend": "Copy it again or repair it.",
        }
    reason = getattr(error, "strerror", None) or str(error)
    return {"got": f"a file that cannot be read as one ({reason})"}
