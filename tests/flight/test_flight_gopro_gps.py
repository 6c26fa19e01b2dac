"""A GoPro's own GPS, in payloads laid out as GoPro describes them, inside a real MP4."""

from collections import Counter

import numpy as np
import pytest
from flight_files import add_gpmf, gps5_payload, gps9_payload, lned_payload, make_video

from flightdepth.errors import BadInput
from flightdepth.flight.gopro_gps import NO_FIX, gps_velocities
from flightdepth.flight.gpmf import Stream
from flightdepth.flight.gpmf_telemetry import read_gpmf

RATE_HZ = 18
NORTH_M_S, EAST_M_S, DOWN_M_S = 3.0, 4.0, -1.0
# Metres a degree at 48 north, WGS 84 (tables of the US NGA): latitude 111,200.0, longitude 74,632.
METRES = (111_200.0, 74_632.0)
SPEED = float(np.hypot(NORTH_M_S, EAST_M_S)), float(np.linalg.norm([NORTH_M_S, EAST_M_S, DOWN_M_S]))


def rows(seconds=3, speed=SPEED):
    times = np.arange(seconds * RATE_HZ) / RATE_HZ
    north, east, up = NORTH_M_S * times, EAST_M_S * times, -DOWN_M_S * times
    columns = (48 + north / METRES[0], 11 + east / METRES[1], 500 + up)
    return np.stack([*columns, *(np.full_like(times, each) for each in speed)], axis=1)


def in_seconds(samples):
    return [samples[first : first + RATE_HZ] for first in range(0, len(samples), RATE_HZ)]


@pytest.fixture
def plain(tmp_path):
    return make_video(tmp_path / "v.mp4", range(0, 3000, 40))


def with_time(samples, fix=3):
    more = np.tile([8000.0, 3600.0, 1.5, fix], (len(samples), 1))
    return np.concatenate([samples, more], axis=1)


@pytest.mark.parametrize("kind", ["GPS5", "GPS9"])
def test_velocity_north_east_down(plain, kind):
    parts = in_seconds(rows())
    payloads = [gps5_payload(p) if kind == "GPS5" else gps9_payload(with_time(p)) for p in parts]
    log = read_gpmf(add_gpmf(plain, payloads))
    found = np.array([sample.velocity for sample in log.samples])
    assert len(found) > 40
    assert np.abs(np.median(found, axis=0) - [NORTH_M_S, EAST_M_S, DOWN_M_S]).max() < 0.03
    assert {sample.frame for sample in log.samples} == {"world"}
    assert all(0 < sample.sigma < 0.5 for sample in log.samples)


def test_the_speed_is_the_receivers_and_the_direction_that_of_the_positions(plain):
    parts = [gps5_payload(p) for p in in_seconds(rows(speed=(10.0, 12.0)))]
    found = np.array([sample.velocity for sample in read_gpmf(add_gpmf(plain, parts)).samples])
    assert np.linalg.norm(found, axis=1) == pytest.approx(12.0, rel=0.01)
    assert np.median(found[:, 1] / found[:, 0]) == pytest.approx(EAST_M_S / NORTH_M_S, rel=0.02)


@pytest.mark.parametrize(("fix", "left_out"), [(0, 54), (1, 54), (2, 0), (3, 0)])
@pytest.mark.parametrize("key", ["GPS5", "GPS9"])
def test_a_fix_in_two_dimensions_is_one(key, fix, left_out):
    samples, counts = rows(), Counter()
    values = samples if key == "GPS5" else with_time(samples, fix)
    stream = Stream("camera", key, "GPS", (), values, fix=fix if key == "GPS5" else None)
    found = gps_velocities([stream], np.arange(len(samples)) * 10**9 // RATE_HZ, counts)
    assert counts[NO_FIX] == left_out
    assert (len(found) > 0) == (left_out == 0)


def test_samples_without_a_fix_are_left_out_and_counted(plain):
    first, second, third = in_seconds(rows())
    log = read_gpmf(add_gpmf(plain, [gps5_payload(first, fix=0), gps5_payload(second), gps5_payload(third)]))
    assert log.counts[NO_FIX] == RATE_HZ
    assert min(sample.stamp_ns for sample in log.samples) >= 10**9


def test_a_time_that_jumps_ahead_costs_itself_and_is_counted_as_such():
    stream = Stream("camera", "GPS5", "GPS", (), rows()[:40], fix=3)
    stamps_ns = np.arange(40) * 10**9 // RATE_HZ
    stamps_ns[2] = 10**11
    counts = Counter()
    found = gps_velocities([stream], stamps_ns, counts)
    assert +counts == {"GPS samples not later than the one before": 1}
    assert (np.diff(found.stamps_ns) > 0).all()
    assert found.stamps_ns.max() < 10**10


def test_a_receiver_that_never_had_a_fix_is_said_to_be_one(plain):
    parts = [gps9_payload(with_time(p, fix=0)) for p in in_seconds(rows())]
    with pytest.raises(BadInput, match=rf"54 {NO_FIX}.*--speed"):
        read_gpmf(add_gpmf(plain, parts))


def test_a_karmas_own_velocity_goes_before_the_cameras_gps(plain):
    parts = [lned_payload([(250 * k, 7.0, 0, 0) for k in range(4)]) + gps5_payload(rows(seconds=1))]
    log = read_gpmf(add_gpmf(plain, parts))
    assert "Local Position NED" in log.name


def test_payloads_of_different_widths_tell_one_flight():
    """They ended in a traceback: tables of 5 and of 6 columns cannot be joined."""
    table, stamps_ns = rows(), np.arange(54) * 10**9 // RATE_HZ
    parts = [table[:18], np.c_[table[18:36], np.zeros(18)], table[36:]]
    told, whole = (
        gps_velocities([Stream("camera", "GPS5", "GPS", (), p, fix=3) for p in each], stamps_ns, Counter())
        for each in (parts, [table])
    )
    np.testing.assert_array_equal(told.velocity_ned, whole.velocity_ned)
