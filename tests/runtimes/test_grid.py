from __future__ import annotations

import math
import tracemalloc
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.runtimes import lens as lens_tables
from flightdepth.runtimes.grid import NetworkGrid, filling_focal_px, shown, wide_focal_px
from flightdepth.runtimes.lens import distort, inside, pixel_rays
from flightdepth.runtimes.sampling import halved

KARMA = Camera.from_fov(854, 480, 64.4)
BARREL = Camera(640, 360, 450.0, 450.0, 322.0, 178.0, (-0.28, 0.09, 0.001, -0.0005, 0.0))
FISHEYE = Camera(640, 360, 250.0, 250.0, 320.0, 180.0, (0.02, -0.01, 0.0, 0.0), "fisheye")
CAMERAS = [KARMA, Camera(400, 300, 300.0, 240.0, 190.0, 160.0), BARREL, FISHEYE]
NAMES = ["pinhole", "oblong pixels", "barrel", "fisheye"]

cameras = st.builds(
    lambda width, height, fx, ratio: Camera(width, height, fx, fx * ratio, width / 2, height / 2),
    st.integers(64, 900),
    st.integers(64, 700),
    st.floats(60, 900),
    st.floats(0.7, 1.4),
)


def source_plane(camera: Camera, slope: tuple[float, float, float]) -> np.ndarray:
    """a + b X/Z + c Y/Z at each source pixel: linear on the grid, whatever the lens."""
    columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    pixels = np.stack([columns, rows], -1).reshape(-1, 1, 2).astype(np.float64)
    bend = np.array(camera.distortion or (0.0,) * 4)
    if camera.model == "fisheye":
        rays = cv2.fisheye.undistortPoints(pixels, camera.matrix, bend)
    else:
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-9)
        rays = cv2.undistortPointsIter(pixels, camera.matrix, bend, np.eye(3), np.eye(3), criteria)
    x, y = rays.reshape(camera.height, camera.width, 2).transpose(2, 0, 1)
    return slope[0] + slope[1] * x + slope[2] * y


def grid_plane(grid: NetworkGrid, slope: tuple[float, float, float]) -> np.ndarray:
    h, w = grid.valid.shape
    rays = grid.camera.resized(w, h).rays()
    return (slope[0] + slope[1] * rays[..., 0] + slope[2] * rays[..., 1]).astype(np.float32)


@given(camera=cameras, focal_px=st.sampled_from([64.0, 128.0, 256.0]))
@settings(max_examples=60, deadline=None)
def test_sizes_are_multiples_of_64_and_the_focal_length_is_the_networks(
    camera: Camera, focal_px: float
) -> None:
    grid = NetworkGrid(camera, focal_px)
    assert grid.camera.width % 64 == grid.camera.height % 64 == 0
    # A pixel of the grid, or half of the source's where that is coarser; 1 % where the source may stay.
    for focal, length, scale in (
        (grid.camera.fx, camera.width * focal_px / camera.fx, focal_px / camera.fx),
        (grid.camera.fy, camera.height * focal_px / camera.fy, focal_px / camera.fy),
    ):
        assert abs(focal / focal_px - 1) <= max(0.01, max(1, scale / 2) / (length - 4))


@given(camera=cameras, focal_px=st.sampled_from([64.0, 128.0, 256.0]))
@settings(max_examples=60, deadline=None)
def test_nothing_moves_on_a_grids_own_grid(camera: Camera, focal_px: float) -> None:
    camera = NetworkGrid(camera, focal_px).camera
    grid = NetworkGrid(camera, None)
    image = np.zeros((camera.height, camera.width, 3), np.uint8)
    assert grid.camera == camera
    assert grid.image(image) is image
    assert grid.valid.all()


@pytest.mark.parametrize("camera", CAMERAS, ids=NAMES)
@pytest.mark.parametrize("focal_px", [100.0, 128.0, 200.0, 256.0])
def test_the_filling_focal_length_fills_one_axis_and_takes_no_more_pixels(
    camera: Camera, focal_px: float
) -> None:
    grid = NetworkGrid(camera, focal_px)
    filled_px = filling_focal_px(camera, focal_px)
    filled = NetworkGrid(camera, filled_px)
    assert filled_px >= focal_px
    assert (filled.camera.width, filled.camera.height) == (grid.camera.width, grid.camera.height)
    assert filling_focal_px(camera, filled_px) == pytest.approx(filled_px, rel=1e-4)
    assert filled.valid.any(axis=0).all() or filled.valid.any(axis=1).all()


