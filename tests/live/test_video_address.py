"""Addresses of video: what FFmpeg is told, and what is refused."""

import av
import pytest
from live_peers import encode

from flightdepth.errors import BadInput
from flightdepth.live.video_address import RTP, codec_of, video_address
from flightdepth.live.video_input import LONGEST_PAUSE_S, VideoInput, VideoListener, in_words, pause_s


def test_rtsp_goes_over_tcp_unless_told():
    assert video_address("rtsp://cam/main").options["rtsp_transport"] == "tcp"
    over_udp = video_address("rtsp+udp://cam/main")
    assert (over_udp.target, over_udp.options["rtsp_transport"]) == ("rtsp://cam/main", "udp")


def test_capitals_are_read():
    """FFmpeg knows none: the address was handed on as it stood, and could not be opened."""
    assert video_address("RTSP+UDP://cam/Main").target == "rtsp://cam/Main"
    assert video_address("SRT://cam:9000").target == "srt://cam:9000"


def test_a_password_is_not_repeated():
    address = video_address("rtsp://pilot:secret@192.168.1.10:554/main?x=1")
    assert address.name == "rtsp://192.168.1.10:554/main?x=1"
    assert "secret" in address.target


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("rtsp://pilot:p@ss@cam/main", "rtsp://cam/main"),
        ("srt://cam:9000?passphrase=secret12345&mode=caller", "srt://cam:9000?passphrase=&mode=caller"),
        ("srt://cam:9000?mode=caller&passphrase=secret12345", "srt://cam:9000?mode=caller&passphrase="),
        ("srt://cam:9000?streamid=read:main:pilot:secret", "srt://cam:9000?streamid="),
        (
            "rtsp://cam:554/user=admin&password=tlJw&channel=1",
            "rtsp://cam:554/user=admin&password=&channel=1",
        ),
        ("rtsp://cam/user=admin_password=tlJw_channel=1", "rtsp://cam/user=admin_password="),
        ("rtsp://cam/main?user=admin&Password=p/w?", "rtsp://cam/main?user=admin&Password="),
        ("rtsp://cam/main?channel=1&PWD=pw", "rtsp://cam/main?channel=1&PWD="),
        ("rtsp://cam/main?authbasic=cGlsb3Q6c2VjcmV0&subtype=0", "rtsp://cam/main?authbasic=&subtype=0"),
    ],
)
def test_nor_is_one_with_an_at_sign_or_behind_the_address(text, name):
    assert video_address(text).name == name


@pytest.mark.parametrize(
    "text", ["srt://pilot:secret@cam?passphrase=secret", "rtp://pilot:secret@0.0.0.0:5600?codec=vp9"]
)
def test_a_refusal_tells_no_password(text):
    with pytest.raises(BadInput) as refused:
        video_address(text)
    assert "secret" not in str(refused.value)


def test_rtp_is_read_by_our_own():
    assert video_address("rtp://0.0.0.0:5600").format == RTP
    assert codec_of("rtp://0.0.0.0:5600") == "h264"
    assert codec_of("rtp://0.0.0.0:5600?codec=H265") == "hevc"


def test_a_session_description_is_read(tmp_path):
    path = tmp_path / "camera.sdp"
    path.write_text("v=0\nm=video 5600 RTP/AVP 97\n")
    address = video_address(str(path))
    assert address.target.endswith("AVP 97\n")
    assert address.source().read() == address.target.encode()


def test_a_colon_in_a_files_name_makes_no_address_of_it(tmp_path, monkeypatch):
    clip = encode(tmp_path / "clip.mp4", seconds=1).rename(tmp_path / "10:30.mp4")
    monkeypatch.chdir(tmp_path)
    address = video_address("10:30.mp4")
    assert (address.name, address.target, address.paced) == ("10:30.mp4", str(clip), True)
    with av.open(address.source()) as container:
        assert container.streams.video


