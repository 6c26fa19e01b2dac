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


class Ends:
    """Stands for a generator: all that is uniform is at one end of its range, of several numbers the last is."""

    def __init__(self, end: int, *shares: float) -> None:
        self._end, self._shares = end, iter(shares)

    def uniform(self, low, high, size=None):
        at = (low, high)[self._end]
        return at if size is None else np.linspace((low + high) / 2, at, size)

    def integers(self, low, high):
        return low + 0 * np.asarray(high)

    def random(self):
        return next(self._shares)


NEITHER = 0.34, 0.67, 0.34  # shares of blur, of noise, of JPEG


def levels(end: int, level: int, *shares: float) -> np.ndarray:
    grey = np.full((32, 32, 3), level, np.uint8)
    return EFFECTS(Ends(end, *(shares or NEITHER)), pair_of(grey, grey)).current


@pytest.mark.parametrize(
    ("end", "exposure", "gamma", "lift"), [(0, 2**-0.78, 0.75, 0), (1, 2**0.78, 1.35, 0.12)]
)
def test_a_level_at_the_ends_of_what_is_drawn_by_hand(end, exposure, gamma, lift):
    """Both exposures, that of the pair and that of the picture, are at their ends; red is in the middle."""
    tints = np.array([1, 1.05, 1.1] if end else [1, 0.95, 0.9])
    expected = 255 * (lift + (1 - lift) * (100 / 255 * exposure * tints) ** gamma)
    assert levels(end, 100)[5, 5] == pytest.approx(expected, abs=0.51)


def test_what_is_brighter_than_white_is_white_and_black_is_lifted():
    assert (levels(1, 250) == 255).all()
    assert (levels(1, 0) == round(0.12 * 255)).all()


def test_a_third_of_the_pairs_is_blurred_by_up_to_a_pixel():
    """A line of one pixel is spread as a normal distribution."""
    image = np.zeros((33, 33, 3), np.uint8)
    image[:, 16] = 60
    sharp, seen = (
        EFFECTS(Ends(1, share, 0.67, 0.34), pair_of(image, image)).current[16, :, 0] for share in (0.34, 0.33)
    )
    line, blurred = sharp.astype(float) - sharp[0], seen.astype(float) - seen[0]
    assert (line > 0).sum() == 1
    assert blurred.sum() == pytest.approx(line.sum(), rel=0.05)
    variance = (blurred * (np.arange(33) - 16) ** 2).sum() / blurred.sum()
    assert variance**0.5 == pytest.approx(1.1, rel=0.05)


def test_noise_of_each_channel_is_up_to_three_per_cent():
    seen = levels(1, 60, 0.34, 0.66, 0.34).astype(float)
    assert seen.std(axis=(0, 1)) == pytest.approx([7.5] * 3, rel=0.1)


def test_a_third_of_the_pairs_is_a_jpeg():
    rng = np.random.default_rng(0)
    image = rng.integers(60, 200, (32, 32, 3), np.uint8)
    plain, seen = (
        EFFECTS(Ends(0, 0.34, 0.67, share), pair_of(image, image)).current for share in (0.34, 0.33)
    )
    assert np.array_equal(seen, through_jpeg(plain, 35))
