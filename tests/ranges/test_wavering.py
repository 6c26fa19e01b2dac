"""A log's speed that wavers, as depth shows it: numbers by hand, drawn errors, and a flight."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.motion import rotation_from_euler
from flightdepth.ranges import MultiRangeEstimator
from flightdepth.ranges.displacement import Trajectory
from flightdepth.ranges.estimator import SPEED_UNSURE
from flightdepth.ranges.fusion import WORST_SIGMA, Fused
from flightdepth.ranges.pairs import Frame, Pair
from flightdepth.ranges.reprojection import Reprojection
from flightdepth.ranges.seen_turns import SeenTurns
from flightdepth.ranges.wavering import (
    FEWEST,
    LONGEST_S,
    LOOK_BACK_S,
    MEMORY_S,
    MOST,
    USUAL,
    Wavering,
    changed,
)
from flightdepth.runtimes.network import Network
from tests_networks import BestHypothesis, swept_card

CAMERA = Camera.from_fov(128, 128, 90)
SHAPE = (32, 32)
REPROJECTION = Reprojection(CAMERA, SHAPE)
SPEED_M_S = 2.0
STEP_S = 0.1
PICTURE = np.zeros((1, 1, 3), np.uint8)


def ns(seconds):
    return round(seconds * 1e9)


def flying(speed_m_s=SPEED_M_S, *, attitude=True, frame="world", seconds=10.0):
    """A log of an even flight ahead."""
    trajectory = Trajectory()
    for second in np.arange(0, seconds + 0.1, 0.5):
        trajectory.add_velocity(ns(second), [0, 0, speed_m_s], frame=frame, sigma=None)
        if attitude:
            trajectory.add_attitude(ns(second), [1.0, 0, 0, 0])
    return trajectory


def fused(depth_m, share=0.05):
    depth_m = np.broadcast_to(np.asarray(depth_m, np.float32), SHAPE).copy()
    nothing = np.full(SHAPE, np.nan, np.float32)
    sigma_m = None if share is None else np.broadcast_to(np.float32(share), SHAPE) * depth_m
    return Fused(depth_m, np.ones(SHAPE, np.float32), nothing, nothing, sigma_m)


def pair(at_s, *, speed_m_s=SPEED_M_S, back_s=0.2, directed=True, told_m=0.0):
    length_m = speed_m_s * back_s
    return Pair(
        previous=Frame(0, ns(at_s - back_s), PICTURE),
        displacement_m=np.array([0, 0, length_m]),
        length_m=length_m,
        depth_m=20.0,
        current_from_previous=np.eye(3),
        turn_rad=0.0,
        directed=directed,
        length_sigma_m=told_m,
    )


def seen(errors, *, trajectory=None, turns=None, share=0.05, every_s=STEP_S, **how):
    """What is learnt of a wall, 60 m ahead at first, whose depth is off by `errors`, a factor for each frame."""
    wavering = Wavering(trajectory or flying(), turns or SeenTurns())
    for number, error in enumerate(errors):
        at_s = number * every_s
        wall = fused((60 - SPEED_M_S * at_s) * error, share)
        wavering.learn(ns(at_s), wall, pair(at_s, **how), REPROJECTION)
    return wavering


def alternating(error, frames=50, half=5):
    """Too far and too near by a factor, half a second each."""
    return [error if number // half % 2 else 1 / error for number in range(frames)]


def test_depth_that_follows_the_flight_is_no_reason():
    assert seen(np.ones(50)).sigma_m_s == 0


def test_a_speed_that_is_always_wrong_shows_in_nothing_but_what_was_flown():
    """Depth and displacement are both a tenth too long, so the wall comes as much nearer as the log says."""
    wavering = Wavering(flying(1.1 * SPEED_M_S), SeenTurns())
    for number in range(50):
        at_s = number * STEP_S
        wavering.learn(ns(at_s), fused(1.1 * (60 - SPEED_M_S * at_s)), pair(at_s), REPROJECTION)
    assert wavering.sigma_m_s == 0


def test_what_depth_wavers_by_in_half_a_second_is_the_speed_s_deviation():
    """Each frame is compared with one of the other sign; what was flown does not waver."""
    found = seen(alternating(1.02)).sigma_m_s
    log_ratio = 2 * np.log(1.02)
    assert found == pytest.approx(SPEED_M_S * np.sqrt(log_ratio**2 - USUAL**2), rel=0.04)


def test_what_networks_err_by_anyway_does_not_count():
    assert seen(alternating(np.exp(0.45 * USUAL))).sigma_m_s == 0
    assert seen(alternating(np.exp(0.75 * USUAL))).sigma_m_s > 0


def test_an_error_that_drifts_is_told_to_a_quarter():
    """By e in a second, as a receiver's does: twelve flights of ten seconds."""
    rng = np.random.default_rng(5)
    kept, sigma, told = np.exp(-STEP_S), 0.06, []
    for _ in range(12):
        errors = [sigma * rng.normal()]
        for _ in range(99):
            errors.append(kept * errors[-1] + sigma * np.sqrt(1 - kept**2) * rng.normal())
        told.append(seen(np.exp(errors)).sigma_m_s / SPEED_M_S)
    assert np.sqrt(np.mean(np.square(told))) == pytest.approx(sigma, rel=0.25)


