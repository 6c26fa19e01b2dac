"""Times of a stream, by hand: containers that tell them, that tell them late, and AVI, which has none."""

from fractions import Fraction
from types import SimpleNamespace

import pytest
from av.error import InvalidDataError

from flightdepth.flight.video_clock import VideoClock, numbers_packets

S = 10**9


class Container:
    """`demuxed` and `decoded` are what its iterators give; `sought` is where it was sent to."""

    start_time = 0

    def __init__(self, *, name="matroska,webm", duration=None, audio=(), demuxed=(), decoded=()):
        self.format, self.duration = SimpleNamespace(name=name), duration
        self.streams = SimpleNamespace(audio=audio)
        self.demux, self.decode = (lambda _, given=given: iter(given) for given in (demuxed, decoded))
        self.sought = []

    def seek(self, to):
        self.sought.append(to)


def stream(*, start_time=0, duration=None, time_base=Fraction(1, 1000), frames=0):
    return SimpleNamespace(start_time=start_time, duration=duration, time_base=time_base, frames=frames)


def at(pts=None, dts=None):
    """A packet or a picture."""
    return SimpleNamespace(pts=pts, dts=dts)


def test_time_counts_from_the_first_picture():
    clock = VideoClock(Container(), stream(start_time=500))
    assert clock.stamp_ns(500) == 0
    assert clock.stamp_ns(540) == 40_000_000
    assert clock.ticks_at(0) == 500


@pytest.mark.parametrize(("stamp_ns", "ticks"), [(39_999_999, 539), (40_000_000, 540), (40_999_999, 540)])
def test_the_tick_of_a_time_is_not_after_it(stamp_ns, ticks):
    assert VideoClock(Container(), stream(start_time=500)).ticks_at(stamp_ns) == ticks


def test_an_hour_of_odd_ticks_is_exact():
    """29.97 pictures a second: floats would be off in the last digits."""
    clock = VideoClock(Container(), stream(time_base=Fraction(1001, 30000)))
    assert clock.stamp_ns(30) == S + 1_000_000
    assert clock.stamp_ns(30 * 3600) == 3603 * S + 600_000_000
    assert clock.ticks_at(3603 * S + 600_000_000) == 30 * 3600


def test_a_stream_that_tells_its_start_with_its_first_packet_is_read_from_the_beginning_after_it():
    container = Container(demuxed=[at(pts=700, dts=660), at(pts=740)])
    assert VideoClock(container, stream(start_time=None)).ticks_at(0) == 700
    assert container.sought == [0]


@pytest.mark.parametrize("demuxed", [[], [at()]], ids=["no packet", "one without a time"])
def test_a_stream_that_never_tells_its_start_begins_at_zero(demuxed):
    assert VideoClock(Container(demuxed=demuxed), stream(start_time=None)).ticks_at(0) == 0


def test_a_stream_whose_first_packet_is_broken_begins_at_zero():
    def broken(_):
        raise InvalidDataError(1, "broken")
        yield

    container = Container()
    container.demux = broken
    assert VideoClock(container, stream(start_time=None)).ticks_at(0) == 0


def test_an_avi_counts_from_the_packet_that_brought_its_first_picture_out():
    """Whatever start it claims: the packets before held no picture."""
    container = Container(name="avi", demuxed=[at(dts=0)], decoded=[at(pts=7, dts=2), at(dts=3)])
    clock = VideoClock(container, stream(start_time=0))
    assert clock.ticks_at(0) == 2
    assert container.sought == [0]


def test_pictures_of_an_avi_are_at_their_packets_and_the_last_ones_a_tick_apart():
    clock = VideoClock(Container(name="avi", decoded=[at(dts=0)]), stream())
    assert clock.ticks_of(at(pts=9, dts=4), before=2) == 4
    assert clock.ticks_of(at(pts=9), before=4) == 5
    assert clock.ticks_of(at(pts=9)) is None


def test_pictures_of_other_containers_are_at_their_own_time():
    clock = VideoClock(Container(), stream())
    assert clock.ticks_of(at(pts=9, dts=4), before=2) == 9
    assert clock.ticks_of(at(dts=4), before=2) is None


@pytest.mark.parametrize("name", ["mov,mp4,m4a,3gp,3g2,mj2", "matroska,webm", "mpegts"])
def test_only_avi_has_no_times(name):
    assert not numbers_packets(Container(name=name))
    assert numbers_packets(Container(name="avi"))


@pytest.mark.parametrize(
    ("of_stream", "of_container", "expected_s"),
    [(8000, 9_000_000, 8), (None, 9_000_000, 9), (None, None, 0)],
    ids=["the stream's", "else the container's", "neither"],
)
def test_how_long_it_lasts(of_stream, of_container, expected_s):
    clock = VideoClock(Container(duration=of_container), stream(duration=of_stream))
    assert clock.duration_ns == expected_s * S


@pytest.mark.parametrize(
    ("container", "frames", "part_s", "whole_s"),
    [
        (Container(name="mov,mp4", duration=9_000_000), 225, 9, 0),
        (Container(duration=9_000_000), 0, 8.5, 8.5),
        (Container(duration=9_000_000, audio=("sound",)), 0, 0, 0),
        (Container(name="mpegts", duration=9_000_000), 0, 0, 0),
    ],
    ids=["an index", "mkv, from time zero on", "mkv with sound", "no head"],
)
def test_what_the_head_promises(container, frames, part_s, whole_s):
    """An index counts the pictures of a whole file; sound may last longer than them."""
    clock = VideoClock(container, stream(start_time=500, frames=frames))
    assert clock.promised_end_ns(whole=False) == part_s * S
    assert clock.promised_end_ns(whole=True) == whole_s * S