@pytest.mark.parametrize("camera", CAMERAS, ids=NAMES)
def test_a_plane_comes_back_to_the_source_where_it_was(camera: Camera) -> None:
    slope = (10.0, 2.0, 3.0)
    grid = NetworkGrid(camera, 256)
    back, truth = grid.to_source(grid_plane(grid, slope)), source_plane(camera, slope)
    seen = np.isfinite(back)
    # The outermost half cell repeats its neighbour; 1/32 of a cell is OpenCV's step in a remap.
    inner_cells = cv2.erode(grid.valid.astype(np.float32), np.ones((3, 3)), borderValue=0)
    inner = grid.to_source(inner_cells, "nearest") == 1
    cell = 3.0 * 4 / 256
    assert np.abs(back - truth)[seen & inner].max() < cell / 8
    assert np.abs(back - truth)[seen].max() < 1.5 * cell


@pytest.mark.parametrize("camera", CAMERAS, ids=NAMES)
def test_a_picture_is_on_the_grid_where_its_camera_says(camera: Camera) -> None:
    slope = (128.0, 60.0, 50.0)
    grid = NetworkGrid(camera, 200)
    image = np.repeat(source_plane(camera, slope).clip(0, 255).round().astype(np.uint8)[..., None], 3, axis=2)
    rays = grid.camera.rays()
    truth = (slope[0] + slope[1] * rays[..., 0] + slope[2] * rays[..., 1]).clip(0, 255)
    valid = np.kron(grid.valid, np.ones((4, 4), bool))
    valid = cv2.erode(valid.astype(np.uint8), np.ones((9, 9), np.uint8)).astype(bool)
    error = np.abs(grid.image(image)[..., 1].astype(float) - truth)[valid]
    assert error.mean() < 0.5
    assert error.max() < 2


@pytest.mark.parametrize("camera", CAMERAS, ids=NAMES)
def test_a_constant_map_stays_constant(camera: Camera) -> None:
    grid = NetworkGrid(camera, 128)
    back = grid.to_source(np.full(grid.valid.shape, 7.0, np.float32))
    assert back.dtype == np.float32
    assert back.shape == (camera.height, camera.width)
    assert set(np.unique(back[np.isfinite(back)])) == {np.float32(7.0)}


