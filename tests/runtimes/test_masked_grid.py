"""A grid of a source of which a part is masked: maps say nothing there, and the same as ever beside it."""

import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.runtimes.grid import NetworkGrid, check_mask

PINHOLE = Camera.from_fov(640, 360, 75)
FISHEYE = Camera(960, 540, 720.0, 720.0, 479.5, 269.5, (0.03, 0.07, -0.07, 0.03), "fisheye")


def leg(camera):
    """A bar from the lower left corner, of 5 % of the picture."""
    rows, columns = np.indices((camera.height, camera.width))
    x, y = (columns + 0.5) / camera.width, (rows + 0.5) / camera.height
    return ~((y > 0.6) & (np.abs(x - 0.5 * (1 - y)) < 0.0625))


@pytest.mark.parametrize("camera", [PINHOLE, FISHEYE], ids=["pinhole", "fisheye"])
@pytest.mark.parametrize("focal_px", [128, 256])
def test_every_map_says_nothing_of_what_is_masked_and_the_rest_as_ever(camera, focal_px):
    plain, shown = NetworkGrid(camera, focal_px), leg(camera)
    grid = plain.masked(shown)
    assert 1 - shown.mean() == pytest.approx(0.05, abs=0.005)
    picture = np.random.default_rng(0).integers(0, 256, (camera.height, camera.width, 3), np.uint8)
    for masked, whole in zip(told(grid, grid.image(picture)), told(plain, plain.image(picture)), strict=True):
        assert np.isnan(masked[~shown]).all()
        np.testing.assert_array_equal(np.isfinite(masked)[shown], np.isfinite(whole)[shown])
        np.testing.assert_allclose(masked[shown], whole[shown], rtol=1e-5)


def told(grid, picture):
    """All ways to the source of a map that is the same everywhere but where the grid shows no scene."""
    map_hw = np.where(grid.valid, np.float32(10), np.float32(99))
    along = grid.along_edges(map_hw, picture)
    yield from (along.depth_m, along(map_hw), along.marks(map_hw))
    # What is no padding may be the masked side of a block, so these take the value of a block that is masked.
    yield grid.to_source(np.full_like(map_hw, 10))
    yield grid.to_source(np.full_like(map_hw, 10), "nearest")


def test_a_block_that_is_masked_in_part_is_not_valid():
    shown = np.ones((360, 640), np.bool_)
    shown[100, 100] = False
    plain = NetworkGrid(PINHOLE, 256)
    lost = plain.valid & ~plain.masked(shown).valid
    assert 1 <= lost.sum() <= 2


def test_the_plain_grid_stays_as_it_is():
    plain = NetworkGrid(PINHOLE, 256)
    before = plain.blocks.shown.copy(), plain.valid.copy()
    grid = plain.masked(leg(PINHOLE))
    np.testing.assert_array_equal(plain.blocks.shown, before[0])
    np.testing.assert_array_equal(plain.valid, before[1])
    assert (grid.blocks.valid == grid.valid).all()


@pytest.mark.parametrize(
    ("mask", "got"),
    [
        (np.ones((640, 360), np.uint8), r"uint8 \[640, 360\]"),
        (np.ones((360, 640, 3), np.uint8), r"uint8 \[360, 640, 3\]"),
        (np.ones((360, 640)), r"float64 \[360, 640\]"),
        ("mask.png", "str"),
    ],
)
def test_what_is_no_mask_of_the_camera_is_refused(mask, got):
    with pytest.raises(
        BadInput, match=rf"mask: expected uint8 or bool \[360, 640\], the camera's size, got {got}"
    ):
        check_mask(mask, PINHOLE)


def test_a_mask_that_leaves_nothing_is_refused():
    with pytest.raises(
        BadInput, match="mask: expected white where the network sees the scene, got black all over"
    ):
        NetworkGrid(PINHOLE, 256).masked(np.zeros((360, 640), np.bool_))
