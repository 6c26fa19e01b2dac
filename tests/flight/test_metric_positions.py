"""Velocities along positions lead back to them."""

from collections import Counter

import numpy as np
import pytest

from flightdepth.errors import BadInput
from flightdepth.flight.metric_positions import LEAST_STEP_S, velocities_along
from flightdepth.flight.telemetry_csv import read_csv
from flightdepth.ranges.displacement import Trajectory

S = 10**9


def curve(at_s):
    return np.stack([5 * np.sin(at_s), 3 * np.cos(2 * at_s), 0.4 * at_s**2], axis=-1)


def summed(samples, at_ns):
    trajectory = Trajectory()
    for sample in samples:
        trajectory.add_velocity(sample.stamp_ns, sample.velocity, frame=sample.frame, sigma=sample.sigma)
    assert not trajectory.dropped
    return trajectory.at(np.asarray(at_ns, dtype=np.int64))


def test_summed_they_lead_back_to_each_position():
    rng = np.random.default_rng(1)
    at_ns = np.cumsum(rng.integers(S // 20, S // 5, 40))
    ned = curve(at_ns / S) + rng.normal(0, 0.01, (40, 3))
    counts = Counter()
    states = summed(velocities_along(at_ns, ned, counts), at_ns)
    np.testing.assert_allclose(states.position_m - states.position_m[0], ned - ned[0], atol=1e-6)
    assert set(states.segment.tolist()) == {0} and not +counts


def test_between_positions_they_follow_a_curve():
    """Less than half of the error of straight lines between the positions, ten a period."""
    at_ns, between_ns = np.arange(0, 16 * S, 4 * S // 10), np.arange(4 * S, 12 * S, S // 23)
    samples = velocities_along(at_ns, curve(1.2 * at_ns / S), Counter())
    position, truth = summed(samples, between_ns).position_m, curve(1.2 * between_ns / S)
    straight = np.stack([np.interp(between_ns, at_ns, each) for each in curve(1.2 * at_ns / S).T], axis=1)
    off, off_straight = (np.abs(each - each[0] - truth + truth[0]).mean() for each in (position, straight))
    assert off < off_straight / 2


def test_dense_positions_are_thinned_so_that_their_noise_is_no_velocity():
    rng = np.random.default_rng(2)
    at_ns = np.arange(0, 2 * S, S // 400)
    samples = velocities_along(at_ns, curve(at_ns / S) + rng.normal(0, 0.002, (len(at_ns), 3)), Counter())
    stamps = np.array([sample.stamp_ns for sample in samples[::2]])
    assert np.diff(stamps).min() >= 0.99 * LEAST_STEP_S * S
    speed = np.gradient(curve(at_ns / S), at_ns / S, axis=0)
    told = np.array([sample.velocity for sample in samples])
    expected = np.stack([np.interp([s.stamp_ns for s in samples], at_ns, each) for each in speed.T], axis=1)
    assert np.abs(told - expected).max() < 1


def test_nothing_is_summed_across_a_gap_or_a_jump():
    at_ns = np.array([0, 1, 2, 6, 7, 8, 9]) * S // 4 * 2
    at_ns[3:] += 3 * S
    ned = curve(at_ns / S)
    ned[5:] += 1000
    counts = Counter()
    samples = velocities_along(at_ns, ned, counts)
    assert counts == {"positions that jump": 1}
    assert all(np.linalg.norm(sample.velocity) < 60 for sample in samples)
    assert len(samples) == 5 + 3 + 3


def test_a_single_position_tells_nothing():
    assert velocities_along(np.array([0]), np.zeros((1, 3)), Counter()) == []


def test_a_table_of_positions_is_a_log(tmp_path):
    path = tmp_path / "poses.csv"
    at_ns = np.arange(0, 2 * S, S // 20)
    rows = [
        f"{at},0,{north},{east},{down},1,0,0,0"
        for at, (north, east, down) in zip(at_ns, curve(at_ns / S), strict=True)
    ]
    path.write_text("stamp_ns,segment,north_m,east_m,down_m,qw,qx,qy,qz\n" + "\n".join(rows) + "\n")
    log = read_csv(path)
    assert log.name == "CSV poses.csv: velocity by its positions in metres, ignored columns: segment"
    assert len(log.attitudes) == len(at_ns) and not log.any_direction
    position = summed(log.velocities, at_ns).position_m
    np.testing.assert_allclose(position - position[0], curve(at_ns / S) - curve(0.0), atol=1e-6)


def test_a_velocity_that_is_told_comes_before_positions(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("time_s,north_m,east_m,down_m,vn_m_s,ve_m_s,vd_m_s\n0,0,0,0,7,0,0\n1,1,0,0,7,0,0\n")
    log = read_csv(path)
    assert [sample.velocity[0] for sample in log.velocities] == [7, 7]
    assert "ignored columns: north_m, east_m, down_m" in log.name


@pytest.mark.parametrize(
    ("said", "text"),
    [
        ("all of north_m, east_m, down_m, got no down_m", "time_s,north_m,east_m\n0,1,2\n"),
        ("line 3.*a finite number for east_m, got ''", "time_s,north_m,east_m,down_m\n0,1,2,3\n1,2,,3\n"),
        ("positions that tell one, got none", "time_s,north_m,east_m,down_m\n0,1,2,3\n"),
    ],
)
def test_what_is_wrong_with_positions_is_said(tmp_path, said, text):
    path = tmp_path / "log.csv"
    path.write_text(text)
    with pytest.raises(BadInput, match=said):
        read_csv(path)