@pytest.mark.parametrize("camera", CAMERAS, ids=NAMES)
def test_nan_stays_where_it_is_nearest_and_leaves_its_neighbours_alone(camera: Camera) -> None:
    grid = NetworkGrid(camera, 256)
    h, w = grid.valid.shape
    holed = np.full((h, w), 5.0, np.float32)
    holed[h // 2, w // 2] = np.nan
    back, nearest = grid.to_source(holed), grid.to_source(holed, "nearest")
    assert np.array_equal(np.isnan(back), np.isnan(nearest))
    assert np.isnan(back).any()
    assert back[np.isfinite(back)] == pytest.approx(5.0)


@pytest.mark.parametrize("camera", CAMERAS, ids=NAMES)
def test_the_nearest_of_two_values_is_one_of_them(camera: Camera) -> None:
    grid = NetworkGrid(camera, 128)
    rows, columns = np.indices(grid.valid.shape)
    back = grid.to_source((1 + (rows + columns) % 2).astype(np.float32), "nearest")
    assert set(np.unique(back[np.isfinite(back)])) == {1.0, 2.0}


def test_one_nan_cell_covers_as_many_source_pixels_as_the_cell() -> None:
    grid = NetworkGrid(KARMA, 256)
    holed = np.zeros(grid.valid.shape, np.float32)
    holed[20, 40] = np.nan
    cell_px = 4 * KARMA.fx / 256
    assert np.isnan(grid.to_source(holed)).sum() == pytest.approx(cell_px**2, rel=0.2)


def test_padding_never_reaches_the_source() -> None:
    grid = NetworkGrid(KARMA, 128)
    marked = np.where(grid.valid, np.float32(1), np.float32(-1e6))
    assert (grid.to_source(marked) == 1).all()


def test_the_karma_picture_is_320_by_192() -> None:
    grid = NetworkGrid(KARMA, 256)
    assert (grid.camera.width, grid.camera.height) == (320, 192)
    assert grid.valid.sum(axis=0).max() == 180 // 4


def test_a_square_90_degree_picture_is_its_own_grid() -> None:
    assert NetworkGrid(Camera.from_fov(256, 256, 90), 128).camera == Camera.from_fov(256, 256, 90)


def test_padding_repeats_the_border() -> None:
    image = np.zeros((180, 320, 3), np.uint8)
    image[0], image[-1] = 50, 200
    out = NetworkGrid(Camera(320, 180, 256.0, 256.0, 159.5, 89.5), 256).image(image)
    assert out.shape == (192, 320, 3)
    assert (out[:5] == 50).all()
    assert (out[184:] == 200).all()


def test_padding_of_a_lens_s_picture_repeats_the_border() -> None:
    grey = np.full((360, 640, 3), 200, np.uint8)
    assert (NetworkGrid(BARREL, 128).image(grey) == 200).all()


def test_a_picture_of_fewer_pixels_than_its_grid_is_smooth_there() -> None:
    ramp = np.repeat(np.broadcast_to(4 * np.arange(48, dtype=np.uint8), (48, 48))[..., None], 3, axis=2)
    out = NetworkGrid(Camera(48, 48, 32.0, 32.0, 23.5, 23.5), 128).image(ramp)
    assert out.shape == (192, 192, 3)
    np.testing.assert_allclose(np.diff(out[:, 4:-4], axis=1), 1.0, atol=0.02)


def test_a_picture_of_odd_size_is_halved_where_it_is() -> None:
    ramp = np.repeat((10 * np.arange(7) + np.arange(5)[:, None])[..., None].astype(np.uint8), 3, axis=2)
    expected = 10 * np.array([0.5, 2.5, 4.5]) + np.array([0.5, 2.5])[:, None]
    np.testing.assert_allclose(halved(ramp, 1)[..., 0], expected)


def test_a_grid_of_half_of_95_px_takes_no_pixel_that_there_is_not() -> None:
    """47.5 px are 48 of the grid, which would be 96 of the source."""
    grid = NetworkGrid(Camera(95, 95, 100.0, 100.0, 47.0, 47.0), 50)
    assert (grid.image(np.full((95, 95, 3), 9, np.uint8)) == 9).all()
    assert (grid.to_source(np.ones(grid.valid.shape, np.float32)) == 1).all()


def test_shrinking_averages_a_checkerboard_away() -> None:
    rows, columns = np.indices((512, 512))
    board = np.repeat((((rows + columns) % 2) * 255).astype(np.uint8)[..., None], 3, axis=2)
    for focal_px in (128.0, 100.0, 90.0, 64.0):
        out = NetworkGrid(Camera.from_fov(512, 512, 90), focal_px).image(board)
        assert np.abs(out.astype(int) - 127).max() <= 2


@pytest.mark.parametrize("camera", [KARMA, BARREL], ids=["pinhole", "lens"])
def test_greys_between_levels_stay_on_the_grid(camera: Camera) -> None:
    """A slope so gentle that a level is several pixels of the grid wide: dithered, as noise does it in a video."""
    rows, columns = np.indices((camera.height, camera.width))
    slope = 100 + columns / 100 + rows / 200
    noise = np.random.default_rng(0).uniform(-0.5, 0.5, slope.shape)
    image = np.repeat(np.rint(slope + noise).astype(np.uint8)[..., None], 3, axis=2)
    out = NetworkGrid(camera, 128).image(image)[40:-40, 40:-40]
    assert out.dtype == np.float32
    y, x = np.indices(out.shape[:2]) / out.shape[1]
    smooth = np.polynomial.polynomial.polyvander2d(x.ravel(), y.ravel(), [4, 4])
    left = out[..., 0].ravel() - smooth @ np.linalg.lstsq(smooth, out[..., 0].ravel(), rcond=None)[0]
    assert left.std() < 0.22  # of whole levels 0.29 and more


def test_pixels_that_are_not_square_are_means_of_what_they_hold_along_both_axes() -> None:
    """Across to a third of the pixels, down to four fifths: halving would have blurred what is down."""
    image = np.random.default_rng(0).integers(0, 256, (320, 400, 3), np.uint8)
    grid = NetworkGrid(Camera(400, 320, 400.0, 160.0, 199.5, 159.5), 128)
    assert (grid.camera.width, grid.camera.height) == (128, 256)
    expected = cv2.resize(image.astype(np.float32), (128, 256), interpolation=cv2.INTER_AREA)
    np.testing.assert_allclose(grid.image(image), expected, atol=0.51)


def test_shrinking_leaves_under_half_the_aliasing_of_bilinear_sampling() -> None:
    wave = 127 + 100 * np.sin(np.arange(854) * 2 * math.pi / 3.4)  # too fine for a shrink to 0.38
    image = np.repeat(np.broadcast_to(wave, (480, 854)).astype(np.uint8)[..., None], 3, axis=2)
    ours = NetworkGrid(KARMA, 256).image(image)[20:-20, 20:-20].astype(float)
    bilinear = cv2.resize(image, (322, 181), interpolation=cv2.INTER_LINEAR).astype(float)
    assert ours.std() < 0.5 * bilinear.std()


def test_a_wide_fisheye_is_shown_up_to_60_degrees() -> None:
    camera = Camera(800, 800, 250.0, 250.0, 399.5, 399.5, (), "fisheye")  # 180 degrees across
    grid = NetworkGrid(camera, 64)
    reach = (grid.camera.width / 2) / grid.camera.fx
    assert math.tan(math.radians(60)) <= reach < math.tan(math.radians(60)) + 0.6
    back = grid.to_source(np.ones(grid.valid.shape, np.float32))
    assert np.isnan(back[0, 0])
    assert back[400, 400] == 1


def test_where_a_lens_model_folds_back_nothing_is_valid() -> None:
    # r (1 - 0.5 r^2) turns round at r = 0.82: rays beyond it fall into the picture again.
    camera = Camera(400, 400, 400.0, 400.0, 199.5, 199.5, (-0.5, 0.0, 0.0, 0.0))
    grid = NetworkGrid(camera, 128)
    h, w = grid.valid.shape
    radius = np.linalg.norm(grid.camera.resized(w, h).rays()[..., :2], axis=-1)
    assert not grid.valid[radius > 0.83].any()
    assert grid.valid[radius < 0.5].all()


def test_a_pixel_that_no_ray_of_the_model_falls_on_is_unknown() -> None:
    """The corners of such a calibration got depth of places up to 54 px away."""
    # r (1 - 0.5 r^2) is at most 0.544, 217.7 px from the middle; the corners are 282 px from it.
    camera = Camera(400, 400, 400.0, 400.0, 199.5, 199.5, (-0.5, 0.0, 0.0, 0.0))
    grid = NetworkGrid(camera, 128)
    known = np.isfinite(grid.to_source(np.ones(grid.valid.shape, np.float32)))
    rows, columns = np.indices(known.shape)
    from_middle = np.hypot(rows - 199.5, columns - 199.5)
    assert not known[from_middle > 217.7 + 0.5].any()
    assert known[from_middle < 217.7 - 0.5].all()


@pytest.mark.parametrize("hfov_deg", [1, 2.5, 4, 8, 15])
def test_a_long_lens_with_distortion_fills_its_grid(hfov_deg: float) -> None:
    """Found in review: under 2.6 degrees its coefficients were said not to be inverted; at 5 a quarter was lost."""
    ideal = Camera.from_fov(1920, 1080, hfov_deg)
    bent = replace(ideal, distortion=(-0.02, 0.001, 1e-5, 1e-5, 0.0))
    assert max(shown(bent)) == pytest.approx(max(shown(ideal)), rel=0.1)
    assert min(shown(bent)) == pytest.approx(min(shown(ideal)), rel=0.15)
    grid = NetworkGrid(bent, wide_focal_px(bent, 256))
    assert np.isfinite(grid.to_source(np.ones(grid.valid.shape, np.float32))).all()


@pytest.mark.parametrize("camera", [BARREL, FISHEYE], ids=["barrel", "fisheye"])
def test_tables_of_a_lens_take_little_more_memory_than_what_is_kept(camera: Camera) -> None:
    """Found in review: they took 1.4 GB for a video of 5312x2988, of which 0.25 are kept."""
    large = camera.resized(1920, 1080)
    kept = large.width * large.height * 16
    tracemalloc.start()
    try:
        NetworkGrid(large, 128)
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 3 * kept


def test_bands_of_a_lens_join(monkeypatch: pytest.MonkeyPatch) -> None:
    noise = np.random.default_rng(0).uniform(1, 50, NetworkGrid(BARREL, 128).valid.shape).astype(np.float32)
    whole = NetworkGrid(BARREL, 128).to_source(noise)
    monkeypatch.setattr(lens_tables, "BAND_ROWS", 7)
    assert np.array_equal(NetworkGrid(BARREL, 128).to_source(noise), whole, equal_nan=True)


def test_a_narrow_picture_is_warned_of() -> None:
    warning = NetworkGrid(KARMA, 128).warning
    assert warning is not None
    assert "161 px across (854x480 at focal length 678 px, scaled to 128 px)" in warning


def test_a_picture_wide_enough_is_not_warned_of() -> None:
    assert NetworkGrid(KARMA, 256).warning is None


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((480, 853, 3), np.uint8),
        np.zeros((480, 854), np.uint8),
        np.zeros((480, 854, 4), np.uint8),
        np.zeros((480, 854, 3), np.float32),
        [[0]],
    ],
    ids=["size", "grey", "rgba", "float", "list"],
)
def test_a_wrong_picture_is_refused(image: np.ndarray) -> None:
    with pytest.raises(BadInput, match=r"expected uint8 RGB \[480, 854, 3\]"):
        NetworkGrid(KARMA, 256).image(image)


