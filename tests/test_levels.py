"""Bytes stay bytes; what lies between two levels stays there until someone asks for bytes."""

import numpy as np
import pytest

from flightdepth.levels import exact_grey, grey, packed, rounded, unpacked, within_levels

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


def test_what_is_packed_takes_half_the_memory_and_keeps_its_parts_of_a_level():
    levels = np.random.default_rng(0).uniform(0, 255, (20, 30, 3)).astype(np.float32)
    levels[0, :2] = [[0, 0, 0], [255, 255, 255]]
    kept = packed(levels)
    assert kept.nbytes == levels.nbytes // 2
    assert unpacked(kept) == pytest.approx(levels, abs=1 / 500)
    assert unpacked(kept).dtype == np.float32
    assert unpacked(kept)[0, :2].tolist() == [[0, 0, 0], [255, 255, 255]]


def test_bytes_are_packed_already():
    assert packed(COLOURS) is unpacked(COLOURS) is COLOURS
