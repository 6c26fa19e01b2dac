from dataclasses import replace

import numpy as np
import pytest

from flightdepth.errors import BadInput
from flightdepth.flight.places import SEA_LEVEL, PlaceTrack
from flightdepth.flight.records import (
    AttitudeSample,
    Frame,
    GyroscopeTrack,
    PositionSample,
    Telemetry,
    VelocitySample,
    ViewTrack,
)


@pytest.mark.parametrize(
    "image", [np.zeros((4, 5), np.uint8), np.zeros((4, 5, 3)), np.zeros((4, 5, 4), np.uint8)]
)
def test_a_frame_is_uint8_rgb(image):
    with pytest.raises(BadInput, match="uint8 RGB"):
        Frame(0, 0, image)


@pytest.mark.parametrize("velocity", [[0, 0, float("nan")], [0, 0], [float("inf"), 0, 0]])
def test_a_velocity_is_three_finite_numbers(velocity):
    with pytest.raises(BadInput, match=r"velocity at 1\.500 s"):
        VelocitySample(1_500_000_000, velocity)


@pytest.mark.parametrize("sigma", [-1.0, float("nan")])
def test_sigma_is_not_negative(sigma):
    with pytest.raises(BadInput, match="sigma"):
        VelocitySample(0, [1, 2, 3], "world", sigma)


@pytest.mark.parametrize("position", [[0, 0, float("nan")], [0, 0]])
def test_a_position_is_three_finite_numbers(position):
    with pytest.raises(BadInput, match=r"position at 1\.500 s"):
        PositionSample(1_500_000_000, position)


@pytest.mark.parametrize("degrees", [[0.0, 60.0], [180.0, 60.0], [float("nan"), 60.0], [60.0], []])
def test_a_field_of_view_is_told_for_each_stamp(degrees):
    with pytest.raises(BadInput, match="fields of view"):
        ViewTrack(np.arange(2 if degrees else 0), np.array(degrees))


def test_the_pictures_of_a_part_have_the_views_from_the_one_before_it():
    track = ViewTrack(np.array([10, 20, 30]), np.array([50.0, 60.0, 70.0]))
    parts = {(0, 5): [50], (10, 20): [50], (15, 30): [50, 60], (20, None): [60, 70], (99, None): [70]}
    assert {part: track.between(*part).tolist() for part in parts} == parts
    assert [track.at(stamp_ns) for stamp_ns in (0, 14, 16, 99)] == [50, 50, 60, 70]


def test_a_velocity_frame_is_known():
    with pytest.raises(BadInput, match="world or camera"):
        VelocitySample(0, [1, 2, 3], "body")


def test_an_attitude_is_made_a_unit_quaternion():
    assert np.allclose(AttitudeSample(0, [2, 0, 0, 0]).world_from_camera, [1, 0, 0, 0])


def test_a_zero_attitude_is_refused():
    with pytest.raises(BadInput, match="quaternion"):
        AttitudeSample(0, [0, 0, 0, 0])


def test_telemetry_is_in_time_order():
    with pytest.raises(BadInput, match="time order"):
        Telemetry("log", (VelocitySample(5, [0, 0, 1]), VelocitySample(4, [0, 0, 1])))


def test_telemetry_without_a_velocity_is_refused():
    with pytest.raises(BadInput, match="at least one velocity"):
        Telemetry("log", (AttitudeSample(0, [1, 0, 0, 0]),))


def test_the_span_is_that_of_the_velocities():
    samples = (AttitudeSample(1, [1, 0, 0, 0]), VelocitySample(3, [0, 0, 1]), VelocitySample(9, [0, 0, 1]))
    assert Telemetry("log", samples).span_ns == (3, 9)


def gyroscope(rates):
    return GyroscopeTrack(np.arange(len(rates)) * 10_000_000, np.asarray(rates, dtype=float))


def test_the_turn_is_rate_times_time():
    track = gyroscope([[0.3, 0.0, 0.4]] * 100)
    assert track.turn_rad(100_000_000, 300_000_000) == pytest.approx(0.5 * 0.2)


def test_vibration_is_no_turn():
    track = gyroscope([[1.0, 0, 0], [-1.0, 0, 0]] * 50)
    assert track.turn_rad(100_000_000, 300_000_000) == pytest.approx(0.0)


def test_the_turn_is_unknown_outside_the_track():
    assert gyroscope([[0.1, 0, 0]] * 10).turn_rad(200_000_000, 300_000_000) is None


def test_a_gyroscope_rate_is_finite():
    with pytest.raises(BadInput, match="gyroscope"):
        gyroscope([[float("nan"), 0, 0]])


def places(latitude_deg=47.0):
    return PlaceTrack(np.array([0, 1]), np.array([[latitude_deg, 8.0, 400.0]] * 2), SEA_LEVEL)


@pytest.mark.parametrize(
    "changed",
    [
        {"samples": (VelocitySample(0, np.array([3.0, 0, 0]), sigma=0.2),)},
        {"places": places(48.0)},
        {"places": None},
        {"view": ViewTrack(np.array([0]), np.array([70.0]))},
        {"view": None},
    ],
    ids=["sigma", "places", "no places", "view", "no view"],
)
def test_what_only_moves_error_bars_places_or_the_lens_makes_another_log(changed):
    """A repeated run of several flights kept what came from the log before it was mended."""
    of = {"places": places(), "view": ViewTrack(np.array([0]), np.array([80.0]))}
    log = Telemetry("log", (VelocitySample(0, np.array([3.0, 0, 0]), sigma=0.1),), **of)
    assert replace(log).digest == log.digest
    assert replace(log, **changed).digest != log.digest