def test_a_grids_own_pictures_may_lie_between_levels() -> None:
    camera = NetworkGrid(KARMA, 256).camera
    levels = np.full((camera.height, camera.width, 3), 12.25, np.float32)
    assert NetworkGrid(camera, None).image(levels) is levels
    assert NetworkGrid(camera, camera.fx / 2, resampled=True).image(levels) == pytest.approx(12.25)


def test_a_view_smaller_than_one_cell_is_refused() -> None:
    with pytest.raises(
        BadInput, match=r"at least 4 px at the network's focal length, got 1\.3 px.*in pixels"
    ):
        NetworkGrid(Camera(10, 100, 1000.0, 1000.0, 5.0, 50.0), 128)


@pytest.mark.parametrize(
    "strip", [Camera(1787, 52, 8000.0, 7300.0, 893.0, 25.5), Camera(52, 1787, 7300.0, 8000.0, 25.5, 893.0)]
)
def test_a_view_smaller_than_one_cell_is_refused_through_a_lens_too(strip: Camera) -> None:
    """Found in review: a strip through a long lens with distortion ended in OpenCV's own error."""
    with pytest.raises(
        BadInput, match=r"at least 4 px at the network's focal length, got 0\.9 px.*in pixels"
    ):
        NetworkGrid(replace(strip, distortion=(-0.02, 0.001, 0.0, 0.0)), 128)


