"""Flicker, reliability, the best constant and the logs of the multi-range study: laws and numbers by hand."""

import numpy as np
import pytest
from range_parts import sequence

from flightdepth.camera import Camera
from flightdepth.evaluation.ranges_measures import (
    BINS,
    PLACES,
    Coverage,
    Reliability,
    coverage,
    flicker,
    moved,
    reliability,
)
from flightdepth.evaluation.ranges_peers import flow_card, least_relative_m
from flightdepth.evaluation.ranges_sequences import log_of

VIEW = Camera.from_fov(32, 32, 90)
STILL = np.zeros(3)


def plane(depth_m: float) -> np.ndarray:
    return np.full((32, 32), depth_m, np.float32)


# Flicker


def test_a_wall_comes_nearer_by_what_was_flown_towards_it():
    there = moved(plane(10), np.array([0, 0, 0.5]), VIEW)
    np.testing.assert_allclose(there[np.isfinite(there)], 9.5)
    assert flicker(plane(10), plane(9.5), np.array([0, 0, 0.5]), VIEW) == pytest.approx(0)


def test_sideways_motion_shifts_a_wall_by_whole_pixels():
    """16 px of focal length, 10 m away, 1.25 m to the right: 2 px to the left."""
    depth_m = plane(10)
    depth_m[:, 20:] = 11
    there = moved(depth_m, np.array([1.25, 0, 0]), VIEW)
    assert there[5, 17] == 10
    assert there[5, 19] == 11
    assert np.isnan(there[5, 31])


def test_the_nearer_of_two_points_hides_the_other():
    depth_m = np.full((32, 32), np.nan, np.float32)
    depth_m[8, 10], depth_m[8, 12] = 40, 8  # 0.4 and 2 px to the left
    there = moved(depth_m, np.array([1.0, 0, 0]), VIEW)
    assert there[8, 10] == 8


def test_what_passed_behind_the_camera_falls_nowhere():
    assert np.isnan(moved(plane(1), np.array([0, 0, 2.0]), VIEW)).all()


def test_a_depth_that_doubles_flickers_by_a_half():
    assert flicker(plane(10), plane(20), STILL, VIEW) == pytest.approx(0.5)


def test_without_a_known_pixel_there_is_no_flicker():
    assert np.isnan(flicker(plane(np.nan), plane(10), STILL, VIEW))


# Confidence


def told(confidence: float, right: float) -> dict:
    """1,000 pixels of one confidence, of which a share is right."""
    truth_m = np.full(1000, 10, np.float32)
    depth_m = np.where(np.arange(1000) < 1000 * right, 11, 14).astype(np.float32)
    counts = Reliability()
    counts.add(depth_m, np.full(1000, confidence, np.float32), truth_m)
    return reliability(counts.sums)


def test_confidence_that_keeps_its_word_has_no_error():
    found = told(0.75, 0.75)
    assert found["tenths"][7] == {"said": 0.75, "right": 0.75, "pixels": 1000}
    assert found["expected_error"] == pytest.approx(0)


@pytest.mark.parametrize(("said", "right"), [(0.9, 0.5), (0.2, 0.6), (1.0, 0.0)])
def test_the_signed_error_tells_promise_from_modesty(said, right):
    found = told(said, right)
    assert found["signed_error"] == pytest.approx(said - right)
    assert found["expected_error"] == pytest.approx(abs(said - right))


def test_right_means_within_a_quarter_of_the_truth():
    counts = Reliability()
    depth_m = np.array([12.4, 12.6, 7.6, 7.4], np.float32)
    counts.add(depth_m, np.full(4, 0.5, np.float32), np.full(4, 10, np.float32))
    assert counts.sums[5].tolist() == [4, 2, 2]


def test_opposite_errors_do_not_cancel():
    counts = Reliability()
    for said, wrong in ((0.95, 20.0), (0.05, 10.0)):
        counts.add(np.full(10, wrong, np.float32), np.full(10, said, np.float32), np.full(10, 10, np.float32))
    assert reliability(counts.sums)["expected_error"] == pytest.approx(0.95)
    assert reliability(counts.sums)["signed_error"] == pytest.approx(0, abs=1e-6)


