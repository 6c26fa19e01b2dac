"""A log whose velocities disagree with its own positions: depth is to scale with the velocities."""

from collections import Counter

import numpy as np
import pytest
from flight_files import make_video

from flightdepth.flight import open_flight
from flightdepth.flight.places import SEA_LEVEL
from flightdepth.flight.positions import place_track
from flightdepth.flight.records import MAX_GAP_S, Telemetry, VelocitySample
from flightdepth.flight.way_length import both_ways, longer
from tests_recordings import cues, mavic_3, phantom_4_rtk, place

S = 10**9
FIX_S = 0.2


def flown_ned(times_s, reach_m=40.0):
    """North, east, down, metres [n, 3], of a flight with turns."""
    return np.stack([reach_m * np.sin(times_s / 9), 3.0 * times_s, -times_s / 9], axis=1)


def flight(seconds=60.0, *, times=1.0, noise_m=0.0, velocity_s=0.1, way=flown_ned, turn_deg=0.0, late_s=0.0):
    """A log whose velocities are `times` too fast, and off by an angle, for positions of a receiver."""
    told_s = np.arange(0, seconds, velocity_s)
    velocities = (way(told_s + 1e-3) - way(told_s - 1e-3)) / 2e-3 * [times, times, 1]
    east = np.exp(1j * np.radians(turn_deg)) * (velocities[:, 1] + 1j * velocities[:, 0])
    turned = np.c_[east.imag, east.real, velocities[:, 2]]
    fixed_s = np.arange(0, seconds, FIX_S)
    ned = way(fixed_s - late_s) + np.random.default_rng(0).normal(0, noise_m, (len(fixed_s), 3))
    places = np.array([[*place(north, east), 500 - down] for north, east, down in ned])
    samples = tuple(VelocitySample(round(at * S), each) for at, each in zip(told_s, turned, strict=True))
    stamps_ns = np.round(fixed_s * S).astype(np.int64)
    track = place_track(stamps_ns, places[:, :2], places[:, 2], SEA_LEVEL, Counter())
    return Telemetry("log", samples, places=track)


def share(log, start_s=0.0, end_s=1e6):
    return longer(*both_ways(log, round(start_s * S), round(end_s * S)))


@pytest.mark.parametrize("times", [1.044, 0.9, 1.0, 3.28])
def test_how_much_too_fast_the_velocities_are_is_found(times):
    """A Karma's were 3 to 11 % too fast, and so much too far its depth."""
    assert share(flight(times=times)) == pytest.approx(times - 1, abs=1e-4)


@pytest.mark.parametrize("velocity_s", [0.02, 0.1, 0.37])
def test_it_does_not_depend_on_how_often_they_are_told(velocity_s):
    assert share(flight(times=1.05, velocity_s=velocity_s)) == pytest.approx(0.05, abs=1e-3)


def test_a_north_that_is_another_changes_no_length():
    assert share(flight(times=1.05, turn_deg=70)) == pytest.approx(0.05, abs=1e-4)


def test_what_is_too_fast_in_another_part_is_not_held_against_this_one():
    """As on the Karma: 11 % at 3 m/s, 3 to 4 % at 8."""
    slow, right = flight(seconds=30, times=1.11), flight(seconds=60)
    samples = [*slow.velocities, *(each for each in right.velocities if each.stamp_ns >= 30 * S)]
    log = Telemetry("log", tuple(samples), places=right.places)
    assert share(log, 0, 29) == pytest.approx(0.11, abs=1e-3)
    assert share(log, 31, 60) == pytest.approx(0, abs=1e-3)


def hover(times_s):
    return np.stack([np.sin(times_s / 3), np.cos(times_s / 4), 0 * times_s], axis=1)


@pytest.mark.parametrize(
    "log",
    [
        flight(noise_m=2.0),
        flight(noise_m=1.0, late_s=0.4),
        flight(seconds=10, times=1.03),
        flight(times=1.5, noise_m=1.5, way=hover),
    ],
    ids=["a receiver's noise", "its delay", "a metre more in 30", "a drone that hovers"],
)
def test_what_a_receivers_error_may_be_is_not_held_against_velocities(log):
    assert abs(share(log)) < 0.02


def test_velocities_across_a_gap_are_not_summed():
    """It flew on meanwhile: what it says of the longer part counts."""
    log = flight(times=1.1)
    kept = [each for each in log.velocities if not 20 * S < each.stamp_ns < (20 + 4 * MAX_GAP_S) * S]
    flown, told = both_ways(Telemetry("log", tuple(kept), places=log.places), 0, 60 * S)
    assert len(flown) == len(told) == pytest.approx(34 / FIX_S, abs=2)
    assert longer(flown, told) == pytest.approx(0.1, abs=1e-3)


@pytest.mark.parametrize(
    "log",
    [
        Telemetry("without positions", flight().samples),
        Telemetry("of speeds", flight().samples, places=flight().places, any_direction=True),
        Telemetry("in the camera's axes", (VelocitySample(0, [0, 0, 1], "camera"),), places=flight().places),
        Telemetry("of another time", (VelocitySample(900 * S, [0, 0, 1]),), places=flight().places),
    ],
    ids=lambda log: log.name,
)
def test_a_log_that_tells_no_two_ways_says_nothing(log):
    assert [len(way) for way in both_ways(log, 0, 60 * S)] == [0, 0]


HEADER = "time_s,vn_m_s,ve_m_s,vd_m_s,latitude_deg,longitude_deg\n"


def csv(times):
    """Two seconds and a half at 20 m/s, by its positions."""
    rows = [(i / 10, *place(16.0 * i / 10, -12.0 * i / 10)) for i in range(26)]
    return HEADER + "".join(
        f"{at},{16 * times},{-12 * times},0,{latitude:.8f},{longitude:.8f}\n"
        for at, latitude, longitude in rows
    )


@pytest.fixture(scope="module")
def video(tmp_path_factory):
    return make_video(tmp_path_factory.mktemp("flown") / "v.mp4", range(0, 2500, 40))


@pytest.mark.parametrize(
    ("times", "said"), [(1.08, "8.0 % longer, far"), (0.9, "10.0 % shorter, near"), (1.0, ""), (1.01, "")]
)
def test_an_opened_flight_warns_of_it(video, tmp_path, times, said):
    """It was told where a cloud was laid on the Earth only, after the whole flight."""
    (tmp_path / "log.csv").write_text(csv(times))
    length, _, side = said.partition(", ")
    line = (
        f"the way by the log's velocities is {length} than the log's positions tell: where these are right, "
    )
    with open_flight(video, tmp_path / "log.csv", hfov_deg=60) as opened:
        assert opened.warnings == ((f"{line}depth is so much too {side}",) if said else ())


@pytest.mark.parametrize("body", [mavic_3, phantom_4_rtk])
def test_velocities_that_come_of_positions_agree_with_them(video, tmp_path, body):
    (tmp_path / "log.srt").write_text(cues((16.0, -12.0, 0.0), body, seconds=2.5, rate=10))
    with open_flight(video, tmp_path / "log.srt", hfov_deg=60) as opened:
        assert not any("positions tell" in line for line in opened.warnings)
