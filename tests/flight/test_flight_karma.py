"""The real flight: a GoPro Karma along a cliff. The file is not part of the repository."""

import os
from pathlib import Path

import numpy as np
import pytest

from flightdepth.flight import Frame, Steadiness, VelocitySample, open_flight
from flightdepth.flight.positions import local_ned
from flightdepth.ranges.displacement import integrate

SHARED = Path(os.environ.get("FLIGHTDEPTH_SHARED", Path(__file__).parents[3] / "shared"))
KARMA = SHARED / "data" / "karma.mp4"
FIRST_OWN_MS, CLOCK_AT_VIDEO_START_MS = 146065, 146165  # the latter was fitted on the images
pytestmark = pytest.mark.skipif(not KARMA.is_file(), reason=f"the real flight is not at {KARMA}")


@pytest.fixture(scope="module")
def judged():
    """Items of the flight, and the turn rate of each frame."""
    with open_flight(KARMA, hfov_deg=64.4) as flight:
        steadiness = Steadiness(flight.camera, flight.gyroscope)
        items, rates = [], []
        for item in flight:
            if isinstance(item, Frame):
                rates.append(steadiness.add(item.stamp_ns, item.image))
            items.append(item.stamp_ns if isinstance(item, Frame) else item)
        return flight, items, rates


def test_all_frames_and_velocities_come(judged):
    flight, items, rates = judged
    assert len(rates) == 362
    assert sum(isinstance(item, VelocitySample) for item in items) == 47
    assert flight.counts == {}


def test_its_way_follows_the_positions_that_its_drone_tells(judged):
    """81 m along the cliff of Carlsbad: summed velocities end within 3 m of where the drone says that it is."""
    flight, items, _ = judged
    track = flight.places
    assert track.above == "mean sea level"
    assert track.at(6 * 10**9)[:2] == pytest.approx((33.1257, -117.3312), abs=1e-4)
    velocities = [item for item in items if isinstance(item, VelocitySample)]
    stamps = np.array([item.stamp_ns for item in velocities])
    way, _ = integrate(stamps, np.array([item.velocity for item in velocities]), track.stamps_ns)
    apart = way - local_ned(track.places[:, :2], track.places[:, 2])
    assert np.linalg.norm((apart - np.median(apart, axis=0))[:, :2], axis=1).max() < 3.5


def test_the_speed_rises_from_1_to_8_m_s(judged):
    speeds = [np.linalg.norm(item.velocity) for item in judged[1] if isinstance(item, VelocitySample)]
    assert speeds[0] == pytest.approx(1.17, abs=0.01)
    assert max(speeds) == pytest.approx(8.40, abs=0.01)


def test_the_clock_is_right_to_a_tenth_of_a_second(judged):
    first = next(item for item in judged[1] if isinstance(item, VelocitySample))
    assert first.stamp_ns / 1e6 == pytest.approx(FIRST_OWN_MS - CLOCK_AT_VIDEO_START_MS, abs=100)


def test_velocities_reach_frame_344(judged):
    stamps = [item.stamp_ns for item in judged[1] if isinstance(item, VelocitySample)]
    frames = [item for item in judged[1] if not isinstance(item, VelocitySample)]
    assert abs(stamps[-1] - frames[344]) < 0.15e9


def test_the_steady_part_is_not_flagged(judged):
    assert all(rate.usable for rate in judged[2][:346])


def test_the_pan_is_flagged_to_the_end(judged):
    assert not any(rate.usable for rate in judged[2][351:])


def test_its_turns_tell_the_fisheye_through_which_tracked_points_are_to_scale():
    """Through it their slope is -0.97, through 64.4 degrees -0.81 (docs/log.md)."""
    with open_flight(KARMA) as flight:
        assert flight.camera.model == "fisheye"
        assert flight.camera.fx == pytest.approx(555, rel=0.05)
        assert "turned by" in flight.camera_source