def test_unknown_pixels_do_not_count():
    counts = Reliability()
    nothing = np.full(5, np.nan, np.float32)
    counts.add(nothing, np.zeros(5, np.float32), np.ones(5, np.float32))
    counts.add(np.ones(5, np.float32), np.ones(5, np.float32), nothing)
    assert counts.sums.sum() == 0
    assert reliability(counts.sums)["tenths"] == [None] * BINS


# Best constant


def test_no_constant_has_less_relative_error():
    truth_m = np.random.default_rng(0).gamma(2, 10, 501).astype(np.float32)
    best = least_relative_m(truth_m)
    tried = np.linspace(0.1, 60, 3000)
    errors = [(np.abs(each - truth_m) / truth_m).mean() for each in tried]
    assert (np.abs(best - truth_m) / truth_m).mean() <= min(errors) + 1e-4


def test_the_best_constant_scales_with_the_scene_and_needs_one():
    truth_m = np.array([2, 5, np.inf, 30, np.nan], np.float32)
    assert least_relative_m(10 * truth_m) == pytest.approx(10 * least_relative_m(truth_m))
    assert np.isnan(least_relative_m(np.full(3, np.nan, np.float32)))


# Where errors come from


def covered(depth_m: list, truth_m: list, displacements_m: list) -> dict:
    """Through a network whose output spans a sixth of its range to all of it, 60 m at 0.5 m flown."""
    card = flow_card(128.0).model_copy(update={"depth_min_m": 10.0, "depth_max_m": 60.0, "D0_m": 0.5})
    counts = Coverage(card)
    maps = (np.array(values, np.float32) for values in (depth_m, truth_m))
    counts.add(*maps, np.array(displacements_m))
    return coverage([counts.sums])


def test_truth_lies_inside_a_range_nearer_or_beyond():
    found = covered([1] * 5, [9.9, 10.1, 59.9, 60.1, 119], [0.5])
    assert [found[place]["share"] for place in PLACES] == pytest.approx([0.4, 0.2, 0.4])
    found = covered([1] * 5, [9.9, 10.1, 59.9, 60.1, 119], [0.5, 1.0])
    assert [found[place]["share"] for place in PLACES] == pytest.approx([0.8, 0.2, 0.0])


def test_what_lies_between_two_ranges_is_not_nearer():
    found = covered([1], [70], [0.5, 4.0])  # 10 to 60 m and 80 to 480 m
    assert found["beyond"]["share"] == 1


def test_the_parts_add_up_to_the_error_and_unknown_depth_has_none():
    found = covered([10, 40, 30, np.nan], [5, 20, 20, 70], [0.5])
    assert sum(found[place]["part"] for place in PLACES) == pytest.approx((1 + 1 + 0.5) / 3)
    assert found["nearer"] == {"share": 0.25, "part": pytest.approx(1 / 3), "abs_rel": 1}
    assert found["inside"]["abs_rel"] == pytest.approx(0.75)
    assert found["beyond"]["abs_rel"] is None


# Logs


def flying(speed_m_s: float):
    flown = sequence()
    flown.velocity[:] = (0, 0, speed_m_s)
    return flown


def test_a_right_log_tells_the_speed_at_its_rate():
    log = log_of(flying(2.0), rate_hz=10, noise_m_s=0, bias=0)
    assert np.diff([stamp for stamp, _ in log]).tolist() == [100_000_000] * (len(log) - 1)
    np.testing.assert_allclose([velocity for _, velocity in log], [(0, 0, 2.0)] * len(log))


def test_a_biased_log_errs_by_its_share_of_the_speed():
    assert log_of(flying(2.0), rate_hz=20, noise_m_s=0, bias=-0.1)[3][1] == pytest.approx([0, 0, 1.8])


def test_noise_is_that_of_its_size_and_the_same_again():
    one, two = (log_of(flying(1.0), rate_hz=500, noise_m_s=0.2, bias=0) for _ in range(2))
    errors = np.array([velocity for _, velocity in one]) - (0, 0, 1.0)
    assert errors.std() == pytest.approx(0.2, rel=0.1)
    np.testing.assert_array_equal(errors, np.array([velocity for _, velocity in two]) - (0, 0, 1.0))
