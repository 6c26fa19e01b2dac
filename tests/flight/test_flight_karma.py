"""The real flight: a GoPro Karma along a cliff. The file is not part of the repository."""

import os
from pathlib import Path

import numpy as np
import pytest

from flightdepth.flight import Frame, Steadiness, VelocitySample, gpmf_telemetry, open_flight
from flightdepth.flight.gpmf import streams
from flightdepth.flight.gpmf_telemetry import payloads
from flightdepth.flight.positions import local_ned
from flightdepth.ranges.displacement import integrate

SHARED = Path(os.environ.get("FLIGHTDEPTH_SHARED", Path(__file__).parents[3] / "shared"))
KARMA = SHARED / "data" / "karma.mp4"
FIRST_OWN_S = 146.065  # of the drone's clock, the first velocity
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


def test_what_the_drone_itself_says_of_its_velocity_is_doubted_by_its_positions(judged, monkeypatch):
    """Until both were brought together depth was so much too far, and `run` said nothing."""
    assert not any("positions tell" in line for line in judged[0].warnings)
    monkeypatch.setattr(gpmf_telemetry, "MOST_WRONG_M_S", 0.0)
    with open_flight(KARMA, hfov_deg=64.4) as flight:
        (line,) = (line for line in flight.warnings if "positions tell" in line)
    assert "is 4.2 % longer" in line and "so much too far" in line


@pytest.fixture(scope="module")
def told():
    """What the drone and the camera tell, by stream: times of the payloads, s of the video, and samples."""
    found = {}
    for interval, payload in payloads(KARMA):
        for stream in streams(payload, frozenset({"ATTD", "ACCL", "GPRI"})):
            count = len(stream.values)
            times = np.linspace(interval.start_ns, interval.end_ns, count, endpoint=False) / 1e9
            found.setdefault(stream.key, []).append(np.c_[times, stream.values])
    return {key: np.concatenate(rows) for key, rows in found.items()}


def test_the_speed_rises_from_1_to_8_m_s_as_the_receiver_says(judged, told):
    """By Doppler, which the drone's own filter of velocity is 3 to 4 % above."""
    samples = [item for item in judged[1] if isinstance(item, VelocitySample)]
    speeds = np.array([np.linalg.norm(item.velocity) for item in samples])
    assert speeds[0] == pytest.approx(1, abs=0.1)
    own_s, doppler = told["GPRI"][:, 1], told["GPRI"][:, 7]
    times_s = FIRST_OWN_S + (np.array([item.stamp_ns for item in samples]) - samples[0].stamp_ns) / 1e9
    steady = (times_s > times_s[0] + 4) & (times_s < own_s[-1])  # a receiver lags where it speeds up
    ratio = speeds[steady] / np.interp(times_s[steady], own_s, doppler)
    assert np.median(ratio) == pytest.approx(1, abs=0.01)


def test_the_clock_is_that_of_the_cameras_accelerometer(judged, told):
    """What a drone's pitch of sin(p) gives, g sin(p), the camera on it feels: at that time only, and as much.

    An older fit, on images through a lens of 64 degrees and with the drone's own velocities, was 0.23 s off.
    """
    own_s, pitch = told["ATTD"][:, 1], told["ATTD"][:, 3]
    feels = np.convolve(
        told["ACCL"][:, 3], np.ones(50) / 50, "same"
    )  # forward, m/s^2, over a quarter of a second
    speeds = [np.linalg.norm(item.velocity) for item in judged[1] if isinstance(item, VelocitySample)]
    fits = {}
    for start_s in np.arange(145.9, 146.8, 0.01):
        used = (own_s > start_s + 0.2) & (own_s < start_s + 7)  # before the pan
        felt = np.interp(own_s[used] - start_s, told["ACCL"][:, 0], feels)
        causes = np.c_[np.sin(pitch[used]), np.array(speeds)[used], np.ones(used.sum())]  # and drag
        factors, misfit = np.linalg.lstsq(causes, felt, rcond=None)[:2]
        fits[start_s] = misfit[0], factors[0]
    start_s = min(fits, key=fits.get)
    assert fits[start_s][1] == pytest.approx(9.8, rel=0.05)
    first = next(item for item in judged[1] if isinstance(item, VelocitySample))
    assert first.stamp_ns / 1e9 == pytest.approx(FIRST_OWN_S - start_s, abs=0.06)


def test_velocities_reach_frame_338(judged):
    stamps = [item.stamp_ns for item in judged[1] if isinstance(item, VelocitySample)]
    frames = [item for item in judged[1] if not isinstance(item, VelocitySample)]
    assert abs(stamps[-1] - frames[338]) < 0.05e9


def test_the_steady_part_is_not_flagged(judged):
    assert all(rate.usable for rate in judged[2][:346])


def test_the_pan_is_flagged_to_the_end(judged):
    assert not any(rate.usable for rate in judged[2][351:])


def test_its_turns_tell_the_fisheye_through_which_tracked_points_are_to_scale():
    """With the log as the drone has it their slope was -0.97, through 64.4 degrees -0.81 (docs/log.md)."""
    with open_flight(KARMA) as flight:
        assert flight.camera.model == "fisheye"
        assert flight.camera.fx == pytest.approx(555, rel=0.05)
        assert "turned by" in flight.camera_source
