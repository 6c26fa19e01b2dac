"""What a log does not tell of the part of a video that is shown, by times worked out by hand."""

from types import SimpleNamespace

import pytest

from flightdepth.flight.records import Telemetry, VelocitySample
from flightdepth.flight.untold import (
    interrupted,
    partly_told,
    seldom_told,
    shown_until_ns,
    untold,
    velocities_apart_ns,
)

S = 10**9


def shown(start_s=0.0, end_s=None, lasts_s=None):
    """A video of which a part is chosen; `lasts_s` is None where its container does not say."""
    end_ns = None if end_s is None else round(end_s * S)
    return SimpleNamespace(
        start_ns=round(start_s * S), end_ns=end_ns, duration_ns=0 if lasts_s is None else round(lasts_s * S)
    )


def log(*times_s):
    return Telemetry("log", tuple(VelocitySample(round(at_s * S), [1.0, 0, 0]) for at_s in times_s))


def every(step_s, first_s, last_s):
    """Times a step apart, both ends included."""
    return [first_s + k * step_s for k in range(round((last_s - first_s) / step_s) + 1)]


@pytest.mark.parametrize(
    ("video", "until_s"),
    [
        (shown(lasts_s=20), 20),
        (shown(end_s=5, lasts_s=20), 5),
        (shown(end_s=30, lasts_s=20), 20),
        (shown(end_s=5), 5),
    ],
    ids=["all", "a part", "an end after the end", "of a length that is not told"],
)
def test_a_part_is_shown_until_the_earlier_of_two_ends(video, until_s):
    assert shown_until_ns(video) == until_s * S


def test_a_video_that_tells_no_end_is_shown_until_nobody_knows_when():
    assert shown_until_ns(shown()) is None


@pytest.mark.parametrize(
    ("begins_s", "lasts_s", "told"),
    [(0.5, 4, False), (0.55, 4, True), (2.0, 20, False), (2.1, 20, True)],
    ids=["half a second", "more", "a tenth", "more than a tenth"],
)
def test_a_log_may_begin_half_a_second_or_a_tenth_of_what_is_shown_late(begins_s, lasts_s, told):
    """The longer of the two."""
    late = log(*every(0.05, begins_s, lasts_s))
    assert bool(partly_told(shown(lasts_s=lasts_s), late)) == told


def test_what_a_log_tells_before_and_after_what_is_shown_does_not_make_up_for_what_it_lacks():
    """4 of 10 s are missing, at either end, for a log of 16 s."""
    before, after = log(*every(1, -10, 6)), log(*every(1, 14, 30))
    assert partly_told(shown(lasts_s=10), before)
    assert partly_told(shown(10, 20, 40), after)


def test_of_a_video_that_tells_no_end_no_log_is_too_short():
    assert partly_told(shown(), log(5, 6)) == ()


def test_of_a_part_after_the_end_nothing_is_missing():
    assert partly_told(shown(start_s=30, lasts_s=20), log(0, 1)) == ()


@pytest.mark.parametrize(("apart_s", "told"), [(1.5, False), (1.6, True)])
def test_a_gap_is_longer_than_what_is_bridged(apart_s, told):
    assert bool(interrupted(shown(lasts_s=3), log(0, 1, 1 + apart_s, 3))) == told


def test_a_gap_whose_held_part_alone_is_shown_costs_no_depth():
    """The velocity before it holds for half a second."""
    gap = log(0, 1, 2, 3, 6, 7)
    assert interrupted(shown(end_s=3.5, lasts_s=7), gap) == ()
    (line,) = interrupted(shown(end_s=3.6, lasts_s=7), gap)
    assert "from 3.000 s to 6.000 s" in line
    assert line.endswith("no depth, but for the first 0.5 s")


def test_a_gap_that_ends_where_the_part_begins_costs_nothing():
    gap = log(0, 1, 2, 3, 6, 7)
    assert interrupted(shown(start_s=6, lasts_s=7), gap) == ()
    assert interrupted(shown(start_s=5.9, lasts_s=7), gap) != ()


def test_a_gap_counts_in_a_video_that_tells_no_end():
    assert interrupted(shown(), log(0, 1, 4, 5)) != ()


def test_of_two_velocities_the_time_between_them_is_told():
    assert velocities_apart_ns(log(1, 3)) == 2 * S
    assert velocities_apart_ns(log(1)) == 0


def test_one_long_gap_does_not_make_a_log_tell_seldom():
    gap = log(*every(0.1, 0, 1), *every(0.1, 60, 61))
    assert velocities_apart_ns(gap) == pytest.approx(0.1 * S)
    assert seldom_told(gap) == ()


@pytest.mark.parametrize(("step_s", "told"), [(1.5, False), (1.6, True)])
def test_seldom_is_more_than_what_is_bridged(step_s, told):
    assert bool(seldom_told(log(*every(step_s, 0, 9)))) == told


def test_a_log_that_tells_seldom_is_not_said_to_be_interrupted_too():
    """Each of its steps is a gap."""
    (line,) = untold(shown(lasts_s=10), log(*every(2, 0, 10)))
    assert "a velocity every 2.0 s only" in line


def test_a_log_with_a_gap_that_ends_early_is_told_twice():
    gap, early = untold(shown(lasts_s=20), log(0, 1, 2, 5, 6, 7))
    assert "tells no velocity from 2.000 s to 5.000 s" in gap
    assert "the log tells of 0.000 s to 7.000 s" in early