@pytest.mark.parametrize("missing", ["attitude", "attitude, camera's axes", "direction", "error bar"])
def test_without_an_attitude_a_direction_or_an_error_bar_nothing_is_learnt(missing):
    frame = "camera" if missing.endswith("axes") else "world"
    trajectory = flying(attitude=not missing.startswith("attitude"), frame=frame)
    share = None if missing == "error bar" else 0.05
    directed = missing != "direction"
    found = seen(alternating(1.1), trajectory=trajectory, share=share, directed=directed)
    assert found.sigma_m_s == 0


def panning(turn_deg_s=20.0, seconds=10.0):
    """What the pictures tell of a camera that turns."""
    turns = SeenTurns()
    for number in range(1, round(seconds / STEP_S)):
        at_s = number * STEP_S
        turn = rotation_from_euler(0, np.radians(-turn_deg_s * 0.2), 0)
        turns.add(
            ns(at_s),
            [
                replace(
                    pair(at_s, directed=False), seen=True, current_from_previous=turn, covariance=np.eye(6)
                )
            ],
        )
    return turns


def seen_while_panning(error_of, *, turn_deg_s=20.0, turns=None, trajectory=None):
    """A wall all around, as far away in each direction, so that a turn that is not known would waver."""
    trajectory = trajectory or flying(attitude=False)
    wavering = Wavering(trajectory, panning(turn_deg_s) if turns is None else turns)
    for number, error in enumerate(error_of):
        at_s = number * STEP_S
        told = replace(pair(at_s, directed=False), seen=True, displacement_m=np.array([0.4, 0, 0]))
        wavering.learn(ns(at_s), fused(60.0 * error), told, REPROJECTION)
    return wavering.sigma_m_s


@pytest.mark.parametrize("turn_deg_s", [0.0, 20.0])
def test_a_log_without_attitudes_is_judged_where_the_pictures_tell_the_turns(turn_deg_s):
    log_ratio = 2 * np.log(1.05)
    assert seen_while_panning(np.ones(90), turn_deg_s=turn_deg_s) < 0.01
    found = seen_while_panning(alternating(1.05, frames=90), turn_deg_s=turn_deg_s)
    assert found == pytest.approx(SPEED_M_S * np.sqrt(log_ratio**2 - USUAL**2), rel=0.05)
    assert seen_while_panning(alternating(1.05, frames=90), turns=SeenTurns()) == 0


def test_round_a_bend_nothing_is_compared_where_the_direction_was_seen():
    """It was that of the last pair's way alone."""
    bending = Trajectory()
    for half_second in range(20):
        course = half_second * np.pi / 4
        velocity = SPEED_M_S * np.array([np.cos(course), np.sin(course), 0.0])
        bending.add_velocity(ns(half_second / 2), velocity, frame="world", sigma=None)
    assert seen_while_panning(alternating(1.05, frames=90), turn_deg_s=0.0, trajectory=bending) == 0


@pytest.mark.parametrize(
    ("every_s", "compared"),
    [(0.9 * LOOK_BACK_S, True), (LOOK_BACK_S, True), (LONGEST_S, True), (1.01 * LONGEST_S, False)],
)
def test_frames_are_compared_that_are_half_a_second_to_a_second_apart(every_s, compared):
    half = 2 if every_s < LOOK_BACK_S else 1  # then with the one before the last
    found = seen(alternating(1.1, frames=9, half=half), every_s=every_s)
    assert (found.sigma_m_s > 0) == compared


