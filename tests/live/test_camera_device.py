"""Cameras, as far as a Linux without one can tell: what FFmpeg is told and says, and what cameras send."""

import subprocess
import sys
import threading
from collections import Counter
from contextlib import closing
from fractions import Fraction

import av
import numpy as np
import pytest
from av.device import DeviceInfo
from av.error import FFmpegError

from flightdepth.errors import BadInput
from flightdepth.live import video_address as addresses
from flightdepth.live import video_stream
from flightdepth.live.picture_clock import PictureClock
from flightdepth.live.sound_decoder import SoundDecoder
from flightdepth.live.video_address import VideoAddress, video_address
from flightdepth.live.video_input import in_words
from flightdepth.live.video_stream import StreamEnded, VideoStream


def test_size_rate_and_format_go_to_ffmpeg():
    camera = video_address("/dev/video2?size=1280x720&rate=30&format=mjpeg")
    assert camera.target == "/dev/video2"
    assert camera.options == {
        "timestamps": "default",
        "video_size": "1280x720",
        "framerate": "30",
        "input_format": "mjpeg",
    }
    assert video_address("/dev/video2").options == {"timestamps": "default"}


@pytest.mark.parametrize(
    "query", ["size=640", "rate=0", "format=", "fps=30", "size=640x480&rate=fast", "size"]
)
def test_what_a_camera_cannot_be_told_is_refused(query):
    with pytest.raises(BadInput, match="size=640x480"):
        video_address(f"/dev/video0?{query}")


@pytest.mark.parametrize(("key", "value"), [("video_size", "640by480"), ("timestamps", "sundial")])
def test_ffmpeg_knows_these_options(key, value):
    """It leaves out those it does not know, so a wrong value must be what it stumbles over, not the device."""
    with pytest.raises(FFmpegError) as told:
        av.open("/dev/null", format="v4l2", options={key: value})
    assert "ioctl" not in str(told.value)


@pytest.mark.parametrize(
    ("device", "why"),
    [
        ("/dev/there-is-none", "No such file or directory"),
        ("/dev/null", "Inappropriate ioctl for device"),
        ("/dev", "Is a directory"),
    ],
)
def test_what_is_no_camera_is_told_in_words(device, why):
    with pytest.raises((FFmpegError, StreamEnded)) as told:
        VideoStream(VideoAddress(device, device, format="v4l2"), Counter())
    assert in_words(told.value) == why


def test_a_camera_of_another_group_is_told_in_words(tmp_path):
    """Root may open anything, so a process of somebody else tries."""
    tmp_path.chmod(0o711)
    device = tmp_path / "video0"
    device.touch(mode=0o600)
    device.chmod(0)
    code = (
        "import av, os, sys\n"
        "from flightdepth.live.video_input import in_words\n"
        "os.geteuid() or os.seteuid(65534)\n"
        "try:\n    av.open(sys.argv[1], format='v4l2')\n"
        "except av.error.FFmpegError as error:\n    print(in_words(error))\n"
    )
    shown = subprocess.run([sys.executable, "-c", code, device], capture_output=True, text=True, check=True)
    assert shown.stdout == "Permission denied\n"


def film(path, codec, pix_fmt, count=4):
    """`count` pictures, red that fades, as a camera would send them."""
    with av.open(str(path), "w", format="nut") as container:
        stream = container.add_stream(codec, rate=30)
        stream.width, stream.height, stream.pix_fmt = 64, 48, pix_fmt
        stream.codec_context.color_range = 2 if codec == "mjpeg" else 1  # full, limited
        stream.codec_context.time_base = Fraction(1, 30)
        for i in range(count):
            image = np.zeros((48, 64, 3), np.uint8)
            image[..., 0] = 200 - 40 * i
            frame = av.VideoFrame.from_ndarray(image, format="rgb24")
            frame.pts = i
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return VideoAddress(path.name, str(path), format="nut", same_clock=True)


def pictures(address):
    with closing(VideoStream(address, Counter())) as stream, pytest.raises(StreamEnded):
        yield from stream.pictures(PictureClock(0), threading.Event())


CAMERAS_SEND = [("mjpeg", "yuvj422p"), ("rawvideo", "yuyv422"), ("rawvideo", "nv12"), ("rawvideo", "uyvy422")]


@pytest.mark.parametrize(("codec", "pix_fmt"), CAMERAS_SEND)
def test_what_cameras_send_becomes_rgb_picture_by_picture(tmp_path, codec, pix_fmt):
    seen = [picture.rgb() for picture in pictures(film(tmp_path / "camera.nut", codec, pix_fmt))]
    assert [image.shape for image in seen] == [(48, 64, 3)] * 4
    for i, image in enumerate(seen):
        assert np.abs(image.mean(axis=(0, 1)) - (200 - 40 * i, 0, 0)).max() < 6


def test_a_raw_picture_does_not_lie_in_the_drivers_memory(tmp_path, monkeypatch):
    """FFmpeg unmaps it when the camera is closed: a picture that still waited for the estimator killed the process."""
    packets, decode = [], SoundDecoder.decode
    monkeypatch.setattr(
        SoundDecoder, "decode", lambda self, packet: packets.append(packet) or decode(self, packet)
    )
    found = list(pictures(film(tmp_path / "camera.nut", "rawvideo", "yuyv422")))
    spans = [range(packet.buffer_ptr, packet.buffer_ptr + packet.buffer_size) for packet in packets]
    assert len(found) == 4
    assert not any(picture.decoded.planes[0].buffer_ptr in span for picture in found for span in spans)


