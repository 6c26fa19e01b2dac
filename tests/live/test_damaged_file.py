"""A file that is played as if it were live, and cannot be read to its end."""

import threading
import time
from collections import Counter
from contextlib import closing

import av
import numpy as np
import pytest
from live_peers import RATE_HZ, encode, until

from flightdepth.errors import FlightDepthError
from flightdepth.flight.decoding import GAP, READ_ERROR
from flightdepth.live import video_stream
from flightdepth.live.video_address import video_address
from flightdepth.live.video_input import VideoInput, VideoListener
from flightdepth.live.video_stream import VideoStream

SECONDS = 4.0


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    return encode(tmp_path_factory.mktemp("clip") / "flight.ts", size=(320, 240), seconds=SECONDS)


@pytest.fixture
def played(monkeypatch):
    """Play a file whose last picture is due now; the input, and what was said of its end."""
    monkeypatch.setattr("flightdepth.live.video_stream.LATE_NS", 60 * 10**9)

    def play(path):
        said = []
        listener = VideoListener(lambda now_ns: None, said.append, said.append, said.append)
        begun_ns = time.monotonic_ns() - round(SECONDS * 1e9)
        video = VideoInput(video_address(str(path)), listener, epoch_ns=begun_ns)
        made.append(video)
        video.start()
        until(video.ended.is_set)
        return video, said

    made = []
    yield play
    for video in made:
        video.close()


def failing(after):
    """Reading that fails after so many packets."""

    def packets(container, stream, gap):
        for count, packet in enumerate(container.demux(stream)):
            if count == after:
                raise av.error.InvalidDataError(
                    1094995529, "Invalid data found when processing input", "/a/b"
                )
            yield packet

    return packets


def test_a_damaged_place_is_passed_over(clip, tmp_path, played):
    """It ended the run as an error: Resource temporarily unavailable."""
    data = bytearray(clip.read_bytes())
    begin, end = (len(data) // 188 * part // 10 * 188 for part in (3, 6))
    assert end - begin > 1 << 17
    data[begin:end] = bytes(end - begin)
    path = tmp_path / "damaged.ts"
    path.write_bytes(data)
    video, said = played(path)
    assert (video.error, said) == (None, [])
    assert video.dropped[GAP] >= 1
    assert 0.4 * SECONDS * RATE_HZ < video.received < 0.8 * SECONDS * RATE_HZ


def test_one_that_cannot_be_read_on_is_over_there(clip, played, monkeypatch):
    monkeypatch.setattr(video_stream, "file_packets", failing(20))
    video, said = played(clip)
    assert video.error is None
    assert said == ["Invalid data found when processing input"]
    assert video.dropped[READ_ERROR] == 1


def test_one_that_cannot_be_read_at_all_is_an_error_of_one_line(clip, played, monkeypatch):
    monkeypatch.setattr(video_stream, "file_packets", failing(0))
    video, _ = played(clip)
    assert isinstance(video.error, FlightDepthError)
    assert str(video.error) == f"video {clip}: Invalid data found when processing input"


def test_one_stall_costs_no_more_than_its_pictures(tmp_path, monkeypatch):
    """Found in review: all up to the next key frame went, and of a file with one the rest of it."""
    monkeypatch.setattr("flightdepth.live.video_stream.LATE_NS", 500_000_000)
    path = encode(tmp_path / "flight.ts", size=(320, 240), seconds=4.0, key_every=1000)
    stream = VideoStream(video_address(str(path)), Counter())
    begun_ns, shown = time.monotonic_ns(), []
    with closing(stream):
        for picture in stream.paced(begun_ns, 0, threading.Event()):
            shown.append((picture.stamp_ns - begun_ns) / 1e9)
            if len(shown) == 5:
                time.sleep(1.2)
    assert shown[-1] > 3.5
    assert max(np.diff(shown)) < 2


def test_a_file_that_decodes_too_slowly_goes_on_from_key_frames(tmp_path, monkeypatch):
    """Once late it was late for ever: no picture any more, to the end of the file."""
    monkeypatch.setattr("flightdepth.live.video_stream.LATE_NS", 200_000_000)
    path = encode(tmp_path / "flight.ts", size=(320, 240), seconds=6.0)
    stream = VideoStream(video_address(str(path)), Counter())
    decode, begun_ns, came_s = stream._decoder.decode, time.monotonic_ns(), []

    def slow(packet):
        if packet.is_keyframe or not stream._decoder._skipping:
            time.sleep(2 / RATE_HZ)
        return decode(packet)

    monkeypatch.setattr(stream._decoder, "decode", slow)
    with closing(stream):
        for picture in stream.paced(begun_ns, 0, threading.Event()):
            came_s.append((time.monotonic_ns() - begun_ns) / 1e9)
            assert time.monotonic_ns() - picture.stamp_ns < 1_000_000_000
    assert came_s[-1] > 4
