"""A video's compression: less the better it is, and different from that of two single pictures."""

import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.scenes import StillBoxConfig, Textures
from flightdepth.stillbox import PairRule, PairStream, Picture
from flightdepth.stillbox.h264 import filmed, through_h264
from flightdepth.stillbox.pairs import Pair

RNG = np.random.default_rng(4)
COARSE = RNG.integers(0, 256, (9, 9, 3))
PICTURE = np.kron(COARSE, np.ones((8, 8, 1), int)).astype(np.uint8)[:64, :64]


def error(picture, factor):
    return float(np.abs(through_h264([picture], factor)[0].astype(int) - picture).mean())


def test_a_worse_video_is_farther_from_the_picture():
    errors = [error(PICTURE, factor) for factor in (5, 20, 35)]
    assert errors == sorted(errors)
    assert errors[0] < 12  # colours are halved in size
    assert errors[2] > 1.3 * errors[0]


def test_grey_pictures_stay_what_they_are_in_a_good_video():
    grey = np.repeat(PICTURE[..., :1], 3, axis=2)
    assert error(grey, 1) < 1.5


def test_the_second_frame_is_told_by_the_first():
    """It has the first one's errors, where two pictures by themselves would have each its own."""
    first, second = (frame.astype(int) for frame in through_h264([PICTURE, PICTURE], 35))
    assert np.abs(first - PICTURE).mean() > 3
    assert np.abs(second - first).mean() < 0.3 * np.abs(first - PICTURE).mean()


def test_the_quality_is_drawn_and_all_else_stays():
    pair = Pair(
        PICTURE, PICTURE[::-1].copy(), np.ones((64, 64), np.float32), np.ones(3), Camera.from_fov(64, 64, 90)
    )
    one, again, other = (filmed(np.random.default_rng(seed), pair) for seed in (1, 1, 2))
    assert np.array_equal(one.current, again.current)
    assert not np.array_equal(one.current, other.current)
    assert one.target_m is pair.target_m
    assert one.previous.shape == one.current.shape == PICTURE.shape


def test_both_pictures_are_frames_of_one_video_of_the_drawn_quality():
    other = PICTURE[::-1].copy()
    pair = Pair(PICTURE, other, np.ones((64, 64), np.float32), np.ones(3), Camera.from_fov(64, 64, 90))
    found = filmed(np.random.default_rng(1), pair)
    factor = np.random.default_rng(1).uniform(8, 22)
    for seen, expected in zip(
        (found.previous, found.current), through_h264([PICTURE, other], factor), strict=True
    ):
        assert np.array_equal(seen, expected)


@pytest.fixture(scope="module")
def textures():
    return Textures.procedural(3, 1)


def test_a_share_of_a_streams_pairs_is_filmed(textures):
    def pairs(**options):
        with PairStream(
            StillBoxConfig(frames=3), textures, Picture(64, 64, 64), PairRule(), 5, pool_scenes=8, **options
        ) as stream:
            return stream.batch(0, 60).pairs

    clean, all_of_them, some = pairs(), pairs(h264_share=1.0), pairs(h264_share=0.3)
    changed = [(seen != clean).any((1, 2, 3)).mean() for seen in (all_of_them, some)]
    assert changed[0] == 1
    assert changed[1] == pytest.approx(0.3, abs=0.15)