def test_a_cell_is_enough_through_a_lens() -> None:
    bent = Camera(640, 52, 800.0, 1600.0, 320.0, 25.5, (-0.02, 0.001, 0.0, 0.0))  # 4.2 px of the grid high
    assert NetworkGrid(bent, 128).valid.any()
    with pytest.raises(BadInput, match="at least 4 px"):
        NetworkGrid(replace(bent, fy=1700.0), 128)


@pytest.mark.parametrize("lens", [Camera(640, 360, 0.65, 1.16, 0.5, 0.5), Camera.from_fov(640, 360, 179.9)])
def test_a_lens_that_would_take_all_memory_is_refused(lens: Camera) -> None:
    """A calibration in shares of the width, and nearly half of all that there is to see."""
    with pytest.raises(BadInput, match=r"at most 16384 px.*in pixels"):
        NetworkGrid(lens, 128)


def test_a_picture_as_wide_as_networks_learn_from_is_not_warned_of() -> None:
    """And one that is a pixel narrower is."""
    assert NetworkGrid(Camera.from_fov(256, 256, 90), 128).warning is None
    assert NetworkGrid(Camera(255, 256, 128.0, 128.0, 127.0, 127.5), 128).warning is not None


@pytest.mark.parametrize(
    ("focal_px", "stays"), [(128 * 1.009, True), (128 / 1.009, True), (128 * 1.012, False)]
)
def test_a_source_of_whole_blocks_stays_where_its_focal_length_is_a_percent_off(
    focal_px: float, stays: bool
) -> None:
    camera = Camera.from_fov(256, 256, 90)
    assert (NetworkGrid(camera, focal_px).camera == camera) == stays


