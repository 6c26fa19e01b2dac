"""What a lens takes from the corners: a textured plane that the camera flies past, through lenses of known strength."""

from functools import cache, partial

import cv2
import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.ranges import MultiRangeEstimator
from flightdepth.ranges.estimator import VIGNETTING
from flightdepth.ranges.pairs import Frame
from flightdepth.ranges.vignetting import BACK, EVERY, LEAST_STRENGTH, Vignetting
from flightdepth.runtimes.network import load_network

CAMERA = Camera.from_fov(256, 192, 90)
PAIRS = 12
shipped = cache(partial(load_network, threads=1))


def fall(strength):
    x, y = CAMERA.ray_axes()
    return ((1 + x**2 + y**2) ** -strength)[..., None]


def filmed(strength: float, *, brighter: float = 1.0, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Two pictures of a plane, the camera nearer in the second, and to one side; the second exposed anew."""
    rng = np.random.default_rng(seed)
    coarse = cv2.resize(
        rng.uniform(60, 190, (30, 40)).astype(np.float32), (512, 384), interpolation=cv2.INTER_CUBIC
    )
    fine = cv2.GaussianBlur(rng.normal(0, 40, (384, 512)).astype(np.float32), (0, 0), 1.5)
    plane = np.repeat((coarse + fine).clip(40, 210)[..., None], 3, axis=2)
    pictures = []
    for scale, across in ((1.0, 0.0), (1.06, rng.uniform(-8, 8))):
        to_plane = np.array(
            [[1 / scale, 0, 128 - 128 / scale + 128 + across], [0, 1 / scale, 96 - 96 / scale + 96]]
        )
        seen = cv2.warpAffine(plane, to_plane, (256, 192), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
        gain = brighter if pictures else 1.0
        pictures.append(np.rint((seen * fall(strength) * gain).clip(0, 255)).astype(np.uint8))
    return pictures[0], pictures[1]


def learnt(strength: float, pairs: int = PAIRS, **changes) -> Vignetting:
    lens = Vignetting(CAMERA)
    for seed in range(pairs):
        lens.learn(*filmed(strength, seed=seed, **changes))
    return lens


@pytest.mark.parametrize("strength", [0.1, 0.3, 0.45, 0.9])
@pytest.mark.parametrize("brighter", [1.0, 1.04])
def test_a_lens_s_strength_is_found(strength, brighter):
    """Though the exposure of the second picture is a little another."""
    lens = learnt(strength, brighter=brighter)
    told, sigma = lens.estimate
    assert told == pytest.approx(strength, abs=0.03 + 0.05 * strength)
    assert sigma < 0.03
    assert lens.strength == told


def test_through_a_good_lens_pictures_stay_as_they_are_to_the_bit():
    lens = learnt(0.0)
    assert abs(lens.estimate[0]) < LEAST_STRENGTH
    picture = filmed(0.0)[0]
    assert lens.evened(picture) is picture


def test_pairs_between_which_the_exposure_changed_tell_nothing():
    lens = learnt(0.45, brighter=1.15)
    assert lens.estimate == (0.0, np.inf)


@pytest.mark.parametrize(
    ("told", "sigma", "taken_out"),
    [(0.3, 0.09, 0.3), (0.3, 0.11, 0.0), (0.07, 0.01, 0.07), (0.05, 0.01, 0.0), (1.5, 0.01, 1.0)],
)
def test_what_is_taken_out_stands_out_and_is_no_more_than_all_of_a_lens(told, sigma, taken_out):
    """By three deviations, and by what a flight without any showed; half of cos^4 is (1 + tan^2)^-1."""
    lens = Vignetting(CAMERA)
    lens._weight, lens._weighted = sigma**-2, told * sigma**-2
    assert lens.estimate == pytest.approx((told, sigma))
    assert lens.strength == pytest.approx(taken_out)


def test_pictures_follow_what_is_learnt_and_stay_within_white(monkeypatch):
    lens, grey = Vignetting(CAMERA), np.full((192, 256, 3), 220, np.uint8)
    for strength in (0.1, 0.2):
        monkeypatch.setattr(Vignetting, "strength", strength)
        wanted = np.broadcast_to((220 / fall(strength)).clip(0, 255), grey.shape)
        np.testing.assert_allclose(lens.evened(grey), wanted, atol=1e-3)
    assert wanted.max() == 255


def test_what_is_nearly_black_tells_nothing_and_a_dozen_points_beside_it_too_little():
    """Down there a grey level is no power of the light."""
    lens = Vignetting(CAMERA)
    for seed in range(3):
        pictures = filmed(0.3, seed=seed)
        dark = [(8 + (each - 125.0) / 12).clip(0, 255).astype(np.uint8) for each in pictures]
        for each, picture in zip(dark, pictures, strict=True):
            each[:80, :80] = picture[:80, :80]
        lens.learn(*dark)
    assert lens.estimate == (0.0, np.inf)


def test_nothing_is_done_before_it_is_sure():
    lens = Vignetting(CAMERA)
    picture = filmed(0.3)[0]
    assert lens.estimate == (0.0, np.inf)
    assert lens.evened(picture) is picture


def test_evened_pictures_are_as_bright_in_the_corners_as_without_the_lens():
    with_lens, without = filmed(0.45)[0], filmed(0.0)[0]
    evened = learnt(0.45).evened(with_lens)
    corner = np.s_[:24, :24]
    assert with_lens[corner].mean() < 0.8 * without[corner].mean()
    assert evened[corner].mean() == pytest.approx(without[corner].mean(), rel=0.04)
    middle = np.s_[90:102, 122:134]
    assert np.abs(evened[middle].astype(int) - without[middle]).max() <= 1


def test_what_is_masked_does_not_count():
    """Half of the picture is the drone's own, in brightness that changes."""
    shown = np.ones((48, 64), bool)
    shown[:, 32:] = False
    lens = Vignetting(CAMERA, shown)
    for seed in range(2 * PAIRS):
        previous, current = filmed(0.45, seed=seed)
        for picture, drone in zip((previous, current), filmed(0.0, brighter=1.03, seed=99), strict=True):
            picture[:, 128:] = drone[:, 128:]
        lens.learn(previous, current)
    assert lens.estimate[0] == pytest.approx(0.45, abs=0.05)


def test_pictures_without_corners_tell_nothing():
    lens = Vignetting(CAMERA)
    grey = np.full((192, 256, 3), 120, np.uint8)
    lens.learn(grey, grey)
    assert lens.estimate == (0.0, np.inf)


class Spy:
    """A network that keeps the pictures it is shown."""

    def __init__(self, name: str = "motion-tiny") -> None:
        self._network, self.shown = shipped(name), []

    def __getattr__(self, name):
        return getattr(self._network, name)

    def predict(self, previous_n, current, *rest):
        self.shown.append((*previous_n, current))
        return self._network.predict(previous_n, current, *rest)


@pytest.mark.parametrize("strength", [0.0, 0.45])
def test_a_network_sees_pictures_evened_out_and_the_result_says_so(monkeypatch, strength):
    monkeypatch.setattr(Vignetting, "strength", strength)
    network, pictures = Spy(), filmed(0.45)
    estimator = MultiRangeEstimator(network, CAMERA, ranges=1, derotate=False)
    for index, picture in enumerate(pictures):
        estimator.add_velocity(index * 10**8, (0.5, 0.0, 3.0), frame="camera")
        result = estimator.add_frame(index * 10**8, picture)
    assert (VIGNETTING in result.notes) == bool(strength)
    lens = Vignetting(CAMERA)
    for seen, picture in zip(network.shown[0], pictures, strict=True):
        np.testing.assert_array_equal(seen, lens.evened(picture))


@pytest.mark.parametrize(("name", "pairs"), [("motion-tiny", 1), ("tiny-clamped-256", 0)])
def test_a_flight_is_learnt_from(monkeypatch, name, pairs):
    """Its frames as they come, not as they were evened out; for a DepthNet, which is no better for it, nothing is."""
    monkeypatch.setattr(Vignetting, "strength", 0.45)
    learnt_from = []
    monkeypatch.setattr(Vignetting, "learn", lambda self, *pair: learnt_from.append(pair))
    estimator = MultiRangeEstimator(Spy(name), CAMERA, ranges=1, derotate=False)
    pictures = [filmed(0.45, seed=seed)[0] for seed in range(BACK + EVERY)]
    for index, picture in enumerate(pictures):
        estimator.add_frame(index * 10**8, picture)
    assert len(learnt_from) == pairs
    for picture in [picture for pair in learnt_from for picture in pair]:
        assert any(np.array_equal(picture, each) for each in pictures)


def test_every_few_frames_are_looked_at_until_enough_is_known():
    lens, looked = Vignetting(CAMERA), []
    lens.learn = lambda previous, current: looked.append((previous, current))  # type: ignore[method-assign]
    frames = [Frame(index, index, np.full((2, 2, 3), index, np.uint8)) for index in range(4 * EVERY + 1)]
    for index, frame in enumerate(frames):
        lens.watch(frame, frames[:index])
    assert [(int(a[0, 0, 0]), int(b[0, 0, 0])) for a, b in looked] == [
        (index - BACK, index) for index in range(EVERY, 4 * EVERY + 1, EVERY) if index >= BACK
    ]
    lens._weight = 1e9
    lens.watch(frames[-1], frames[:-1])
    assert len(looked) == 3


def test_a_video_that_shows_each_picture_five_times_is_learnt_from_as_often():
    lens, looked = Vignetting(CAMERA), []
    lens.learn = lambda previous, current: looked.append(current)  # type: ignore[method-assign]
    frames = [Frame(5 * k + 1, k, np.full((2, 2, 3), k, np.uint8)) for k in range(2 * EVERY + 1)]
    for k, frame in enumerate(frames):
        lens.watch(frame, frames[:k])
    assert [int(picture[0, 0, 0]) for picture in looked] == [2 * EVERY]
