"""Bars as wide as a flight's ranges show that they must be: numbers by hand, and chance."""

import math

import cv2
import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.ranges import MultiRangeEstimator
from flightdepth.ranges.disagreement import FEWEST, MEMORY_S, MOST, USUAL, FlownBars, disagreement
from flightdepth.ranges.fusion import LEAST_SIGMA, WORST_SIGMA, ends
from flightdepth.runtimes.network import Network
from flightdepth.runtimes.prediction import Prediction
from tests_networks import BestHypothesis, swept_card

CARD = swept_card()
SHAPE = (20, 30)
LOWER, UPPER = ends(CARD)


def said(depth_m, share, *, beta=0.2, valid=True):
    """Of n ranges that say `depth_m` [n] or [n, h, w] with bars of these shares of it."""
    depths = np.array(
        [np.broadcast_to(each, SHAPE) for each in np.asarray(depth_m, np.float32)], dtype=np.float32
    )
    shares = np.array([np.broadcast_to(each, SHAPE) for each in np.asarray(share)], dtype=np.float32)
    betas = np.broadcast_to(np.float32(beta), depths.shape).copy()
    return Prediction(betas, depths, shares * depths, np.broadcast_to(valid, SHAPE).copy())


def test_it_is_the_difference_over_what_both_bars_foretell():
    assert disagreement(said([10.0, 10.0 * math.exp(0.2)], [0.03, 0.04]), CARD) == pytest.approx(4, rel=1e-4)


def test_of_errors_of_their_own_it_is_the_median_of_a_normal_one():
    rng = np.random.default_rng(3)
    depth_m = 10 * np.exp(np.array([0.03, 0.08])[:, None, None] * rng.normal(size=(2, *SHAPE)))  # 600 of them
    assert disagreement(said(depth_m, [0.03, 0.08]), CARD) == pytest.approx(0.674, abs=0.08)


def test_a_common_error_is_none():
    error = np.exp(np.random.default_rng(3).normal(size=SHAPE))
    assert disagreement(said([10 * error, 10 * error], [0.05, 0.05]), CARD) == pytest.approx(0, abs=1e-4)


def test_of_three_ranges_every_two_count():
    found = disagreement(said([10.0, 10.0, 10.0 * math.exp(0.2)], [0.1, 0.1, 0.1]), CARD)
    assert found == pytest.approx(
        2**0.5, rel=1e-4
    )  # the first two agree, each of them differs from the third


def test_no_depth_is_better_known_than_the_least_bar():
    found = disagreement(said([10.0, 10.0 * math.exp(0.01)], [0.001, 0.001]), CARD)
    assert found == pytest.approx(0.01 / math.hypot(LEAST_SIGMA, LEAST_SIGMA), rel=1e-3)


@pytest.mark.parametrize("cause", ["near", "far", "unsure", "invalid", "unknown"])
def test_what_two_ranges_did_not_measure_does_not_count(cause):
    """Left of a column they agree, right of it they are far apart, but one of them tells nothing there."""
    depth_m = np.full((2, *SHAPE), 10.0)
    depth_m[1, :, 10:] = 30.0
    whole = said(depth_m, [0.1, 0.1])
    assert disagreement(whole, CARD) > 5
    if cause == "near":
        whole.beta[0, :, 10:] = LOWER
    elif cause == "far":
        whole.beta[1, :, 10:] = UPPER
    elif cause == "unsure":
        whole.sigma_m[0, :, 10:] = WORST_SIGMA * 10.0
    elif cause == "invalid":
        whole.valid[:, 10:] = False
    else:
        whole.beta[0, :, 10:] = whole.depth_m[0, :, 10:] = np.nan
    assert disagreement(whole, CARD) == 0


def test_few_pixels_tell_nothing():
    told = said([10.0, 11.0], [0.1, 0.1], valid=np.arange(600).reshape(SHAPE) < FEWEST)
    assert disagreement(told, CARD) is not None
    told.valid.flat[0] = False
    assert disagreement(told, CARD) is None


def test_one_range_tells_nothing():
    assert disagreement(said([10.0], [0.1]), CARD) is None


def apart(times):
    """Of two ranges that disagree so many times as much as is usual."""
    return said([10.0, 10.0 * math.exp(0.1 * 2**0.5 * USUAL * times)], [0.1, 0.1])


