"""Where live pictures come from: an address as people write it, and how FFmpeg is told to open it."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from flightdepth.errors import BadInput
from flightdepth.flight.video import refuse_non_video

EXPECTED = (
    "rtsp://HOST/PATH, rtsp+udp://HOST/PATH, rtp://0.0.0.0:PORT (H.264), a .sdp file, udp://0.0.0.0:PORT"
    " (MPEG-TS), tcp:// or srt:// (MPEG-TS), /dev/videoN, or a video file"
)
# Looking into a stream before it starts costs time and pictures; half a second holds a parameter set.
QUICK = {"analyzeduration": "500000", "fpsprobesize": "0"}
# What `export_side_data` adds: the sender's wall clock, from RTCP reports.
SENDER_CLOCK = {"export_side_data": "prft"}
PAYLOADS = {"h264": "H264", "h265": "H265", "hevc": "H265"}


@dataclass(frozen=True)
class VideoAddress:
    """What to open.

    name        as the user gave it, without a password
    target      for FFmpeg: an address, or the text of a session description
    format      FFmpeg's name of the format, None lets it look
    options     FFmpeg's options
    paced       a file, played in real time and then over; else a stream, opened again when it breaks
    same_clock  its times are those of this machine's monotonic clock
    """

    name: str
    target: str
    format: str | None = None
    options: Mapping[str, str] = field(default_factory=dict)
    paced: bool = False
    same_clock: bool = False

    def source(self) -> Any:
        """What `av.open` takes as its file."""
        return io.BytesIO(self.target.encode()) if self.format == "sdp" else self.target


def video_address(text: str) -> VideoAddress:
    """Understand `--video`; an address that cannot be one is refused before anything is opened."""
    name = re.sub(r"(?<=://)[^/@]*@", "", text)
    scheme = text.split("://", maxsplit=1)[0].lower() if "://" in text else ""
    if scheme in ("rtsp", "rtsps", "rtsp+udp"):
        transport = "udp" if scheme == "rtsp+udp" else "tcp"
        target = text.replace("rtsp+udp", "rtsp", 1)
        options = {"rtsp_transport": transport, "reorder_queue_size": "16"} | SENDER_CLOCK | QUICK
        return VideoAddress(name, target, options=options)
    if scheme == "rtp":
        return _session(name, h264_session(text))
    if scheme in ("udp", "tcp", "srt"):
        _port(text)
        return VideoAddress(name, text, format="mpegts", options={"overrun_nonfatal": "1"} | QUICK)
    if text.startswith("/dev/"):
        options = {"timestamps": "default"}
        return VideoAddress(name, text, format="v4l2", options=options, same_clock=True)
    if scheme:
        raise BadInput(f"video {name}", expected=EXPECTED, got=f"{scheme}://")
    return _file(text)


def h264_session(text: str) -> str:
    """The session description of rtp://HOST:PORT[?codec=h265]: RTP of payload type 96, the usual one."""
    parts = urlsplit(text)
    codec = dict(pair.split("=", 1) for pair in parts.query.split("&") if "=" in pair).get("codec", "h264")
    if codec.lower() not in PAYLOADS:
        raise BadInput(f"codec of {text}", expected=" or ".join(PAYLOADS), got=codec)
    lines = (
        "v=0",
        "o=- 0 0 IN IP4 127.0.0.1",
        "s=video",
        f"c=IN IP4 {parts.hostname or '0.0.0.0'}",
        "t=0 0",
        f"m=video {_port(text)} RTP/AVP 96",
        f"a=rtpmap:96 {PAYLOADS[codec.lower()]}/90000",
    )
    return "\r\n".join(lines) + "\r\n"


def _session(name: str, description: str) -> VideoAddress:
    options = {"protocol_whitelist": "file,udp,rtp", "reorder_queue_size": "16"} | SENDER_CLOCK | QUICK
    return VideoAddress(name, description, format="sdp", options=options)


def _port(text: str) -> int:
    try:
        port = urlsplit(text).port
    except ValueError:
        port = None
    if not port:
        raise BadInput(f"video {text}", expected="a port, as in udp://0.0.0.0:5600", got="none that is one")
    return port


def _file(text: str) -> VideoAddress:
    path = Path(text)
    if path.suffix.lower() == ".sdp":
        try:
            return _session(text, path.read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError) as error:
            raise BadInput(f"video {text}", expected="a session description", got=str(error)) from error
    if not path.exists():
        raise BadInput(f"video {text}", expected=EXPECTED, got="no such file")
    refuse_non_video(path)
    return VideoAddress(text, text, paced=True)
