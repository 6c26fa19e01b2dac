"""A reader that decodes more slowly than the stream comes: what lies in the queue before it is thrown away."""

import threading
import time
from collections import Counter
from contextlib import closing

import pytest
from live_peers import RATE_HZ, TsSender, encode, free_port

from flightdepth.live.backlog import Backlog
from flightdepth.live.picture_clock import PictureClock
from flightdepth.live.sound_decoder import SoundDecoder
from flightdepth.live.video_address import video_address
from flightdepth.live.video_stream import BEHIND, VideoStream

MS, S = 10**6, 10**9
FRAME = 33_333_333
OFF = 77 * S  # the sender's clock against ours
WAY = 5 * MS


def read(seconds, decoding, *, opening=0, pace=1.0):
    """Ages in ms (came, told, true) of a stream's pictures, and how many packets were thrown away.

    `decoding(now)`: how long it takes then, ns; `opening`: how long the stream came before it was read, ns;
    `pace`: how much the sender's clock is too slow.
    """
    backlog, clock = Backlog(), PictureClock(0)
    ages, thrown, now = [], 0, opening
    for i in range(round(seconds * S / FRAME)):
        sent = round(i * FRAME * pace)
        waited = max(0, sent + WAY - now)
        now += waited
        own = i * FRAME + OFF
        backlog.read(now, waited)
        clock.packet(own, now, queued=backlog.hurried)
        if backlog.skips(clock.late_ns(own, now)):
            thrown += 1
            now += MS // 10
            continue
        now += decoding(now)
        ages.append((now / S, (now - clock.stamp(own)[0]) / MS, (now - sent) / MS))
    return ages, thrown


@pytest.mark.parametrize(("each_ms", "opening"), [(28, 0), (15, 800 * MS)])
def test_a_reader_that_keeps_up_throws_nothing_away(each_ms, opening):
    ages, thrown = read(60, lambda now: each_ms * MS, opening=opening)
    assert thrown == 0
    assert max(told for came, told, _ in ages if came > 2) < each_ms + 1


def test_nor_does_one_that_stood_still_for_a_while():
    """It has the rest of the second to catch up."""
    ages, thrown = read(20, lambda now: 800 * MS if 10 * S < now < 10.1 * S else 5 * MS)
    assert thrown == 0
    assert ages[-1][1] == pytest.approx(5, abs=0.1)


@pytest.mark.parametrize("opening", [0, 800 * MS])
@pytest.mark.parametrize("each_ms", [35, 55, 150])
def test_one_that_does_not_keep_up_never_falls_far_behind_nor_tells_less(each_ms, opening):
    """Pictures were six seconds old, and told to be 0.3: the fastest of ten seconds had waited, too."""
    ages, thrown = read(60, lambda now: each_ms * MS, opening=opening)
    begun = [age for age in ages if age[0] > 2.5]
    assert thrown > 0
    assert max(true for *_, true in begun) < (1150 if each_ms == 150 else 700)
    assert max(true - told for _, told, true in begun) < 20 + WAY / MS


def test_a_clock_that_drifts_is_followed_by_a_reader_that_never_waits():
    """It was as late as the clocks are apart: after an hour, a third of a second."""
    clock = PictureClock(0)
    for own in range(0, 3600 * S, S // 2):
        clock.packet(own, own + own // 10_000, queued=True)
    assert abs(clock.late_ns(3600 * S, 3600 * S + 360 * MS)) < 2 * MS


def hearing(each_ms, seconds=2.0):
    """A backlog that heard ten packets a second, each waited for so long."""
    backlog = Backlog()
    for i in range(round(10 * seconds) + 1):
        backlog.read(i * 100 * MS, round(each_ms * MS))
    return backlog


@pytest.mark.parametrize(("each_ms", "hurried"), [(8.5, True), (9.5, False)])
def test_a_reader_that_waits_for_less_than_a_tenth_of_a_second_each_second_is_hurried(each_ms, hurried):
    """Eleven packets of the last second, with both ends."""
    assert hearing(each_ms).hurried == hurried


def test_nothing_is_known_of_the_first_second():
    assert not hearing(0, seconds=0.9).hurried
    assert hearing(0, seconds=1.0).hurried


def caught_up():
    """One that kept up, then hardly waited for the last second."""
    backlog = hearing(50)
    for i in range(21, 33):
        backlog.read(i * 100 * MS, 0)
    assert backlog.hurried
    return backlog


@pytest.mark.parametrize(("late_ms", "thrown"), [(249, False), (251, True)])
def test_who_kept_up_throws_away_what_is_a_quarter_of_a_second_late(late_ms, thrown):
    assert caught_up().skips(late_ms * MS) == thrown


@pytest.mark.parametrize("late_ms", [0, 300])
def test_what_came_while_the_stream_was_opened_is_thrown_away_however_late_it_seems(late_ms):
    assert hearing(0, seconds=1.0).skips(late_ms * MS)


@pytest.mark.parametrize(
    ("late_ms", "waited_ms", "ends"), [(63, 0, False), (62, 0, True), (200, 9.9, False), (200, 10, True)]
)
def test_it_is_thrown_away_up_to_one_in_time_or_waited_for(late_ms, waited_ms, ends):
    backlog = caught_up()
    assert backlog.skips(300 * MS)
    backlog.read(3_210 * MS, round(waited_ms * MS))
    assert backlog.skips(late_ms * MS) != ends
    assert backlog.hurried != ends


def test_after_that_the_next_second_is_heard_first():
    """Else the wait that ended it would be forgotten, and the reader be hurried again at once."""
    backlog = caught_up()
    assert backlog.skips(300 * MS)
    backlog.read(3_300 * MS, 0)
    assert not backlog.skips(0)
    for i in range(34, 43):
        backlog.read(i * 100 * MS, 0)
        assert not backlog.skips(300 * MS)
    backlog.read(4_300 * MS, 0)
    assert backlog.skips(300 * MS)


@pytest.mark.slow
def test_pictures_that_pile_up_in_ffmpegs_queue(tmp_path, monkeypatch):
    clip, sent, counts, stop = (
        encode(tmp_path / "flight.mp4", seconds=10, key_every=1),
        {},
        Counter(),
        threading.Event(),
    )
    decode = SoundDecoder.decode

    def slowly(self, packet):
        time.sleep(1.6 / RATE_HZ)
        return decode(self, packet)

    class Sender(TsSender):
        def step(self, i):
            sent[i] = time.monotonic_ns()
            super().step(i)

    monkeypatch.setattr(SoundDecoder, "decode", slowly)
    port = free_port()
    with Sender(clip, port), closing(VideoStream(video_address(f"udp://127.0.0.1:{port}"), counts)) as stream:
        for picture in stream.pictures(PictureClock(0), stop):
            came = time.monotonic_ns()
            last = round(picture.decoded.time * RATE_HZ)
            if last >= 6 * RATE_HZ:
                break
    assert counts[BEHIND] > 5
    assert came - sent[last] < 1.5 * S  # 2.5 s and more where they queue
    assert came - picture.stamp_ns > came - sent[last] - S // 2
