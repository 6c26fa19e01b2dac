"""Where live pictures come from: an address as people write it, and how FFmpeg is told to open it."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, parse_qsl, urlsplit

from av.device import enumerate_input_devices
from av.error import FFmpegError
from av.format import ContainerFormat

from flightdepth.errors import BadInput
from flightdepth.flight.container import refuse_non_video

EXPECTED = (
    "rtsp://HOST/PATH, rtsp+udp://HOST/PATH, rtp://0.0.0.0:PORT (H.264), a .sdp file, udp://0.0.0.0:PORT"
    " (MPEG-TS), tcp:// or srt:// (MPEG-TS), a camera, /dev/videoN (Linux), dshow:NAME (Windows)"
    " or avfoundation:NAME (macOS), each with [?size=WxH&rate=FPS&format=NAME], or a video file"
)
# Looking into a stream before it starts costs time and pictures; half a second holds a parameter set.
QUICK = {"analyzeduration": "500000", "fpsprobesize": "0"}
# MPEG-TS holds one picture a PES packet, which is known to be whole when the next one begins. FFmpeg's parser would
# look for the end once more, and find it with the picture after that: another 33 ms at 30 pictures a second.
# With nofillin it would read 33 pictures before the stream is open.
WHOLE_PICTURES = {"fflags": "+noparse"}
# FFmpeg's queue before the decoder, in packets of 188 bytes: a key frame of a stream of 20 Mbit/s comes in one burst.
UDP_QUEUE = {"overrun_nonfatal": "1", "fifo_size": "8192"}
# What `export_side_data` adds: the sender's wall clock, from RTCP reports.
SENDER_CLOCK = {"export_side_data": "prft"}
RTP = "rtp"  # read by our own `rtp_stream`
LAST_PORT = 65_535
# What may stand behind a camera's name, what FFmpeg calls it, and how it is written.
CAMERA = {
    "size": ("video_size", r"[1-9]\d*x[1-9]\d*"),
    "rate": ("framerate", r"[1-9]\d*(\.\d+|/[1-9]\d*)?"),
    "format": ("input_format", r"[a-z0-9_]+"),
}
PIXELS = CAMERA | {"format": ("pixel_format", r"[a-z0-9_]+")}
DRIVER = re.compile(r"(dshow|avfoundation):(.*?)(?:\?(\w+=.*))?")
# Options of cameras of Windows and macOS that are set unless the address says otherwise. DirectShow's queue, in bytes,
# holds less than one raw picture of 1920x1080 by itself; most cameras of Macs refuse the 29.97 that is asked of them.
UNSAID = {"dshow": {"rtbufsize": "67108864"}, "avfoundation": {"framerate": "30"}}
# In an address: user and password before the host, and values whose names tell that they let one in, up to the next &:
# a camera's password=, pwd=, authbasic=; SRT's passphrase=, and its streamid=, in which servers take user and password.
SECRET = re.compile(
    r"(?<=://)[^/?]*@|((?:pass|pwd|psw|loginpas|secret|token|auth|key|streamid)\w*=)[^&]*", re.IGNORECASE
)
DECODERS = {"h264": "h264", "h265": "hevc", "hevc": "hevc"}


@dataclass(frozen=True)
class VideoAddress:
    """What to open.

    name        as the user gave it, without what lets one in (see SECRET): what may be written down
    target      for FFmpeg: an address, or the text of a session description
    format      FFmpeg's name of the format, or RTP; None lets it look
    options     FFmpeg's options
    paced       a file, played in real time and then over; else a stream, opened again when it breaks
    same_clock  its times are those of this machine's monotonic clock
    rtp         FFmpeg receives RTP, and says in its log alone when packets are missing
    """

    name: str
    target: str
    format: str | None = None
    options: Mapping[str, str] = field(default_factory=dict)
    paced: bool = False
    same_clock: bool = False
    rtp: bool = False

    @property
    def reports_wall_clock(self) -> bool:
        """Whether RTCP tells the sender's wall clock, if the sender does as it should."""
        return self.rtp or self.format == RTP

    def source(self) -> Any:
        """What `av.open` takes as its file."""
        return io.BytesIO(self.target.encode()) if self.format == "sdp" else self.target