def test_bars_grow_as_far_as_ranges_disagree_and_depth_stays():
    bars, told = FlownBars(), apart(2.0)
    wider = bars.widened(0, told, CARD)
    assert bars.times == pytest.approx(2, rel=1e-4)
    assert wider.sigma_m == pytest.approx(2 * told.sigma_m, rel=1e-4) and wider.sigma_m.dtype == np.float32
    assert wider.depth_m is told.depth_m and wider.beta is told.beta and wider.valid is told.valid


@pytest.mark.parametrize(("times", "expected"), [(0.3, 1.0), (1.0, 1.0), (1.5, 1.5), (20.0, MOST)])
def test_they_are_never_narrower_and_not_wider_than_makes_sense(times, expected):
    bars = FlownBars()
    bars.widened(0, apart(times), CARD)
    assert bars.times == pytest.approx(expected, rel=1e-3)


def test_a_frame_alone_tells_little():
    """By logarithms, so that twice and half as much are none; after the memory's time 1 / e is left of what was."""
    bars, second = FlownBars(), int(MEMORY_S * 1e9)
    bars.widened(0, apart(2.0), CARD)
    bars.widened(second, apart(1.0), CARD)
    assert bars.times == pytest.approx(2 ** math.exp(-1), rel=1e-3)
    bars.widened(2 * second, apart(1.0), CARD)
    assert bars.times == pytest.approx(2 ** math.exp(-2), rel=1e-3)


def test_ranges_that_agree_make_up_for_some_that_did_not():
    bars = FlownBars()
    bars.widened(0, apart(2.0), CARD)
    bars.widened(int(MEMORY_S * 1e9 * math.log(2)), apart(0.5), CARD)  # when half is kept
    assert bars.times == pytest.approx(1, rel=1e-3)


def test_what_was_learnt_holds_where_a_frame_tells_nothing():
    bars, alone = FlownBars(), said([10.0], [0.1])
    assert bars.widened(0, alone, CARD).sigma_m == pytest.approx(alone.sigma_m)
    bars.widened(1, apart(2.0), CARD)
    assert bars.widened(10**9, alone, CARD).sigma_m == pytest.approx(2 * alone.sigma_m, rel=1e-3)


def test_ranges_that_agree_to_the_digit_are_no_reason():
    bars = FlownBars()
    bars.widened(0, said([10.0, 10.0], [0.1, 0.1]), CARD)
    assert bars.times == 1


def test_a_network_without_bars_gets_none():
    depth_m = np.full((2, *SHAPE), 10.0, np.float32)
    told = Prediction(depth_m / 50, depth_m, None, np.ones(SHAPE, bool))
    assert disagreement(told, CARD) is None
    assert FlownBars().widened(0, told, CARD) is told


def test_in_flight_bars_hold_it(monkeypatch):
    """Noise in each picture, which moves the hypothesis that looks best: the same depth, with a wider bar."""
    camera = Camera.from_fov(256, 192, 80)
    rng = np.random.default_rng(4)
    wall = cv2.GaussianBlur(rng.integers(0, 256, (192, 340, 3), dtype=np.uint8), (0, 0), 2.0)
    pictures = [
        (wall[:, 3 * number : 3 * number + 256] + rng.normal(0, 12, (192, 256, 3)))
        .clip(0, 255)
        .astype(np.uint8)
        for number in range(6)
    ]
    results = []
    for wider in (True, False):
        if not wider:
            monkeypatch.setattr(FlownBars, "widened", lambda bars, stamp_ns, prediction, card: prediction)
        estimator = MultiRangeEstimator(Network(swept_card(), BestHypothesis()), camera, derotate=False)
        for number, picture in enumerate(pictures):
            estimator.add_velocity(number * 10**8, [1.0, 0.0, 0.0], frame="camera")
            result = estimator.add_frame(number * 10**8, picture)
        results.append(result)
    wide, told = results
    known = np.isfinite(wide.depth_m) & np.isfinite(told.depth_m)
    assert known.mean() > 0.3
    assert np.median(np.abs(wide.depth_m / told.depth_m - 1)[known]) < 0.01
    assert np.median((wide.sigma_m / told.sigma_m)[known]) > 1.1
