"""Bytes stay bytes; what lies between two levels stays there until someone asks for bytes."""

import numpy as np
import pytest

from flightdepth.levels import exact_grey, grey, rounded, within_levels

COLOURS = np.random.default_rng(0).integers(0, 256, (20, 30, 3), dtype=np.uint8)
WEIGHTS = np.array([0.299, 0.587, 0.114])  # ITU-R BT.601


def test_grey_is_the_standards_weighted_mean():
    assert exact_grey(COLOURS) == pytest.approx(COLOURS @ WEIGHTS, abs=1e-3)
    assert grey(COLOURS) == pytest.approx(COLOURS @ WEIGHTS, abs=0.51)
    assert grey(COLOURS).dtype == np.uint8


def test_grey_of_levels_is_rounded_once():
    between = COLOURS * np.float32(0.7)
    assert exact_grey(between) == pytest.approx(between @ WEIGHTS, abs=1e-3)
    assert grey(between) == pytest.approx(between @ WEIGHTS, abs=0.501)


def test_bytes_are_not_copied_and_levels_go_to_the_nearest():
    assert rounded(COLOURS) is COLOURS
    levels = np.array([-3.0, 0.4, 0.6, 99.51, 254.9, 300.0], np.float32)
    np.testing.assert_array_equal(rounded(levels), np.array([0, 0, 1, 100, 255, 255], np.uint8))


def test_nothing_is_brighter_than_white():
    levels = np.array([-3.0, 0.4, 254.9, 300.0], np.float32)
    assert within_levels(levels).tolist() == pytest.approx([0.0, 0.4, 254.9, 255.0])
