"""Subtitles that real drones wrote, beside what stands in them (tests/flight/dji)."""

import re
from pathlib import Path

import numpy as np
import pytest

from flightdepth.flight.inside import read_inside
from flightdepth.flight.open import open_flight
from flightdepth.flight.records import AttitudeSample
from flightdepth.flight.telemetry import read_telemetry
from flightdepth.motion import rotation_from_quaternion

SAMPLES = Path(__file__).parent / "dji"
PHANTOM, MAVIC = SAMPLES / "phantom_4_rtk.SRT", SAMPLES / "mavic_2_pro.SRT"
JOINED_S = 106.84, 106.92  # the last subtitle of one recording, the first of the next


def told(pattern):
    return np.array(re.findall(pattern, PHANTOM.read_text()), dtype=np.float64)


def velocities_of(log):
    stamps_s = np.array([sample.stamp_ns for sample in log.velocities]) * 1e-9
    return stamps_s, np.array([sample.velocity for sample in log.velocities])


def test_a_phantoms_speed_is_the_one_it_says_and_its_way_that_of_its_positions():
    log = read_telemetry(PHANTOM)
    stamps_s, velocity = velocities_of(log)
    assert len(velocity) == 55
    assert not log.counts
    speeds = np.linalg.norm(velocity[:, :2], axis=1)
    assert speeds == pytest.approx(told(r"H\.S ([\d.]+)m/s"), abs=0.005)
    lon_lat = told(r"GPS \(([-\d.]+), ([-\d.]+), \d+\)")
    # Lengths of a degree at 34.238 degrees south, WGS 84 (tables of the US NGA).
    flown_m = (lon_lat[-1] - lon_lat[0])[::-1] * [110_927.0, 92_114.0]
    assert np.trapezoid(velocity[:, :2], stamps_s, axis=0) == pytest.approx(flown_m, rel=0.02, abs=5)


def test_a_phantoms_camera_looks_where_its_gimbal_says():
    attitudes = [sample for sample in read_telemetry(PHANTOM).samples if isinstance(sample, AttitudeSample)]
    pitch_deg, _, yaw_deg = told(r"G\.PRY \(([-\d.]+)°, ([-\d.]+)°, ([-\d.]+)°\)").T
    ahead = np.array([rotation_from_quaternion(each.world_from_camera)[:, 2] for each in attitudes])
    assert len(ahead) == 55
    assert np.degrees(np.arcsin(-ahead[:, 2])) == pytest.approx(pitch_deg, abs=0.01)
    assert np.degrees(np.arctan2(ahead[:, 1], ahead[:, 0])) == pytest.approx(yaw_deg, abs=0.01)


def test_where_two_recordings_are_joined_the_velocity_is_unknown_and_elsewhere_it_is_not():
    """It was 146 m/s there, give or take 28."""
    log = read_telemetry(MAVIC)
    stamps_s, velocity = velocities_of(log)
    sigma = np.array([sample.sigma for sample in log.velocities])
    near = (stamps_s > JOINED_S[0] - 0.6) & (stamps_s < JOINED_S[1] + 0.6)
    assert (sigma[stamps_s == pytest.approx(106.68)] == 150).all()
    speeds = np.linalg.norm(velocity, axis=1)
    assert (speeds[~near] < 16).all()
    assert (sigma[~near] < 1).all()
    assert (sigma[speeds > 16] == 150).all()


@pytest.mark.parametrize("ending", ["mp4", "mkv"])
def test_subtitles_inside_a_video_tell_what_their_file_tells(ending):
    """The same subtitles, muxed by FFmpeg."""
    inside, beside = read_inside(SAMPLES / f"phantom_4_rtk.{ending}"), read_telemetry(PHANTOM)
    assert inside.name == "DJI subtitles in the video: 55 velocities from positions, gimbal attitude"
    assert inside.digest == beside.digest
    assert not inside.counts


def test_a_video_with_subtitles_inside_needs_no_log(tmp_path):
    with open_flight(SAMPLES / "phantom_4_rtk.mp4", hfov_deg=70) as flight:
        samples = [event for event in flight if isinstance(event, AttitudeSample)]
    assert "DJI subtitles in the video" in flight.telemetry_name
    assert len(samples) == 55