def test_a_map_of_another_size_is_refused() -> None:
    grid = NetworkGrid(KARMA, 256)
    with pytest.raises(
        ValueError, match=r"expected a map \(48, 80\), or four times as large, got \(80, 48\)"
    ):
        grid.to_source(np.zeros((80, 48), np.float32))


def test_a_lens_s_picture_is_halved_before_two_of_its_pixels_fall_on_one() -> None:
    """A checkerboard of single pixels at 1.6 of them: halved it is grey, sampled as it is it would be a moire."""
    camera = Camera(256, 256, 102.4, 102.4, 127.5, 127.5, (-0.05, 0.0, 0.0, 0.0))
    rows, columns = np.indices((256, 256))
    board = np.repeat((((rows + columns) % 2) * 255).astype(np.uint8)[..., None], 3, axis=2)
    assert np.abs(NetworkGrid(camera, 64).image(board) - 127.5).max() <= 2


TALL = Camera(360, 640, 450.0, 450.0, 178.0, 340.0, BARREL.distortion)


@pytest.mark.parametrize(
    "camera", [BARREL, TALL, replace(FISHEYE, fx=450.0, fy=450.0)], ids=["barrel", "tall", "fisheye"]
)
def test_the_outermost_pixels_of_a_lens_have_depth_on_a_grid_that_it_fills(camera: Camera) -> None:
    grid = NetworkGrid(camera, filling_focal_px(camera, 150.0))
    assert np.isfinite(grid.to_source(np.ones(grid.valid.shape, np.float32))).all()


def test_a_lens_whose_coefficients_cannot_be_inverted_is_refused() -> None:
    with pytest.raises(BadInput, match="camera distortion: expected coefficients that can be inverted"):
        NetworkGrid(Camera(640, 360, 450.0, 450.0, 320.0, 180.0, (1e6, 0.0, 0.0, 0.0)), 128)


def test_the_outermost_pixels_reach_half_a_pixel_further() -> None:
    camera = Camera(6, 4, 5.0, 5.0, 2.5, 1.5)
    points = [[-0.4, 1], [-0.6, 1], [5.4, 1], [5.6, 1], [1, -0.4], [1, -0.6], [1, 3.4], [1, 3.6]]
    assert inside(np.array(points), camera).tolist() == [True, False] * 4


def test_a_ray_falls_where_an_ideal_lens_s_matrix_says() -> None:
    camera = Camera(400, 300, 300.0, 240.0, 190.0, 160.0)
    np.testing.assert_allclose(distort(np.array([[0.1, -0.2]]), camera), [[220.0, 112.0]])


def test_a_fifth_coefficient_bends_with_the_sixth_power() -> None:
    camera = Camera(400, 300, 300.0, 240.0, 190.0, 160.0, (0.0, 0.0, 0.0, 0.0, 0.64))
    np.testing.assert_allclose(distort(np.array([[0.5, 0.0]]), camera), [[190 + 300 * 0.5 * 1.01, 160.0]])


@pytest.mark.parametrize("camera", CAMERAS, ids=NAMES)
def test_rays_of_every_third_pixel_fall_on_it(camera: Camera) -> None:
    rays = pixel_rays(camera, 3)
    rows, columns = np.indices((camera.height, camera.width))[:, ::3, ::3]
    assert (rays[..., 2] == 1).all()
    np.testing.assert_allclose(distort(rays[..., :2], camera), np.stack([columns, rows], -1), atol=0.01)
