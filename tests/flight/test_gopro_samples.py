"""Payloads that real cameras wrote, beside what another program reads in them (tests/flight/gopro)."""

import json
from pathlib import Path

import numpy as np
import pytest
from flight_files import add_gpmf, make_video

from flightdepth.errors import BadInput
from flightdepth.flight.gpmf import HEADER, records, streams
from flightdepth.flight.gpmf_telemetry import read_gpmf

SAMPLES = Path(__file__).parent / "gopro"
TOLD = json.loads((SAMPLES / "gopro-telemetry.json").read_text())
STREAMS = [(camera, key) for camera, told in TOLD.items() for key in told]


def payloads(camera):
    data = (SAMPLES / f"{camera}.gpmf").read_bytes()
    return [HEADER.pack(b"DEVC", 0, record.size, record.repeat) + record.data for record in records(data)]


def log_of(tmp_path, camera):
    parts = payloads(camera)
    return read_gpmf(add_gpmf(make_video(tmp_path / "v.mp4", range(0, 1000 * len(parts), 50)), parts))


def positions_m(camera):
    """North, east of each sample of GPS5, by the length of a degree at 42 degrees north (tables of the US NGA)."""
    found = [stream.values for part in payloads(camera) for stream in streams(part, frozenset(["GPS5"]))]
    degrees = np.concatenate(found)[:, :2]
    return (degrees - degrees[0]) * [111_073.0, 82_850.0]


@pytest.mark.parametrize(("camera", "key"), STREAMS)
def test_each_stream_holds_what_another_program_reads(camera, key):
    found = [stream for part in payloads(camera) for stream in streams(part, frozenset([key]))]
    values, told = np.concatenate([stream.values for stream in found]), TOLD[camera][key]
    assert found[0].device == told["device"]
    assert len(values) == told["samples"]
    ends, told_ends = values[[0, -1]], np.array([told["first"], told["last"]])
    if key == "GYRO":  # that program turns its axes to those of the picture
        ends, told_ends = np.linalg.norm(ends, axis=1), np.linalg.norm(told_ends, axis=1)
    np.testing.assert_allclose(ends, told_ends, rtol=1e-12)
    assert found[0].fix == told.get("fix")


def test_a_hero7_that_moves_flies_the_way_between_its_positions(tmp_path):
    log = log_of(tmp_path, "hero7")
    stamps_s = np.array([sample.stamp_ns for sample in log.velocities]) * 1e-9
    velocity = np.array([sample.velocity for sample in log.velocities])
    way_m = np.trapezoid(velocity[:, :2], stamps_s, axis=0)
    assert way_m == pytest.approx(positions_m("hero7")[-1], rel=0.1)
    assert np.linalg.norm(velocity, axis=1).max() == pytest.approx(7.34, rel=0.01)  # as the receiver says


@pytest.mark.parametrize("camera", ["hero5", "hero11"])
def test_a_camera_at_rest_is_at_rest(tmp_path, camera):
    log = log_of(tmp_path, camera)
    assert len(log.velocities) >= 18
    assert max(np.linalg.norm(sample.velocity) for sample in log.velocities) < 0.7


def test_a_hero11_tells_its_velocity_by_gps9(tmp_path):
    assert "days, secs, DOP, fix" in log_of(tmp_path, "hero11").name


@pytest.mark.parametrize(
    ("camera", "utc"), [("hero5", "2017-04-17T17:31:03"), ("hero7", "2019-01-03T16:33:4")]
)
def test_the_time_of_day_is_the_satellites(tmp_path, camera, utc):
    told = log_of(tmp_path, camera).utc
    assert told.clock == "satellites"
    assert str(told).startswith(utc)


def test_a_hero6_without_a_fix_is_refused_with_what_to_give_instead(tmp_path):
    with pytest.raises(BadInput, match=r"Hero6 Black.*17 GPS samples without a fix.*--speed"):
        log_of(tmp_path, "hero6")


def test_a_karmas_track_holds_the_drones_velocity_and_the_cameras_gyroscope(tmp_path):
    log = log_of(tmp_path, "karma")
    assert "GoPro Karma v1.0, 4 velocities" in log.name
    assert len(log.gyroscope.stamps_ns) == 392