def test_cameras_and_transport_streams():
    camera = video_address("/dev/video0")
    assert (camera.format, camera.same_clock, camera.paced) == ("v4l2", True, False)
    assert video_address("udp://0.0.0.0:5600").format == "mpegts"


def test_ffmpegs_queue_is_short():
    """It held 5 MB, six seconds of many a stream; a key frame of one of 20 Mbit/s may take 1 MB."""
    assert 1_000_000 < 188 * int(video_address("udp://0.0.0.0:5600").options["fifo_size"]) < 2_000_000
    assert "fifo_size" not in video_address("srt://cam:9000").options


class Sender:
    """Bytes in the order in which they come, as from a socket; `at` is how many were read."""

    def __init__(self, data):
        self.data, self.at = data, 0

    def read(self, size):
        self.at += size
        return self.data[self.at - size : self.at]


def test_a_transport_stream_is_open_after_a_few_pictures(tmp_path):
    """FFmpeg took 33 pictures first, a second of 30 and three of 10."""
    clip, address = encode(tmp_path / "clip.ts", seconds=4), video_address("udp://0.0.0.0:5600")
    source = Sender(clip.read_bytes())
    with av.open(source, format=address.format, options=dict(address.options), buffer_size=188):
        assert source.at < len(source.data) / 4


@pytest.mark.parametrize(
    "text", ["gopher://x", "udp://0.0.0.0", "rtp://0.0.0.0:70000", "nothing-of-this-name.mp4", ""]
)
def test_others_are_refused(text):
    with pytest.raises(BadInput, match="expected"):
        video_address(text)


def test_rtcp_needs_a_port_too():
    """At 65535 the reports were awaited at a port that the system chose, and never came."""
    with pytest.raises(BadInput, match="up to 65534, since RTCP"):
        video_address("rtp://0.0.0.0:65535")
    assert video_address("rtp://0.0.0.0:65534").format == RTP
    assert video_address("udp://0.0.0.0:65535").format == "mpegts"


def test_an_unknown_codec_is_refused():
    with pytest.raises(BadInput, match="h264 or h265"):
        video_address("rtp://0.0.0.0:5600?codec=vp9")


def test_the_pause_doubles_up_to_its_limit():
    pauses = [pause_s(n) for n in range(12)]
    assert pauses[:4] == [0.25, 0.5, 1.0, 2.0]
    assert max(pauses) == LONGEST_PAUSE_S


@pytest.mark.parametrize(
    ("error", "longest_s"),
    [
        (TimeoutError("nothing came in time"), 0.25),
        (av.error.ExitError(1, "Immediate exit requested"), 0.25),
        (OSError("refused"), 4.0),
    ],
)
def test_who_waited_for_a_silent_sender_hears_it_soon_when_it_comes_back(monkeypatch, error, longest_s):
    """A camera that had been off was not heard for up to four seconds: nobody listened on its port."""
    told, pauses = [], []
    nobody = VideoListener(lambda now_ns: None, told.append, told.append)
    video = VideoInput(video_address("rtp://127.0.0.1:5600"), nobody)

    def silent():
        raise error

    def wait(pause_s):
        pauses.append(pause_s)
        if len(pauses) == 8:
            video._stop.set()

    monkeypatch.setattr(video, "_open", silent)
    monkeypatch.setattr(video._stop, "wait", wait)
    video._keep_reading()
    assert max(pauses) == longest_s
    assert len(told) == 8


def test_an_error_tells_no_address():
    error = OSError(111, "Connection refused: 'rtsp://pilot:secret@cam/main'")
    assert in_words(error) == "Connection refused"


def test_a_file_that_is_not_there_is_told_shortly():
    """It was told with all kinds of addresses there are, six lines long."""
    with pytest.raises(
        BadInput, match=r"^video flight\.mp: expected a video file, .{1,90}, got no such file$"
    ):
        video_address("flight.mp")
