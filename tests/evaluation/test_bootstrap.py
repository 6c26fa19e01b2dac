"""Intervals by drawing again."""

import numpy as np

from flightdepth.evaluation.bootstrap import AT_ONCE, DRAWS, interval, with_ends


def test_a_long_flight_s_values_are_not_drawn_all_at_once():
    """2,000 draws of 100,000 tracks were 1.6 GB and as much again for their medians."""
    values, sizes = np.random.default_rng(1).normal(size=9_001), []

    def mean(drawn, axis=None):
        sizes.append(drawn.size)
        return np.mean(drawn, axis=axis)

    found = with_ends(values, mean)
    assert max(sizes) <= AT_ONCE
    at_once = np.random.default_rng(0).choice(values, (DRAWS, values.size)).mean(axis=1)
    assert found == (values.mean(), *np.percentile(at_once, [2.5, 97.5]))


def test_an_interval_holds_the_mean_of_one_value_and_none_of_nothing():
    assert with_ends(np.array([3.0]), np.mean) == (3, 3, 3)
    assert np.isnan(with_ends(np.zeros(0), np.mean)).all()


def test_an_interval_over_frames_is_that_of_their_mean():
    found = interval([1.0, 2.0, float("nan"), 9.0])
    assert (found["mean"], found["frames"]) == (4, 3)
    assert found["low"] < 4 < found["high"]
