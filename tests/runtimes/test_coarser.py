"""What moved farther than a network's sweep reaches, seen in smaller pictures."""

from collections.abc import Mapping
from functools import cache, partial

import cv2
import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.runtimes.coarser import beyond_reach, coarser_grid, reach_px, take_near
from flightdepth.runtimes.network import Network, load_network
from tests_networks import difference_card, swept_card

SQUARE = Camera(128, 128, 64.0, 64.0, 63.5, 63.5)
MOVED = [[2.0, 0.0, 0.0]]
BLANK = np.zeros((128, 128, 3), np.uint8)


class Said:
    """A MotionNet that says of pictures of each width how far points moved, left half and right half, in pixels."""

    description = "made by hand"
    architecture = "MotionNet"

    def __init__(self, **moved_px: tuple[float, float]) -> None:
        self.moved_px = {int(name.removeprefix("at_")): told for name, told in moved_px.items()}
        self.calls: list[tuple[int, ...]] = []

    def __call__(self, inputs: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        n, height, width = inputs["current"].shape[:3]
        self.calls.append((n, height, width))
        left, right = self.moved_px[width]
        moved_px = np.where(np.arange(width // 4) < width // 8, left, right)
        depth_m = np.broadcast_to(64.0 * 0.3 / moved_px, (n, height // 4, width // 4)).astype(np.float32)
        return {"depth_m": depth_m.copy(), "sigma_m": depth_m * np.float32(0.001 * width)}


def moved_px(runtime: Said, pairs: int = 1, *, looks: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Shifts in pixels of 128, and deviations over depth, on the grid."""
    network = Network(swept_card(looks=looks), runtime, aligned=False)
    prediction = network.predict([BLANK] * pairs, BLANK, MOVED * pairs, SQUARE)
    assert prediction.sigma_m is not None
    return 64.0 * 2.0 / prediction.depth_m, prediction.sigma_m / prediction.depth_m


def test_near_pixels_are_those_of_the_smaller_picture_and_no_others() -> None:
    runtime = Said(at_128=(50.0, 5.0), at_64=(20.0, 3.0))
    shifts, deviations = moved_px(runtime, pairs=2)
    assert runtime.calls == [(2, 128, 128), (2, 64, 64)]
    np.testing.assert_allclose(shifts[:, :, :14], 40.0, rtol=1e-5)
    np.testing.assert_allclose(shifts[:, :, 18:], 5.0, rtol=1e-5)
    np.testing.assert_allclose(deviations[:, :, :14], 0.064, rtol=1e-4)
    np.testing.assert_allclose(deviations[:, :, 18:], 0.128, rtol=1e-4)


def test_warming_up_compiles_for_the_smaller_pictures_too() -> None:
    """A flight's first near thing would wait for it."""
    runtime = Said(at_128=(1.0, 1.0), at_64=(1.0, 1.0))
    Network(swept_card(), runtime).warm_up(SQUARE, pairs=2)
    assert runtime.calls == [(1, 128, 128), (2, 128, 128), (1, 64, 64), (2, 64, 64)]


def test_what_the_smaller_picture_says_is_within_reach_stays() -> None:
    """Only one of both can be right, and within reach it is the finer one."""
    shifts, _ = moved_px(Said(at_128=(50.0, 5.0), at_64=(10.0, 3.0)))
    np.testing.assert_allclose(shifts[:, :, :14], 50.0, rtol=1e-5)


@pytest.mark.parametrize("looks", [1, 2])
def test_nothing_is_looked_at_again_where_all_is_within_reach(looks: int) -> None:
    reach = reach_px(swept_card(looks=looks))
    for farthest_px, calls in ((5.0, 1), (reach - 1, 1), (reach + 1, 2)):
        runtime = Said(at_128=(farthest_px, 1.0), at_64=(farthest_px / 2, 1.0))
        moved_px(runtime, looks=looks)
        assert len(runtime.calls) == calls


def test_a_second_look_reaches_a_third_farther() -> None:
    assert [reach_px(swept_card(looks=looks)) for looks in (1, 2)] == pytest.approx([28.0, 36.4])


def test_only_the_pair_that_moved_far_is_looked_at_again() -> None:
    """The first of two pairs is the short one."""

    class Second(Said):
        def __call__(self, inputs: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
            said = super().__call__(inputs)
            if len(said["depth_m"]) == 2:
                said["depth_m"][0] = 64.0 * 0.3 / 4
            return said

    runtime = Second(at_128=(50.0, 5.0), at_64=(20.0, 3.0))
    shifts, deviations = moved_px(runtime, pairs=2)
    assert runtime.calls == [(2, 128, 128), (1, 64, 64)]
    np.testing.assert_allclose(shifts[0], 4.0, rtol=1e-5)
    np.testing.assert_allclose(shifts[1, :, :14], 40.0, rtol=1e-5)
    np.testing.assert_allclose(deviations[1, :, :14], 0.064, rtol=1e-4)


def test_each_pair_takes_what_the_smaller_pictures_say_of_it() -> None:
    class Farther(Said):
        def __call__(self, inputs: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
            said = super().__call__(inputs)
            said["depth_m"][1:] /= 1.1
            return said

    shifts, _ = moved_px(Farther(at_128=(50.0, 5.0), at_64=(20.0, 3.0)), pairs=2)
    np.testing.assert_allclose(shifts[0, :, :14], 40.0, rtol=1e-5)
    np.testing.assert_allclose(shifts[1, :, :14], 44.0, rtol=1e-5)


def test_what_only_the_smaller_picture_sees_beyond_reach_is_taken_from_it() -> None:
    """Beyond reach the finer one may take anything for the best: a repeated pattern, 5 px away."""
    shifts, _ = moved_px(Said(at_128=(50.0, 5.0), at_64=(20.0, 20.0)))
    np.testing.assert_allclose(shifts, 40.0, rtol=1e-5)


def test_a_slope_of_the_smaller_picture_comes_back_where_it_was() -> None:
    """Along the rows and the columns of a picture twice as wide as high."""
    card, camera = swept_card(), Camera(256, 128, 64.0, 64.0, 127.5, 63.5)
    grid = coarser_grid(card, camera)
    assert grid is not None
    y, x = np.indices((16, 32), np.float32)
    coarse = (0.1 + 0.002 * x + 0.004 * y)[None].astype(np.float32)  # metres at D0: all beyond reach
    output = {name: np.full((1, 32, 64), 50.0, np.float32) for name in ("depth_m", "sigma_m")}
    take_near(card, output, [0], {"depth_m": coarse, "sigma_m": 0.1 * coarse}, grid)
    y, x = ((each + 0.5) / 2 - 0.5 for each in np.indices((32, 64)))
    for name, share in (("depth_m", 0.5), ("sigma_m", 0.05)):  # half the focal length, half the depth
        truth = share * (0.1 + 0.002 * x + 0.004 * y)
        np.testing.assert_allclose(output[name][0, 1:-1, 1:-1], truth[1:-1, 1:-1], rtol=1e-4)


def test_pictures_of_64_px_are_the_smallest() -> None:
    runtime = Said(at_128=(90.0, 90.0), at_64=(50.0, 50.0))
    moved_px(runtime)
    assert [call[-1] for call in runtime.calls] == [128, 64]


shipped = cache(partial(load_network, precision="f32"))


@pytest.mark.parametrize(("name", "width"), [("motion", 256), ("motion-tiny", 128)])
@pytest.mark.parametrize("pixels", [40, 56])
def test_a_shipped_network_measures_what_moved_far(name: str, width: int, pixels: int) -> None:
    """Sideways flight along a wall of smooth noise: depth = focal * displacement / pixels."""
    camera = Camera(width, 128, 256.0, 256.0, width / 2 - 0.5, 63.5)
    noise = np.random.default_rng(4).integers(0, 256, (camera.height, camera.width + pixels), dtype=np.uint8)
    smooth = np.clip(cv2.GaussianBlur(noise, (0, 0), 3.0) * 4.0 - 384, 0, 255).astype(np.uint8)
    wall = np.repeat(smooth[..., None], 3, axis=2)
    network = shipped(name).at_focal(256)
    now, before = wall[:, pixels:], wall[:, :-pixels]  # the camera flew right, the wall went left
    depth_m = network.depth(np.ascontiguousarray(before), np.ascontiguousarray(now), [1.0, 0.0, 0.0], camera)
    inside = depth_m[8:-8, 8 : -pixels - 8]
    assert np.median(inside) == pytest.approx(256.0 / pixels, rel=0.06)


def test_a_picture_whose_shorter_side_is_64_px_has_no_smaller_one() -> None:
    for width, height in ((256, 64), (64, 256)):
        assert coarser_grid(swept_card(), Camera.from_fov(width, height, 90)) is None
    assert coarser_grid(difference_card(), SQUARE) is None
    half = coarser_grid(swept_card(), SQUARE)
    assert half is not None and (half.camera.width, half.camera.height) == (64, 64)


def test_padding_asks_for_no_second_look() -> None:
    """Two per cent of the first picture moved by 40 px, and as much of the second's padding."""
    valid = np.ones((32, 32), np.bool_)
    valid[:, 30:] = False
    moved_px = np.full((2, 32, 32), 5.0, np.float32)
    moved_px[0, :, 0], moved_px[1, :, 31] = 40.0, 40.0
    assert beyond_reach(swept_card(), np.float32(64 * 0.3) / moved_px, valid) == [0]


def test_a_hundredth_of_the_picture_asks_for_a_second_look_and_less_does_not() -> None:
    for near, far in ((10, []), (11, [0])):  # of 1024 pixels
        moved_px = np.full((1, 32, 32), 5.0, np.float32)
        moved_px[0, 0, :near] = 40.0
        assert beyond_reach(swept_card(), 64 * 0.3 / moved_px, np.ones((32, 32), np.bool_)) == far


def test_the_reach_of_a_network_with_another_displacement_is_as_many_pixels() -> None:
    card, everywhere = swept_card().model_copy(update={"D0_m": 0.6}), np.ones((4, 4), np.bool_)
    told = [np.full((1, 4, 4), 64 * 0.6 / pixels, np.float32) for pixels in (20, 40)]
    assert [beyond_reach(card, depth_m, everywhere) for depth_m in told] == [[], [0]]


def test_the_reach_of_a_network_with_another_focal_length_is_as_many_pixels() -> None:
    card, everywhere = swept_card().model_copy(update={"focal_px": 128.0}), np.ones((4, 4), np.bool_)
    told = [np.full((1, 4, 4), 128 * 0.3 / pixels, np.float32) for pixels in (20, 40)]
    assert [beyond_reach(card, depth_m, everywhere) for depth_m in told] == [[], [0]]


def test_pictures_that_were_scaled_have_smaller_ones_too() -> None:
    """They lie between levels, as no camera's do."""
    camera = Camera(250, 250, 125.0, 125.0, 124.5, 124.5)
    runtime = Said(at_128=(50.0, 5.0), at_64=(20.0, 3.0))
    picture = np.zeros((250, 250, 3), np.uint8)
    Network(swept_card(), runtime, aligned=False).predict([picture], picture, MOVED, camera)
    assert runtime.calls == [(1, 128, 128), (1, 64, 64)]


def test_a_picture_that_half_does_not_fill_a_grid_is_seen_as_large_as_does() -> None:
    """Of 192 px a half is 96, which takes a grid of 128: two thirds, so 20 px there are 30."""
    camera, runtime = Camera(192, 192, 64.0, 64.0, 95.5, 95.5), Said(at_192=(50.0, 5.0), at_128=(20.0, 3.0))
    found = Network(swept_card(), runtime, aligned=False).predict([BLANK_192], BLANK_192, MOVED, camera)
    assert [call[-1] for call in runtime.calls] == [192, 128]
    np.testing.assert_allclose(64.0 * 2.0 / found.depth_m[:, :, :20], 30.0, rtol=1e-5)


BLANK_192 = np.zeros((192, 192, 3), np.uint8)
