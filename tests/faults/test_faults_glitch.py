"""Faults 12 and 14, whichever the log: the estimator's own gates."""

import numpy as np
import pytest

from flightdepth.errors import BadInput
from flightdepth.ranges.displacement import Trajectory

STEP_NS = 100_000_000


def trajectory(velocities, *, step_ns=STEP_NS):
    made = Trajectory()
    for index, velocity in enumerate(velocities):
        made.add_velocity(index * step_ns, velocity, frame="world", sigma=None)
    return made


@pytest.mark.parametrize("at", [1, 5, 18])
def test_fault_14_a_glitch_of_100_m_s_is_dropped_and_counted(at):
    steady = [(3.0, 0.0, 0.0)] * 20
    glitched = [*steady[:at], (100.0, 0.0, 0.0), *steady[at + 1 :]]
    made = trajectory(glitched)
    flown = made.at(np.array([0, 19 * STEP_NS])).position_m
    assert flown[1] - flown[0] == pytest.approx([3.0 * 1.9, 0, 0])
    assert made.dropped == {"velocity glitch": 1}


def test_fault_14_a_real_change_of_speed_is_kept():
    made = trajectory([(3.0, 0, 0)] * 10 + [(12.0, 0, 0)] * 10)
    assert made.dropped == {}
    flown = made.at(np.array([11 * STEP_NS, 19 * STEP_NS])).position_m
    assert flown[1] - flown[0] == pytest.approx([12.0 * 0.8, 0, 0])


@pytest.mark.parametrize("bad", [(np.nan, 0, 0), (0, np.inf, 0), (0, 0, -np.inf)])
def test_fault_14_an_estimator_refuses_what_is_no_number(bad):
    with pytest.raises(BadInput, match="three finite numbers in m/s"):
        trajectory([bad])


def test_fault_12_a_clock_that_starts_again_is_not_integrated():
    """A stream whose stamps restart gives nothing until they pass the last one; what comes then is a new segment."""
    made = trajectory([(3.0, 0, 0)] * 10)
    for index in range(40):
        made.add_velocity(index * STEP_NS // 2 + 5, (3.0, 0, 0), frame="world", sigma=None)
    assert made.dropped["velocity not after the one before"] == 18  # those up to 0.9 s
    made.add_velocity(60 * STEP_NS, (3.0, 0, 0), frame="world", sigma=None)
    states = made.at(np.array([19 * STEP_NS, 60 * STEP_NS]))
    assert states.segment[0] != states.segment[1]
