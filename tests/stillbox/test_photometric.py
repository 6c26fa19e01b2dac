import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.stillbox.pairs import Pair
from flightdepth.stillbox.photometric import Photometric, through_jpeg

EFFECTS = Photometric()


def pair_of(previous, current) -> Pair:
    target_m = np.ones(current.shape[:2], np.float32)
    return Pair(previous, current, target_m, np.array([0.1, 0.2, 0.3]), Camera.from_fov(64, 64, 90))


@pytest.fixture(scope="module")
def ramp() -> Pair:
    """The same smooth picture twice."""
    image = np.zeros((32, 48, 3), np.uint8)
    image[...] = np.linspace(20, 200, 48)[None, :, None]
    return pair_of(image, image)


@pytest.fixture(scope="module")
def drawn(ramp) -> list[Pair]:
    return [EFFECTS(np.random.default_rng(n), ramp) for n in range(300)]


def test_shape_and_type_stay(drawn):
    assert all(p.previous.shape == p.current.shape == (32, 48, 3) for p in drawn)
    assert all(p.previous.dtype == p.current.dtype == np.uint8 for p in drawn)


def test_target_and_displacement_stay(ramp, drawn):
    assert all(p.target_m is ramp.target_m and p.displacement is ramp.displacement for p in drawn)


def test_the_pictures_given_are_not_touched(ramp, drawn):
    assert ramp.previous[0, :, 0].tolist() == np.linspace(20, 200, 48).astype(np.uint8).tolist()


def test_both_images_get_the_same_curve(drawn):
    for pair in drawn:
        columns = [image.astype(float).mean(axis=(0, 2)) for image in (pair.previous, pair.current)]
        assert np.abs(columns[0] - columns[1]).max() < 32  # +-0.08 stops each, and what is left of the noise


def test_pairs_get_different_curves(drawn):
    middle = np.array([pair.current[:, 24].mean() for pair in drawn])
    assert middle.std() > 20


def test_the_mean_effect_is_mild(ramp, drawn):
    mean = np.mean([pair.current.mean() for pair in drawn])
    assert mean == pytest.approx(ramp.current.mean(), rel=0.15)


def test_brighter_stays_brighter(drawn):
    for pair in drawn:
        columns = pair.current.astype(float).mean(axis=(0, 2))
        assert columns[40] > columns[8]


def test_the_same_stream_gives_the_same_bytes(ramp):
    one, two = (EFFECTS(np.random.default_rng(4), ramp) for _ in range(2))
    np.testing.assert_array_equal(one.previous, two.previous)


def test_two_pairs_in_three_are_noisy():
    flat = np.full((32, 32, 3), 120, np.uint8)
    seen = [EFFECTS(np.random.default_rng(n), pair_of(flat, flat)).current for n in range(300)]
    noisy = [image.std(axis=(0, 1)).max() > 0 for image in seen]
    assert np.mean(noisy) == pytest.approx(2 / 3, abs=0.09)


def test_jpeg_keeps_the_brightness_of_fine_red_stripes():
    """Its chroma is coarse, its luma fine: 0.299 of red (Rec. 601), and only 0.114 if red were taken for blue."""
    stripes = np.full((32, 32, 3), 60, np.uint8)
    stripes[:, ::2, 0] = 220
    luma = through_jpeg(stripes, 95) @ np.array([0.299, 0.587, 0.114])
    assert np.ptp(luma[4, 4:20]) == pytest.approx(0.299 * 160, abs=3)
