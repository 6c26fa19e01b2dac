import math

import numpy as np
import pytest
from flight_files import make_video

from flightdepth.errors import BadInput
from flightdepth.flight import GyroscopeTrack, Telemetry, VelocitySample, open_flight
from flightdepth.flight.records import BodyAttitudeSample
from tests_logs import dataflash_flight, tlog_flight, ulog_flight, velocity, written

S = 1_000_000_000


@pytest.fixture
def video(tmp_path):
    return make_video(tmp_path / "v.mp4", range(0, 2000, 40))


@pytest.mark.parametrize("flight", [ulog_flight, dataflash_flight, tlog_flight])
def test_an_autopilots_log_flies_with_the_video(video, tmp_path, flight):
    log = written(tmp_path / "log", flight(60))
    with open_flight(video, log, hfov_deg=60, telemetry_offset_s=-3.0) as opened:
        velocities = [item for item in opened if isinstance(item, VelocitySample)]
        assert " 60 velocities" in opened.telemetry_name
    at_the_first_picture = next(sample for sample in velocities if sample.stamp_ns == 0)
    assert tuple(at_the_first_picture.velocity) == velocity(30)


def test_all_times_move():
    body = BodyAttitudeSample(5, np.array([1.0, 0, 0, 0]))
    track = GyroscopeTrack(np.array([1, 2]), np.zeros((2, 3)))
    telemetry = Telemetry("t", (VelocitySample(7, [1, 2, 3]),), {"x": 1}, track, (body,)).later_by(-S)
    assert telemetry.samples[0].stamp_ns == 7 - S
    assert telemetry.body_attitudes[0].stamp_ns == 5 - S
    assert telemetry.gyroscope.stamps_ns.tolist() == [1 - S, 2 - S]
    assert telemetry.counts == {"x": 1}


def test_a_log_that_misses_the_video_says_how_to_move_it(video, tmp_path):
    log = written(tmp_path / "log", ulog_flight(60))
    with pytest.raises(BadInput, match="--telemetry-offset"):
        open_flight(video, log, hfov_deg=60, telemetry_offset_s=100.0)


@pytest.mark.parametrize("offset", [math.nan, math.inf, 1e30])
def test_an_offset_that_is_no_number(video, tmp_path, offset):
    with pytest.raises(BadInput, match="--telemetry-offset: expected a finite"):
        open_flight(video, written(tmp_path / "log", ulog_flight(9)), hfov_deg=60, telemetry_offset_s=offset)
