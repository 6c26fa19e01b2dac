"""A log whose velocities disagree with its own positions: depth is to scale with the velocities."""

from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest
from flight_files import make_video

from flightdepth.flight import open_flight
from flightdepth.flight.places import SEA_LEVEL
from flightdepth.flight.positions import place_track
from flightdepth.flight.records import MAX_GAP_S, Telemetry, VelocitySample
from flightdepth.flight.way_length import both_ways, fitted, lengths_apart, longer, said_longer
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


def line(spread_m):
    """East of 0, 40 points so far apart that they are `spread_m` from their mean, on the mean."""
    return (np.arange(40) - 19.5) / 10 * spread_m + 0j


@pytest.mark.parametrize("turn", [1j, -1, 1.5, 0.7j])
def test_the_fit_finds_the_turn_the_stretch_and_the_shift(turn):
    flown = line(10) + 1j * line(5) ** 2
    found = fitted(flown, turn * flown + 30 - 4j, turns=True, stretches=True)
    assert found == (pytest.approx(turn), pytest.approx(30 - 4j))


def test_a_fit_that_does_not_stretch_turns_only():
    turn, shift = fitted(line(10), 1.5j * line(10) + 3, turns=True)
    assert (turn, shift) == (pytest.approx(1j), pytest.approx(3))


def test_a_fit_that_does_not_turn_shifts_only():
    assert fitted(line(10), 1j * line(10) + 3, turns=False) == (1, pytest.approx(3))


def test_one_fix_that_is_wrong_moves_the_fit_by_nothing():
    """By least squares it would by a quarter of a metre; by the least sum of distances only where it weighs."""
    told = line(10)
    told[20] += 10j
    turn, shift = fitted(line(10), told, turns=True, stretches=True)
    assert abs(turn - 1) < 1e-4
    assert abs(shift) < 1e-3


def test_a_way_that_stands_still_is_neither_turned_nor_stretched():
    still = np.zeros(5, dtype=np.complex128)
    for stretches in (False, True):
        assert fitted(still, still + 2, turns=True, stretches=stretches) == (1, pytest.approx(2))
    assert longer(still, still) == 0


@pytest.mark.parametrize(("times", "said"), [(1.04, 0.0), (1.06, 0.06), (0.96, 0.0), (0.94, -0.06)])
def test_half_a_metre_on_the_mean_may_be_the_receivers(times, said):
    """Of a way whose points are 10 m from their mean: 0.4 and 0.6 m."""
    assert longer(times * line(10), line(10)) == pytest.approx(said)


@pytest.mark.parametrize(("spread_m", "said"), [(0.4, 0.0), (0.6, 9.0)])
def test_positions_that_may_be_nothing_but_error_say_nothing_of_a_long_way(spread_m, said):
    """A tenth of what was flown, and all of it within what a receiver wanders."""
    assert longer(10 * line(spread_m), line(spread_m)) == pytest.approx(said)


@pytest.mark.parametrize(("spread_m", "said"), [(50, 0.0), (70, 0.1)])
def test_twice_the_scatter_of_positions_may_hide_the_difference(spread_m, said):
    """3 m to either side: 5 m of difference are hidden, 7 m are not."""
    aside = 3j * np.array([1, -1, -1, 1] * 10)
    assert longer(1.1 * line(spread_m), line(spread_m) + aside) == pytest.approx(said, abs=1e-3)


@pytest.mark.parametrize(("share", "told"), [(0.021, True), (-0.021, True), (0.019, False), (-0.019, False)])
def test_less_than_a_fiftieth_is_not_told(share, told):
    assert bool(said_longer(share)) == told


def test_the_part_that_is_shown_is_judged():
    fast, right = flight(seconds=30, times=1.11), flight(seconds=60)
    samples = [*fast.velocities, *(each for each in right.velocities if each.stamp_ns >= 30 * S)]
    log = Telemetry("log", tuple(samples), places=right.places)
    first, second = (
        SimpleNamespace(start_ns=start_s * S, end_ns=end_s * S, duration_ns=60 * S)
        for start_s, end_s in ((0, 29), (31, 60))
    )
    assert "11.0 % longer" in lengths_apart(first, log)[0]
    assert lengths_apart(second, log) == ()


def test_fixes_at_both_ends_of_a_time_count():
    log = flight(seconds=10, velocity_s=FIX_S)
    assert [len(way) for way in both_ways(log, 0, 2 * S)] == [11, 11]
    assert len(both_ways(log, 0, 60 * S)[0]) == 50


@pytest.mark.parametrize(("gap_s", "fixes"), [(1.5, 151), (1.6, 93)])
def test_velocities_are_summed_across_what_is_bridged(gap_s, fixes):
    """Of 30 s without the velocities for a while after 10 s: all fixes, or those of the longer part."""
    log = flight(seconds=30.1)
    kept = [each for each in log.velocities if not 10 < each.stamp_ns / S < 10 + gap_s - 0.01]
    flown, _ = both_ways(Telemetry("log", tuple(kept), places=log.places), 0, 60 * S)
    assert len(flown) == fixes


def test_what_is_flown_between_two_fixes_counts():
    """It stands at each fix and goes 2 m/s midway between two, a second apart: 1 m each."""
    samples = tuple(VelocitySample(k * S // 2, [0, 2.0 * (k % 2), 0]) for k in range(9))
    stamps_ns, east_m = np.arange(5) * S, np.arange(5.0)
    places = np.array([place(0.0, east) for east in east_m])
    track = place_track(stamps_ns, places, np.zeros(5), SEA_LEVEL, Counter())
    flown, told = both_ways(Telemetry("log", samples, places=track), 0, 60 * S)
    assert flown == pytest.approx(east_m)
    assert told == pytest.approx(east_m, rel=1e-4, abs=1e-4)


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
