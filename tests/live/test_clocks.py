"""Other clocks on ours: arrivals bound them from one side, answers from both, and a set wall clock moves nothing."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightdepth.live.clock import WINDOW_NS, RemoteClock
from flightdepth.live.meters import Ages, Rate
from flightdepth.live.picture_clock import HELD, NO_REPORT, PictureClock

MS, S = 10**6, 10**9
FRAME = 33_333_333


@given(st.lists(st.integers(0, 80 * MS), min_size=1, max_size=100), st.integers(-(10**15), 10**15))
def test_no_arrival_is_earlier_than_its_stamp(delays, offset):
    clock = RemoteClock()
    for i, delay in enumerate(delays):
        own = i * FRAME
        clock.arrived(own, own + offset + delay)
        assert own + offset <= clock.live_ns(own) <= own + offset + delay


def test_jitter_is_taken_out():
    delays = np.random.default_rng(1).exponential(20 * MS, 300).astype(int)
    clock = RemoteClock()
    for i, delay in enumerate(delays.tolist()):
        clock.arrived(i * FRAME, i * FRAME + 5 * MS + delay)
    assert clock.live_ns(0) == pytest.approx(5 * MS, abs=MS)


def test_drift_is_followed():
    """100 ppm: after ten minutes 60 ms."""
    clock = RemoteClock()
    for own in range(0, 600 * S, S // 10):
        clock.arrived(own, own + own // 10_000)
    assert abs(clock.live_ns(600 * S) - (600 * S + 60 * MS)) < 2 * MS


def test_memory_does_not_grow():
    clock = RemoteClock()
    for i in range(20_000):
        clock.arrived(i * FRAME, i * FRAME + i % 7 * MS)
    assert len(clock._arrivals) <= WINDOW_NS / FRAME + 1


def test_a_clock_that_starts_again_is_noticed():
    clock = RemoteClock()
    clock.arrived(300 * S, 1000 * S)
    clock.arrived(1 * S, 1003 * S)
    assert clock.live_ns(1 * S) == 1003 * S


def test_a_held_up_link_puts_itself_right():
    clock = RemoteClock()
    clock.arrived(10 * S, 110 * S)
    clock.arrived(11 * S, 114 * S)  # three seconds late
    clock.arrived(12 * S, 112 * S + 3 * S)
    clock.arrived(16 * S, 116 * S)
    assert clock.live_ns(16 * S) == 116 * S


def test_an_answer_halves_the_trip():
    clock = RemoteClock()
    clock.arrived(100 * S, 200 * S + 30 * MS)
    clock.answered(201 * S, 101 * S + 10 * MS, 201 * S + 20 * MS)
    assert clock.live_ns(101 * S) == 201 * S


def test_the_quickest_answer_counts():
    clock = RemoteClock()
    clock.answered(0, 50 * MS + 5 * S, 50 * MS)  # slow one way
    clock.answered(S, 6 * S + MS, S + 2 * MS)
    assert clock.live_ns(6 * S) == S


def test_late_messages_stand_where_answers_say():
    """A link that stalled gave three seconds of messages the time of their coming."""
    clock = RemoteClock()
    clock.arrived(100 * S, 200 * S + 30 * MS)
    clock.answered(201 * S, 101 * S + 10 * MS, 201 * S + 20 * MS)
    clock.arrived(102 * S, 205 * S)
    assert clock.live_ns(102 * S) == 202 * S


def test_an_answer_ends_what_it_contradicts():
    clock = RemoteClock()
    clock.answered(0, 50 * S + MS, 2 * MS)
    clock.answered(S, 49 * S + 5 * MS, S + 10 * MS)  # set back by two seconds; a slower trip
    assert clock.live_ns(49 * S) == S


@given(
    st.lists(
        st.tuples(st.integers(1, S), st.integers(0, S), st.integers(0, S // 2), st.integers(0, S // 2)),
        min_size=1,
    )
)
def test_nothing_true_is_ahead(steps):
    """However long anything took, as long as it came after it was sent."""
    clock, now = RemoteClock(), 0
    for wait, delay, there, back in steps:
        now += wait + there + back
        assert not clock.is_ahead(now - delay + 7 * S, now)
        clock.arrived(now - delay + 7 * S, now)
        clock.answered(now - there - back, now - back + 7 * S, now)


def test_a_time_is_ahead_that_answers_rule_out():
    clock = RemoteClock()
    clock.answered(0, 5 * S + 10 * MS, 20 * MS)
    assert not clock.is_ahead(6 * S + 50 * MS, S)
    assert clock.is_ahead(6 * S + 100 * MS, S)
    assert not clock.is_ahead(16 * S + 100 * MS, 11 * S)  # the answer is too old


def test_without_answers_only_seconds_are_ahead():
    clock = RemoteClock()
    clock.arrived(5 * S, 0)
    assert not clock.is_ahead(7 * S + 900 * MS, S)
    assert clock.is_ahead(8 * S + 100 * MS, S)


def test_pictures_by_arrival_lose_the_cameras_delay():
    clock = PictureClock(40 * MS)
    clock.packet(0, 5 * S)
    clock.packet(FRAME, 5 * S + FRAME + 9 * MS)
    assert clock.stamp(FRAME) == (5 * S + FRAME - 40 * MS, "reception")


@pytest.mark.parametrize("step", [-10 * S, -1500 * MS, -600 * MS, 700 * MS, 5 * S])
def test_a_stream_whose_time_jumps_is_followed_at_once(step):
    """Back by less than 2 s, its pictures were stamped that much too early for ten seconds."""
    clock = PictureClock(0)
    for i in range(300):
        own, now = 100 * S + i * FRAME + (step if i >= 200 else 0), 5 * S + i * FRAME
        clock.packet(own, now)
        assert clock.stamp(own) == (now, "reception")


@pytest.mark.parametrize("wrong", [-100 * S, -700 * MS, 1500 * MS, 100 * S])
def test_one_wrong_time_moves_no_picture_that_the_decoder_still_holds(wrong):
    """The picture before it was put into the past, or the future, by as much, and it itself the other way."""
    clock, held = PictureClock(0), None
    for i in range(60):
        own, now = 200 * S + i * FRAME + (wrong if i == 30 else 0), 5 * S + i * FRAME
        clock.packet(own, now)
        if held is not None:
            assert clock.stamp(held) == (now - FRAME, "reception")
        held = own


def test_of_the_stamps_of_packets_the_newest_are_kept():
    clock = PictureClock(0)
    for i in range(1000):
        clock.packet(i * FRAME, 5 * S + i * FRAME)
    assert len(clock._stamps) == HELD


def test_packets_in_the_order_of_decoding_are_no_jump():
    """B frames come after the picture that they lean on, which is shown later."""
    clock = PictureClock(0)
    for group in range(100):
        for k, shown in enumerate((3, 1, 2)):
            clock.packet(
                (3 * group + shown) * FRAME, 5 * S + (3 * group + k + 3) * FRAME + (group % 4) * 9 * MS
            )
    assert clock.stamp(300 * FRAME) == (5 * S + 300 * FRAME, "reception")


def test_a_kernel_stamp_on_our_clock_is_believed_less_the_cameras_delay():
    clock = PictureClock(40 * MS, same_clock=True)
    clock.packet(7 * S, 7 * S + 12 * MS)
    assert clock.stamp(7 * S) == (7 * S - 40 * MS, "sender")


def test_a_kernel_stamp_on_another_clock_is_not():
    clock = PictureClock(0, same_clock=True)
    clock.packet(7 * S, 999 * S)
    assert clock.stamp(7 * S) == (999 * S, "reception")


@pytest.mark.parametrize("glitch", [30 * S, 400 * MS])
def test_one_time_of_a_driver_from_the_future_is_not_believed_and_spoils_none_after_it(glitch):
    """It was, and no picture was later than that one for as long."""
    clock, told = PictureClock(0, same_clock=True), []
    for i in range(10):
        now = 7 * S + i * FRAME
        own = now - 10 * MS + (glitch if i == 5 else 0)
        clock.packet(own, now)
        told.append((clock.stamp(own)[0] - now, clock.stamp(own)[1]))
    assert told == [(-10 * MS, "sender")] * 5 + [(0, "reception")] + [(-10 * MS, "sender")] * 4


def test_a_driver_whose_pictures_lay_in_a_queue_is_believed():
    """This process stood still: they are as old as it says, whatever the arrivals look like."""
    clock = PictureClock(0, same_clock=True)
    clock.packet(7 * S, 7 * S)
    clock.packet(8 * S, 12 * S)
    assert clock.stamp(8 * S) == (8 * S, "sender")


WALL = 1_800_000_000 * S


def sender(clock, frames, *, first=0, age=15 * MS, set_by=0, sender_off=0):
    """`frames` packets of a sender whose wall clock is right but for `sender_off`; ours was set by `set_by`."""
    for i in range(first, first + frames):
        now = 50 * S + i * FRAME + age
        wall = WALL + i * FRAME + sender_off
        clock.packet(i * FRAME, now, sender_wall_ns=wall, wall_now_ns=WALL + i * FRAME + age + set_by)
    return clock.stamp((first + frames - 1) * FRAME)


def test_the_senders_wall_clock_tells_the_true_age():
    stamp, age_from = sender(PictureClock(0, wall_from_sender=True), 30)
    assert (stamp, age_from) == (50 * S + 29 * FRAME, "sender")


def test_it_is_not_believed_unasked():
    assert sender(PictureClock(0), 30)[1] == "reception"


@pytest.mark.parametrize("off", [3 * S, -10 * S, -3600 * S])
def test_a_sender_whose_clock_cannot_be_right_is_not_believed(off):
    clock = PictureClock(0, wall_from_sender=True)
    assert sender(clock, 30, sender_off=off)[1] == "reception"
    assert f"{0.015 - off / S:.2f} s after they were taken" in clock.distrusted


def test_why_a_clock_that_was_asked_for_is_not_believed_is_told():
    assert PictureClock(0).distrusted is None
    clock = PictureClock(0, wall_from_sender=True)
    clock.packet(0, 5 * S)
    assert clock.distrusted == NO_REPORT
    sender(clock, 30)
    assert clock.distrusted is None


@pytest.mark.parametrize("step", [-S, S // 2, 3600 * S])
def test_a_stepped_wall_clock_moves_no_stamp(step):
    clock = PictureClock(0, wall_from_sender=True)
    before, _ = sender(clock, 30)
    after, age_from = sender(clock, 30, first=30, set_by=step)
    assert age_from == "reception"
    sender(clock, 30, first=60)
    assert "set by" in clock.distrusted
    assert abs(after - before - 30 * FRAME) <= 15 * MS  # what the way took; the step is nowhere


@pytest.mark.parametrize("jump", [10 * S, -10 * S])
def test_a_senders_report_does_not_follow_a_stream_whose_time_jumps(jump):
    """Up to the next report FFmpeg moves the last one along: ages were ten seconds off, and negative."""
    clock = PictureClock(0, wall_from_sender=True)
    for i in range(6):
        now, moved = 50 * S + i * FRAME, jump if i >= 3 else 0
        wall = WALL + i * FRAME - 20 * MS + moved
        clock.packet(i * FRAME + moved, now, sender_wall_ns=wall, wall_now_ns=WALL + i * FRAME)
        stamp, age_from = clock.stamp(i * FRAME + moved)
        expected = (20 * MS, "sender", False) if i < 3 else (0, "reception", True)
        assert (now - stamp, age_from, clock.distrusted is not None) == expected


def test_rates_and_ages_by_hand():
    rate, ages = Rate(), Ages()
    for i in range(61):
        rate.add(i * S // 20)
    assert rate.hz(3 * S) == pytest.approx(20)
    assert rate.hz(30 * S) == 0
    for i in range(20):
        rate.add(40 * S + i * MS)
    assert rate.hz(40 * S + 20 * MS) == 0  # a burst: it was told as 1000 a second
    assert ages.p95_ms is None
    for i in range(101):
        ages.add(0, float(i))
    assert ages.p95_ms == 95
    ages.add(60 * S + 1, 7.0)
    assert (ages.p95_ms, ages.last_ms) == (7.0, 7.0)


def test_a_rate_begins_anew_after_a_pause():
    """After a camera that came back 1.7 pictures a second were told for 10, and the machine was called too slow."""
    rate = Rate()
    for i in range(11):
        rate.add(i * S // 10)
    for i in range(5):
        rate.add(3 * S + i * S // 10)
    assert rate.hz(3 * S + 4 * S // 10) == pytest.approx(10)


def test_ages_end_with_their_minute():
    """Hours after the stream's end /metrics told the last ones, as of the last minute."""
    ages = Ages()
    ages.add(0, 7.0)
    ages.forget(60 * S)
    assert (ages.p95_ms, ages.last_ms) == (7.0, 7.0)
    ages.forget(61 * S)
    assert (ages.p95_ms, ages.last_ms) == (None, None)
    ages.add(61 * S, 9.0)
    assert (ages.p95_ms, ages.last_ms) == (9.0, 9.0)