def video_address(text: str) -> VideoAddress:
    """Understand `--video`; an address that cannot be one is refused before anything is opened."""
    name = without_secrets(text)
    scheme, separator, rest = text.partition("://")
    scheme = scheme.lower() if separator else ""  # FFmpeg knows no capitals
    if scheme in ("rtsp", "rtsps", "rtsp+udp"):
        transport = "udp" if scheme == "rtsp+udp" else "tcp"
        target = f"{scheme.removesuffix('+udp')}://{rest}"
        options = {"rtsp_transport": transport, "reorder_queue_size": "16"} | SENDER_CLOCK | QUICK
        return VideoAddress(name, target, options=options, rtp=True)
    if scheme == "rtp":
        _check_port(text, last=LAST_PORT - 1)  # RTCP comes to the next one
        codec_of(text)
        return VideoAddress(name, text, format=RTP)
    if scheme in ("udp", "tcp", "srt"):
        _check_port(text)
        options = (UDP_QUEUE if scheme == "udp" else {}) | QUICK | WHOLE_PICTURES
        return VideoAddress(name, f"{scheme}://{rest}", format="mpegts", options=options)
    if text.startswith("/dev/"):
        return _camera(text)
    if driven := DRIVER.fullmatch(text):
        return _listed_camera(text, *driven.groups(default=""))
    if scheme:
        raise BadInput(f"video {name}", expected=EXPECTED, got=f"{scheme}://")
    return _file(text)


def without_secrets(text: str) -> str:
    """An address without the user and password before its host, and without the values behind it that let one in."""
    return SECRET.sub(r"\1", text)


def codec_of(text: str) -> str:
    """FFmpeg's name of the codec in rtp://HOST:PORT[?codec=h265]; H.264 where it does not say."""
    codec = parse_qs(urlsplit(text).query).get("codec", ["h264"])[0].lower()
    if codec not in DECODERS:
        raise BadInput(f"codec of {without_secrets(text)}", expected=" or ".join(DECODERS), got=codec)
    return DECODERS[codec]


def _camera(text: str) -> VideoAddress:
    """A V4L2 camera, on Linux."""
    device, _, query = text.partition("?")
    _check_driver(text, "v4l2")
    options = {"timestamps": "default"} | _asked_for(text, query, CAMERA)  # the driver's own
    return VideoAddress(text, device, format="v4l2", options=options, same_clock=True)


def _listed_camera(text: str, driver: str, camera: str, query: str) -> VideoAddress:
    """A camera of Windows or macOS, by its name; one that the system does not list is refused."""
    _check_driver(text, driver)
    listed = _cameras(driver)
    if camera not in {name for names in listed for name in names} and (listed or not camera):
        expected = ", ".join(f"{driver}:{description or name}" for name, description in listed)
        raise BadInput(f"video {text}", expected=expected or f"{driver}:NAME", got=camera or "no name")
    options = UNSAID[driver] | _asked_for(text, query, PIXELS)
    target = f"video={camera}" if driver == "dshow" else camera
    return VideoAddress(text, target, format=driver, options=options)


def _cameras(driver: str) -> list[tuple[str, str]]:
    """Name and description of each that the system lists; FFmpeg takes either."""
    try:
        devices = enumerate_input_devices(driver)
    except (FFmpegError, OSError):  # then the driver finds out
        return []
    return [(each.name, each.description) for each in devices if "video" in (each.media_types or ["video"])]


def _check_driver(text: str, driver: str) -> None:
    """Refuse the cameras of another system."""
    try:
        ContainerFormat(driver, "r")
    except ValueError as error:
        raise BadInput(
            f"video {text}", expected=EXPECTED, got=f"{driver}, which this system has not"
        ) from error


def _asked_for(text: str, query: str, known: Mapping[str, tuple[str, str]]) -> dict[str, str]:
    """FFmpeg's options, of what stands behind a camera's name."""
    options = {}
    for key, value in parse_qsl(query, keep_blank_values=True):
        name, written = known.get(key, ("", ""))
        if not name or not re.fullmatch(written, value):
            formats = "mjpeg or yuyv422" if known is CAMERA else "yuyv422 or nv12"
            expected = f"size=640x480, rate=30, format={formats}, joined by &"
            raise BadInput(f"video {text}", expected=expected, got=f"{key}={value}")
        options[name] = value
    return options


def _session(name: str, path: Path) -> VideoAddress:
    try:
        description = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"video {name}", expected="a session description", got=str(error)) from error
    options = {"protocol_whitelist": "file,udp,rtp", "reorder_queue_size": "16"} | SENDER_CLOCK | QUICK
    return VideoAddress(name, description, format="sdp", options=options, rtp=True)


def _check_port(text: str, last: int = LAST_PORT) -> None:
    what = f"video {without_secrets(text)}"
    try:
        port = urlsplit(text).port
    except ValueError:
        port = None
    if not port:
        raise BadInput(what, expected="a port, as in udp://0.0.0.0:5600", got="none that is one")
    if port > last:
        raise BadInput(what, expected=f"a port up to {last}, since RTCP comes to the next one", got=str(port))


def _file(text: str) -> VideoAddress:
    path = Path(text)
    if path.suffix.lower() == ".sdp":
        return _session(text, path)
    if not path.exists():
        expected = "a video file, a .sdp file, or an address as `flightdepth live --help` lists them"
        raise BadInput(f"video {text}", expected=expected, got="no such file")
    refuse_non_video(path)
    return VideoAddress(text, str(path.absolute()), paced=True)  # FFmpeg takes 10:30.mp4 for an address