def test_of_many_frames_a_second_ten_are_kept():
    """However many there are, so memory is bounded, and the same is learnt."""
    fast = seen(alternating(1.05, frames=500, half=50), every_s=0.01)
    assert fast.sigma_m_s == pytest.approx(seen(alternating(1.05)).sigma_m_s, rel=0.02)
    assert len(fast._kept) <= LONGEST_S / STEP_S + 1


def test_a_slow_moment_says_no_more_of_the_speed_than_it_can():
    """The same metres a second are a larger share of it."""
    wavering = seen(alternating(1.1), speed_m_s=0.5)
    assert wavering.sigma_m_s == pytest.approx(0.25 * seen(alternating(1.1)).sigma_m_s, rel=1e-6)


@pytest.mark.parametrize("slow", [0, 1])
def test_of_two_moments_the_slower_counts(slow):
    """An error is the larger share of its speed: half a metre a second in one half second, two in the next."""
    wavering = Wavering(flying(), SeenTurns())
    for number, error in enumerate(alternating(1.1)):
        at_s, speed_m_s = number * STEP_S, 0.5 if number // 5 % 2 == slow else SPEED_M_S
        wall = fused((60 - SPEED_M_S * at_s) * error)
        wavering.learn(ns(at_s), wall, pair(at_s, speed_m_s=speed_m_s), REPROJECTION)
    assert wavering.sigma_m_s == pytest.approx(seen(alternating(1.1), speed_m_s=0.5).sigma_m_s, rel=1e-6)


def test_the_speed_is_that_of_the_pair():
    """However long it takes."""
    long = seen(alternating(1.1), back_s=0.4).sigma_m_s
    assert long == pytest.approx(seen(alternating(1.1), back_s=0.1).sigma_m_s, rel=1e-6)


def test_no_bar_is_less_than_the_least():
    """Fourteen columns of 32 say that they are surer than anybody is; the others say something else."""
    column = np.arange(SHAPE[1])
    share, before = (
        np.select([column < 14, column < 18], [0.001, 0.003], 0.005),
        np.where(column < 14, 1.3, 1.1),
    )
    wavering = Wavering(flying(0.0), SeenTurns())
    for at_s, ratio in ((0.0, before), (LOOK_BACK_S, 1.0)):
        wavering.learn(ns(at_s), fused(20.0 * ratio, share), pair(at_s), REPROJECTION)
    assert wavering.sigma_m_s == pytest.approx(SPEED_M_S * np.sqrt(np.log(1.1) ** 2 - USUAL**2), rel=1e-3)


def test_what_was_learnt_fades_and_what_comes_counts():
    wavering = seen(
        [*alternating(1.1, frames=30), *np.ones(round(6 * MEMORY_S / STEP_S))],
        trajectory=flying(seconds=30.0),
    )
    assert wavering.sigma_m_s < 0.1 * seen(alternating(1.1, frames=30)).sigma_m_s


def test_across_a_cut_nothing_is_compared_and_what_was_learnt_stays():
    wavering = seen(alternating(1.05))
    before = wavering.sigma_m_s
    wavering.forget()
    wavering.learn(ns(5.0), fused(10.0), pair(5.0), REPROJECTION)
    assert wavering.sigma_m_s == before > 0


def test_pairs_are_as_unsure_as_the_speed_was_for_so_long():
    wavering = seen(alternating(1.02))
    short, long = wavering.widened(ns(5.0), [pair(5.0, back_s=0.1), pair(5.0, back_s=0.5)])
    assert short.length_sigma_m == pytest.approx(0.1 * wavering.sigma_m_s)
    assert long.length_sigma_m == pytest.approx(0.5 * wavering.sigma_m_s)
    assert long.length_m == 0.5 * SPEED_M_S and short.previous is not long.previous


def test_what_the_log_says_is_not_lessened_and_more_than_a_third_is_not_told():
    wavering = seen(alternating(1.02))
    (sure,) = wavering.widened(ns(5.0), [pair(5.0, told_m=1.0)])
    assert sure.length_sigma_m == 1.0
    (slow,) = wavering.widened(ns(5.0), [pair(5.0, speed_m_s=0.05)])
    assert slow.length_sigma_m == pytest.approx(MOST * slow.length_m)


def test_a_flight_that_was_not_seen_to_waver_keeps_its_pairs():
    (kept,) = Wavering(flying(), SeenTurns()).widened(ns(5.0), [pair(5.0)])
    assert kept.length_sigma_m == 0


def maps(now_m, before_m, now_share=0.05, before_share=0.05):
    return [
        np.broadcast_to(np.asarray(each, np.float32), SHAPE).copy()
        for each in (now_m, now_share, before_m, before_share)
    ]