@pytest.fixture
def elsewhere(monkeypatch):
    """Windows, or macOS, with these cameras and a microphone."""

    def system(*cameras):
        devices = [DeviceInfo(*camera, False, ["video"]) for camera in cameras]
        microphone = DeviceInfo("9", "Microphone", False, ["audio"])
        monkeypatch.setattr(addresses, "ContainerFormat", lambda name, mode: None)
        monkeypatch.setattr(addresses, "enumerate_input_devices", lambda driver: [*devices, microphone])

    return system


OWN = r"@device_pnp_\\?\usb#vid_046d&pid_0825#6&2"


@pytest.mark.parametrize(
    ("text", "cameras", "target", "options"),
    [
        ("dshow:HD cam (2)", [(OWN, "HD cam (2)")], "video=HD cam (2)", {"rtbufsize": "67108864"}),
        (f"dshow:{OWN}", [(OWN, "HD cam")], f"video={OWN}", {"rtbufsize": "67108864"}),
        (
            "dshow:HD cam?size=1280x720&rate=30&format=yuyv422",
            [],  # where the system lists none the driver finds out
            "video=HD cam",
            {"rtbufsize": "67108864", "video_size": "1280x720", "framerate": "30", "pixel_format": "yuyv422"},
        ),
        ("avfoundation:0", [("0", "FaceTime HD Camera")], "0", {"framerate": "30"}),
        (
            "avfoundation:FaceTime HD Camera?rate=25",
            [("0", "FaceTime HD Camera")],
            "FaceTime HD Camera",
            {"framerate": "25"},
        ),
    ],
)
def test_cameras_of_windows_and_macos(elsewhere, text, cameras, target, options):
    elsewhere(*cameras)
    camera = video_address(text)
    assert (camera.name, camera.source(), camera.options) == (text, target, options)
    assert (camera.format, camera.paced, camera.same_clock) == (text.split(":")[0], False, False)


def test_ffmpeg_is_handed_what_it_needs_for_them(elsewhere, monkeypatch):
    elsewhere((OWN, "HD cam"))
    asked = []
    monkeypatch.setattr(video_stream.av, "open", lambda *named, **keywords: asked.append((named, keywords)))
    with pytest.raises(AttributeError):  # nothing was opened
        VideoStream(video_address("dshow:HD cam?rate=30"), Counter())
    (named, keywords) = asked[0]
    assert named == ("video=HD cam",)
    assert keywords["format"] == "dshow"
    assert keywords["options"] == {"rtbufsize": "67108864", "framerate": "30"}


@pytest.mark.parametrize("text", ["dshow:", "dshow:HD", "dshow:Microphone"])
def test_a_camera_that_is_not_there_is_refused_with_those_that_are(elsewhere, text):
    elsewhere((OWN, "HD cam"), ("@device_sw", "OBS Virtual Camera"))
    with pytest.raises(BadInput, match="expected dshow:HD cam, dshow:OBS Virtual Camera, got"):
        video_address(text)


def test_what_they_cannot_be_told_is_refused(elsewhere):
    elsewhere()
    with pytest.raises(BadInput, match="size=640x480"):
        video_address("avfoundation:0?fps=30")


@pytest.mark.parametrize(("text", "driver"), [("dshow:HD cam", "dshow"), ("avfoundation:0", "avfoundation")])
def test_another_systems_camera_is_refused_at_once(text, driver):
    with pytest.raises(BadInput, match=rf"got {driver}, which this system has not"):
        video_address(text)


class NotYet:
    """A container of a camera that says "not yet" some times before each picture, as FFmpeg does on macOS."""

    def __init__(self, container, times):
        self.streams, self.close = container.streams, container.close
        self._packets, self._times, self._left = None, times, times
        self._demux = container.demux

    def demux(self, stream):
        self._packets = self._packets or self._demux(stream)
        while True:
            if self._left:
                self._left -= 1
                raise av.error.BlockingIOError(11, "Resource temporarily unavailable")
            self._left = self._times
            packet = next(self._packets, None)
            if packet is None:
                return
            yield packet


def opened(monkeypatch, path, times):
    container = av.open(str(path))
    monkeypatch.setattr(video_stream.av, "open", lambda *named, **keywords: NotYet(container, times))
    return VideoStream(VideoAddress("avfoundation:0", "0", format="avfoundation"), Counter())


def test_a_camera_that_has_no_picture_yet_is_asked_again(monkeypatch, tmp_path):
    film(tmp_path / "camera.nut", "rawvideo", "yuyv422")
    with closing(opened(monkeypatch, tmp_path / "camera.nut", 3)) as stream, pytest.raises(StreamEnded):
        seen = []
        for picture in stream.pictures(PictureClock(0), threading.Event()):
            seen.append(picture.rgb().shape)
    assert seen == [(48, 64, 3)] * 4


def test_one_that_never_has_is_given_up(monkeypatch, tmp_path):
    film(tmp_path / "camera.nut", "rawvideo", "yuyv422")
    monkeypatch.setattr(video_stream, "READ_S", 0.05)
    with (
        closing(opened(monkeypatch, tmp_path / "camera.nut", 1 << 30)) as stream,
        pytest.raises(TimeoutError, match="nothing came in time"),
    ):
        next(stream.pictures(PictureClock(0), threading.Event()))
