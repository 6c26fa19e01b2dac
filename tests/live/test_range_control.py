"""How n follows the load: a machine whose time for a frame is known, and 30 pictures a second."""

from itertools import pairwise

import numpy as np
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
