"""Positions in metres: they reach the estimator as they are, and velocities along them go the same way."""

import numpy as np
import pytest

from flightdepth.errors import BadInput
from flightdepth.flight.metric_positions import LEAST_STEP_S, samples_along
from flightdepth.flight.records import PositionSample, VelocitySample
from flightdepth.flight.telemetry_csv import read_csv
from flightdepth.ranges.displacement import Trajectory

S = 10**9


def curve(at_s):
    return np.stack([5 * np.sin(at_s), 3 * np.cos(1.5 * at_s), 0.4 * at_s**2], axis=-1)


def of_kind(samples, kind):
    return [sample for sample in samples if isinstance(sample, kind)]


def positions_of(samples, at_ns):
    trajectory = Trajectory()
    for sample in of_kind(samples, PositionSample):
        trajectory.add_position(sample.stamp_ns, sample.position_ned)
    assert not trajectory.dropped
    return trajectory.at(np.asarray(at_ns, dtype=np.int64)).position_m


def summed(samples, at_ns):
    trajectory = Trajectory()
    for sample in of_kind(samples, VelocitySample):
        trajectory.add_velocity(sample.stamp_ns, sample.velocity, frame=sample.frame, sigma=sample.sigma)
    assert not trajectory.dropped
    return trajectory.at(np.asarray(at_ns, dtype=np.int64)).position_m


@pytest.mark.parametrize("rate_hz", [5, 30, 200])
def test_positions_come_as_they_are_and_velocities_lead_along_them(rate_hz):
    at_ns = np.arange(0, 4 * S, S // rate_hz)
    ned = curve(at_ns / S)
    samples = samples_along(at_ns, ned)
    np.testing.assert_allclose(positions_of(samples, at_ns), ned, atol=1e-9)
    inside = at_ns[(at_ns > S) & (at_ns < 3 * S)]
    flown = summed(samples, inside)
    np.testing.assert_allclose(flown - flown[0], curve(inside / S) - curve(inside[0] / S), atol=0.15)
    velocity = np.array([sample.velocity for sample in of_kind(samples, VelocitySample)])
    told_s = np.array([sample.stamp_ns for sample in of_kind(samples, VelocitySample)]) / S
    exact = np.stack([5 * np.cos(told_s), -4.5 * np.sin(1.5 * told_s), 0.8 * told_s], axis=1)
    assert np.abs(velocity - exact)[1:-1].max() < 0.2  # its ends look to one side


def test_velocities_of_dense_positions_are_told_seldom_so_that_noise_is_none():
    rng = np.random.default_rng(2)
    at_ns = np.arange(0, 4 * S, S // 200)
    ned = curve(at_ns / S) + rng.normal(0, 0.01, (len(at_ns), 3))
    samples = samples_along(at_ns, ned)
    told = of_kind(samples, VelocitySample)
    assert np.diff([sample.stamp_ns for sample in told]).min() >= 0.99 * LEAST_STEP_S * S
    told_s = np.array([sample.stamp_ns for sample in told]) / S
    exact = np.stack([5 * np.cos(told_s), -4.5 * np.sin(1.5 * told_s), 0.8 * told_s], axis=1)
    off = np.array([sample.velocity for sample in told]) - exact
    assert np.sqrt((off[1:-1] ** 2).mean()) < 0.1
    assert np.sqrt(((positions_of(samples, at_ns) - curve(at_ns / S)) ** 2).mean()) < 0.012


@pytest.mark.parametrize(
    ("log_hz", "fix_hz", "speed_m_s"), [(50, 5, 5), (50, 5, 10), (20, 5, 3), (100, 30, 15)]
)
def test_positions_that_repeat_until_the_next_fix_are_one(log_hz, fix_hz, speed_m_s):
    """Taken as they stood, a steady flight went to and fro: 5 m/s were -3."""
    at_ns = np.arange(0, 6 * S, S // log_hz)
    fixed_s = np.floor(at_ns / S * fix_hz + 1e-9) / fix_hz
    samples = samples_along(at_ns, np.outer(speed_m_s * fixed_s, [1, 0, 0]))
    velocity = np.array([sample.velocity for sample in of_kind(samples, VelocitySample)])
    np.testing.assert_allclose(velocity[1:-1].mean(axis=0), [speed_m_s, 0, 0], rtol=0.02)
    flown = positions_of(samples, [S, 5 * S])
    assert flown[1, 0] - flown[0, 0] == pytest.approx(4 * speed_m_s, rel=0.02)


def test_no_velocity_is_told_across_a_gap_or_a_jump():
    at_ns = np.array([0, 0.5, 1, 6, 6.5, 7, 7.5]) * S
    ned = curve(at_ns / S)
    ned[5:] += 1000
    told = of_kind(samples_along(at_ns.astype(np.int64), ned), VelocitySample)
    assert [sample.stamp_ns / S for sample in told] == [0, 0.5, 1, 6, 6.5, 7, 7.5]
    assert all(np.linalg.norm(sample.velocity) < 20 for sample in told)
    alone = of_kind(samples_along(at_ns[[0, 1, 3]].astype(np.int64), ned[[0, 1, 3]]), VelocitySample)
    assert [sample.stamp_ns / S for sample in alone] == [0, 0.5]


@pytest.mark.parametrize("at_ns", [[0], [0, 9 * S]])
def test_positions_that_stand_alone_tell_nothing(at_ns):
    assert samples_along(np.array(at_ns), np.arange(3.0 * len(at_ns)).reshape(-1, 3)) == []


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
    np.testing.assert_allclose(positions_of(log.samples, at_ns), curve(at_ns / S), atol=1e-9)
    later = log.later_by(S)
    np.testing.assert_allclose(positions_of(later.samples, at_ns + S), curve(at_ns / S), atol=1e-9)
    moved = path.read_text().replace("0,0,0.0,3.0", "0,0,0.1,3.0")
    path.write_text(moved)
    assert read_csv(path).digest != log.digest == log.later_by(0).digest


def test_a_velocity_that_is_told_comes_before_positions(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("time_s,north_m,east_m,down_m,vn_m_s,ve_m_s,vd_m_s\n0,0,0,0,7,0,0\n1,1,0,0,7,0,0\n")
    log = read_csv(path)
    assert [sample.velocity[0] for sample in log.samples] == [7, 7]
    assert "ignored columns: north_m, east_m, down_m" in log.name


@pytest.mark.parametrize(
    ("said", "text"),
    [
        ("all of north_m, east_m, down_m, got no down_m", "time_s,north_m,east_m\n0,1,2\n"),
        ("line 3.*a finite number for east_m, got ''", "time_s,north_m,east_m,down_m\n0,1,2,3\n1,2,,3\n"),
        ("two positions or more within 1.5 s, got none", "time_s,north_m,east_m,down_m\n0,1,2,3\n"),
        ("two positions or more within 1.5 s", "time_s,north_m,east_m,down_m\n0,1,2,3\n2,4,2,3\n4,7,2,3\n"),
    ],
)
def test_what_is_wrong_with_positions_is_said(tmp_path, said, text):
    path = tmp_path / "log.csv"
    path.write_text(text)
    with pytest.raises(BadInput, match=said):
        read_csv(path)


@pytest.mark.parametrize("position", [[1, 2], [1, 2, np.nan], np.zeros((3, 1))])
def test_a_position_that_is_none_is_refused(position):
    with pytest.raises(BadInput, match="position"):
        PositionSample(0, position)
