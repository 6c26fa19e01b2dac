"""How n follows the load: a machine whose time for a frame is known, and 30 pictures a second."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightdepth.live.range_control import RangeControl

PERIOD_MS = 33.3


class Machine:
    """Takes `fixed_ms` and `each_ms` for every range; drops what comes meanwhile."""

    def __init__(self, most):
        self.control = RangeControl(most)
        self.now_ns = 0
        self.ranges = most

    def run(self, seconds, fixed_ms, each_ms):
        """n after each frame."""
        told, end_ns = [], self.now_ns + round(seconds * 1e9)
        while self.now_ns < end_ns:
            busy_ms = fixed_ms + each_ms * self.ranges
            self.now_ns += round(max(busy_ms, PERIOD_MS) * 1e6)
            self.ranges = self.control.add(self.now_ns, busy_ms, PERIOD_MS)
            told.append(self.ranges)
        return told


def test_a_fast_machine_keeps_all():
    assert set(Machine(4).run(60, 5, 4)) == {4}


def test_a_slow_machine_falls_to_one_within_seconds_and_no_lower():
    machine = Machine(4)
    machine.run(4, 30, 10)
    assert set(machine.run(60, 30, 10)) == {1}


def test_it_settles_where_the_work_fits():
    machine = Machine(4)
    machine.run(5, 10, 9)  # 28 ms for two, 37 for three
    told = machine.run(120, 10, 9)
    assert set(told) == {2}


def test_it_comes_back_when_the_load_is_gone():
    machine = Machine(3)
    machine.run(10, 60, 10)
    assert machine.ranges == 1
    machine.run(15, 5, 4)
    assert machine.ranges == 3


def test_trials_that_fail_become_rare():
    machine = Machine(2)
    machine.run(5, 5, 16)  # 21 ms for one has room, 37 for two does not fit
    told = machine.run(300, 5, 16)
    rises = sum(b > a for a, b in pairwise(told))
    assert 2 <= rises <= 12
    assert told.count(2) / len(told) < 0.05


def test_ranges_that_nearly_fill_the_time_are_kept():
    """28 to 33 ms of 33.3: no picture waits, so the second range costs nothing but its own time."""
    machine = Machine(2)
    rng = np.random.default_rng(5)
    told = [n for _ in range(2000) for n in machine.run(0.01, 16 + rng.uniform(-2, 4), 7.0)]
    assert set(told) == {2}


def test_on_the_brink_n_does_not_swing():
    """One range has room, two do not, and every frame takes another time: at most a trial a minute in the end."""
    machine = Machine(2)
    rng = np.random.default_rng(6)
    told = [n for _ in range(20_000) for n in machine.run(0.01, 16 + rng.uniform(-6, 6), 9.5)]
    changes = np.flatnonzero(np.diff(told))
    assert 2 <= len(changes) < 40
    assert len(changes[changes > len(told) / 2]) <= 12


def test_one_slow_frame_changes_nothing():
    machine = Machine(2)
    machine.run(5, 8, 6)
    machine.run(0.05, 90, 6)
    assert set(machine.run(5, 8, 6)) == {2}


@given(st.integers(1, 4), st.lists(st.tuples(st.floats(0, 500), st.floats(1, 200)), max_size=200))
def test_n_stays_within_its_bounds_and_moves_by_one(most, frames):
    control, now_ns, before = RangeControl(most), 0, most
    for busy_ms, period_ms in frames:
        now_ns += round(max(busy_ms, period_ms) * 1e6)
        n = control.add(now_ns, busy_ms, period_ms)
        assert 1 <= n <= most
        assert abs(n - before) <= 1
        before = n


class Load:
    """20 pictures a second, whose work takes a share of the time between two, whatever n is."""

    def __init__(self, most):
        self.control, self.frames = RangeControl(most), 0

    def run(self, share, frames):
        """n after each frame."""
        return [self.frame(share) for _ in range(frames)]

    def frame(self, share):
        self.frames += 1
        return self.control.add(self.frames * 50_000_000, 50.0 * share, 50.0)

    def seconds_until(self, n, share):
        """How long it takes until n is that."""
        for frame in range(1, 2000):
            if self.frame(share) == n:
                return frame / 20
        raise AssertionError(f"never {n}")


@pytest.mark.parametrize(("share", "falls"), [(0.96, False), (0.98, True)])
def test_n_falls_where_work_takes_97_percent_of_the_time(share, falls):
    assert (Load(2).run(share, 200)[-1] == 1) == falls


@pytest.mark.parametrize(("share", "rises"), [(0.81, True), (0.83, False)])
def test_n_rises_where_work_takes_82_percent_of_the_time(share, rises):
    load = Load(2)
    load.seconds_until(1, 1.5)
    assert (2 in load.run(share, 100)) == rises


def test_between_two_falls_is_half_a_second():
    load = Load(4)
    load.seconds_until(3, 2.0)
    assert [load.seconds_until(n, 2.0) for n in (2, 1)] == [0.5, 0.5]


def test_room_must_last_two_seconds():
    load = Load(2)
    load.seconds_until(1, 1.5)
    assert load.seconds_until(2, 0.5) == pytest.approx(2.0, abs=0.051)


def test_room_that_ends_in_between_does_not_count():
    load = Load(2)
    load.seconds_until(1, 1.5)
    for ends in (0.95, 1.1):  # none for another range, and none for this one
        for _ in range(5):
            assert set(load.run(0.5, 30) + load.run(ends, 20)) == {1}


def test_waits_between_trials_that_fail_double_up_to_a_minute():
    told = [2, *Machine(2).run(330, 5, 16)]
    changes = np.array([i for i, (a, b) in enumerate(pairwise(told)) if a != b])
    waits_s = np.diff(changes)[::2] * PERIOD_MS / 1e3  # from a fall to the next rise, at one range
    assert waits_s == pytest.approx([2, 4, 8, 16, 32, 64, 64, 64, 64], abs=0.2)


@pytest.mark.parametrize(("held_s", "wait_s"), [(4.8, 16.0), (5.2, 2.0)])
def test_after_a_trial_that_held_five_seconds_the_wait_is_short_again(held_s, wait_s):
    load = Load(2)
    for wait in (2.0, 4.0, 8.0):
        load.seconds_until(1, 1.5)
        assert load.seconds_until(2, 0.5) == pytest.approx(wait, abs=0.051)
    load.run(0.9, round(20 * held_s) - 1)
    assert load.frame(30.0) == 1
    assert load.seconds_until(2, 0.5) == pytest.approx(wait_s, abs=0.051)


def test_a_fall_that_no_trial_came_before_does_not_lengthen_the_wait():
    load = Load(4)
    load.seconds_until(1, 2.0)
    assert load.seconds_until(2, 0.5) == pytest.approx(2.0, abs=0.051)


def test_the_load_is_a_mean_over_a_third_of_a_second():
    """From half of the time to one and a half: a tenth of the step with each of 30 pictures a second."""
    control = RangeControl(2)
    for i in range(60):
        control.add(i * 33_300_000, 0.5 * 33.3, 33.3)
    told = [control.add((60 + i) * 33_300_000, 1.5 * 33.3, 33.3) for i in range(10)]
    assert told.index(1) + 1 == next(k for k in range(1, 10) if 1.5 - 0.9**k > 0.97) == 7


def test_pictures_a_second_apart_count_each_for_itself():
    control = RangeControl(2)
    told = [control.add((1 + i) * 10**9, busy_ms, 1000.0) for i, busy_ms in enumerate((500.0, 700.0, 980.0))]
    assert told == [2, 2, 1]


def test_one_picture_that_took_too_long_ends_the_room_before_it():
    control = RangeControl(2)
    busy_ms = (1500.0, 500.0, 1500.0, 500.0, 500.0, 500.0)
    assert [control.add((1 + i) * 10**9, each, 1000.0) for i, each in enumerate(busy_ms)] == [1] * 5 + [2]


def test_a_stream_that_gives_no_time_is_too_fast_for_any_machine():
    assert RangeControl(2).add(10**9, 5.0, 0.0) == 1