def test_a_change_is_the_logarithm_of_before_over_now():
    assert changed(*maps(10.0, 12.0)) == pytest.approx(np.log(1.2), rel=1e-5)


def test_the_surer_half_tells():
    """Left half with small bars, right half with large ones."""
    left = np.arange(SHAPE[1]) < 16
    found = changed(*maps(10.0, np.where(left, 11.0, 30.0), before_share=np.where(left, 0.02, 0.2)))
    assert found == pytest.approx(np.log(1.1), rel=1e-5)


@pytest.mark.parametrize(
    "cause", ["now unsure", "before unsure", "now unknown", "before unknown", "at the lens"]
)
def test_what_is_not_known_twice_does_not_count(cause):
    """Three quarters of the picture would say that it tripled."""
    aside = np.arange(SHAPE[1]) >= 8
    now_m, now_share, before_m, before_share = maps(10.0, np.where(aside, 30.0, 10.0))
    assert changed(now_m, now_share, before_m, before_share) == pytest.approx(np.log(3), rel=1e-5)
    if cause == "now unsure":
        now_share[:, aside] = WORST_SIGMA
    elif cause == "before unsure":
        before_share[:, aside] = WORST_SIGMA
    elif cause == "now unknown":
        now_m[:, aside] = np.nan
    elif cause == "before unknown":
        before_m[:, aside] = np.nan
    else:
        now_m[:, aside] = 0
    assert changed(now_m, now_share, before_m, before_share) == 0


def test_few_points_tell_nothing():
    now_m, now_share, before_m, before_share = maps(10.0, 12.0)
    now_m.flat[FEWEST:] = np.nan
    assert changed(now_m, now_share, before_m, before_share) is not None
    now_m.flat[0] = np.nan
    assert changed(now_m, now_share, before_m, before_share) is None


def test_in_flight_a_speed_that_wavers_widens_bars(monkeypatch):
    """Past a wall at an even speed, which the log calls a quarter too high and too low in turn."""
    camera = Camera.from_fov(256, 192, 80)
    rng = np.random.default_rng(4)
    wall = cv2.GaussianBlur(rng.integers(0, 256, (192, 400, 3), dtype=np.uint8), (0, 0), 2.0)
    results = []
    for wider in (True, False):
        if not wider:
            monkeypatch.setattr(Wavering, "widened", lambda wavering, stamp_ns, pairs: tuple(pairs))
        estimator = MultiRangeEstimator(Network(swept_card(), BestHypothesis()), camera, derotate=False)
        for number in range(26):
            told = 1.25 if number // 5 % 2 else 0.8
            estimator.add_attitude(ns(number / 10), [1.0, 0, 0, 0])
            estimator.add_velocity(ns(number / 10), [told, 0.0, 0.0], frame="world")
            result = estimator.add_frame(ns(number / 10), wall[:, 5 * number : 5 * number + 256])
        results.append(result)
    wide, told = results
    assert SPEED_UNSURE in wide.notes
    assert SPEED_UNSURE not in told.notes
    known = np.isfinite(wide.depth_m) & np.isfinite(told.depth_m)
    assert known.mean() > 0.3
    np.testing.assert_allclose(wide.depth_m[known], told.depth_m[known], rtol=0.05)
    assert np.median((wide.sigma_m / told.sigma_m)[known]) > 1.3


@pytest.mark.parametrize("sigma", [0.08, 0.12])
@pytest.mark.parametrize("bars", [True, False])
def test_a_note_says_when_a_speed_is_unsure_by_more_than_a_tenth(sigma, bars):
    """And error bars with it, so not of a network that has none."""
    camera, card = Camera.from_fov(256, 192, 80), swept_card()
    wall = cv2.GaussianBlur(np.random.default_rng(4).integers(0, 256, (192, 300, 3), np.uint8), (0, 0), 2.0)
    network = Network(card, BestHypothesis())
    if not bars:
        predict = network.predict
        network.predict = lambda *given: replace(predict(*given), sigma_m=None)
    estimator = MultiRangeEstimator(network, camera, derotate=False)
    for number in range(4):
        estimator.add_velocity(ns(number / 10), [1.0, 0.0, 0.0], frame="camera", sigma=sigma)
        result = estimator.add_frame(ns(number / 10), wall[:, 5 * number : 5 * number + 256])
    assert (SPEED_UNSURE in result.notes) == (sigma > 0.1 and bars)
