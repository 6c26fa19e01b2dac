"""Depth at a picture's own pixels: laws, and rendered scenes with their true depth at every pixel."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from flightdepth.camera import Camera
from flightdepth.runtimes.edges import AlongEdges, Blocks
from flightdepth.runtimes.grid import NetworkGrid

PINHOLE = Camera.from_fov(854, 480, 64.4)
BARREL = Camera(640, 360, 450.0, 450.0, 322.0, 178.0, (-0.28, 0.09, 0.001, -0.0005, 0.0))
FISHEYE = Camera(640, 360, 250.0, 250.0, 320.0, 180.0, (0.02, -0.01, 0.0, 0.0), "fisheye")
CAMERAS = [PINHOLE, BARREL, FISHEYE]
NAMES = ["pinhole", "barrel", "fisheye"]

NEAR_M, FAR_M = 4.0, 40.0
GREEN, BLUE = (60, 120, 40), (150, 180, 220)


def all_valid(depth_m):
    return Blocks(np.ones(depth_m.shape, bool))


def two_sides(near):
    """Depth [h, w], a block's mean as a network says it, and the picture of what is near (bool [4 h, 4 w])."""
    depth_m = np.where(near, NEAR_M, FAR_M).astype(np.float32)
    picture = np.where(near[..., None], GREEN, BLUE).astype(np.uint8)
    return cv2.resize(depth_m, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA), picture


def clean_sides(near):
    """The same, each block all near or all far."""
    depth_m, picture = two_sides(near)
    return np.where(depth_m < (NEAR_M + FAR_M) / 2, NEAR_M, FAR_M).astype(np.float32), picture


def disc(height=64, width=96, radius=14.3):
    rows, columns = np.indices((height, width))
    return np.hypot(rows - 30.2, columns - 51.7) < radius


def test_each_pixel_of_an_edge_has_the_depth_of_what_it_looks_like():
    near = disc()
    depth_m, picture = two_sides(near)
    found = 1 / AlongEdges(depth_m, picture, all_valid(depth_m)).inverse_depth
    truth = np.where(near, NEAR_M, FAR_M)
    plain = 1 / cv2.resize(1 / depth_m, picture.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    off, plain_off = (np.abs(each / truth - 1) for each in (found, plain))
    assert off.max() < 0.5  # a block that is half of each counts as a little of the other
    assert (off > 0.1).mean() < 0.02
    assert (plain_off > 0.1).mean() > 0.09


def test_a_pole_of_three_pixels_stays_as_thin():
    near = np.zeros((64, 96), bool)
    near[:, 41:44] = True
    depth_m, picture = two_sides(near)
    depth_m[:, 10] = NEAR_M  # a network says of such a block what is nearest
    found = 1 / AlongEdges(depth_m, picture, all_valid(depth_m)).inverse_depth
    assert (found[:, 41:44] < 1.1 * NEAR_M).all()
    assert (found[:, 36:40] > FAR_M / 1.1).all()
    assert (found[:, 45:52] > FAR_M / 1.1).all()


def test_where_all_looks_alike_an_edge_lies_between_the_blocks():
    depth_m = np.full((16, 24), FAR_M, np.float32)
    depth_m[:, :10] = NEAR_M
    picture = np.full((64, 96, 3), 90, np.uint8)
    found = 1 / AlongEdges(depth_m, picture, all_valid(depth_m)).inverse_depth
    assert np.allclose(found[:, :40], NEAR_M)
    assert np.allclose(found[:, 40:], FAR_M)


def test_what_is_unknown_has_an_edge_too():
    near = disc()
    depth_m, picture = two_sides(near)
    depth_m[depth_m > 2 * NEAR_M] = np.nan
    found = AlongEdges(depth_m, picture, all_valid(depth_m)).inverse_depth
    assert (found[~near] == 0).all()
    assert np.allclose(found[near & (cv2.erode(near.astype(np.uint8), np.ones((5, 5))) > 0)], 1 / NEAR_M)
    assert (found[near] > 0).mean() > 0.97


def test_a_plane_is_linear_in_inverse_depth():
    h, w = 48, 64
    rows, columns = np.indices((4 * h, 4 * w))
    truth = 0.02 + 0.0004 * rows + 0.0001 * columns  # 1/m: the ground from 50 to 9 m
    inverse = cv2.resize(truth, (w, h), interpolation=cv2.INTER_AREA)
    picture = np.random.default_rng(0).integers(0, 256, (4 * h, 4 * w, 3), dtype=np.uint8)
    found = AlongEdges((1 / inverse).astype(np.float32), picture, all_valid(inverse)).inverse_depth
    assert np.abs(found / truth - 1)[4:-4, 4:-4].max() < 1e-4


depths = arrays.arrays(
    np.float32, (8, 12), elements=st.one_of(st.floats(0.5, 200, width=32), st.just(float("nan")))
)
pictures = arrays.arrays(np.uint8, (32, 48, 3), elements=st.integers(0, 255))


@given(depths, pictures, st.integers(0, 2), st.integers(0, 2))
@settings(max_examples=80, deadline=None)
def test_no_depth_lies_beyond_those_around_it_and_padding_has_no_say(depth_m, picture, above, left):
    valid = np.zeros((8, 12), bool)
    valid[above:7, left:] = True
    edges = AlongEdges(depth_m, picture, Blocks(valid))
    known = valid & np.isfinite(depth_m)
    nothing = np.float32(np.inf)
    nearest = cv2.erode(np.where(known, depth_m, nothing), np.ones((3, 3)))
    farthest = cv2.dilate(np.where(known, depth_m, -nothing), np.ones((3, 3)))
    bounds = [np.kron(each, np.ones((4, 4))) for each in (nearest, farthest)]
    shown = np.kron(valid, np.ones((4, 4), bool)) & (edges.inverse_depth > 0)
    found = 1 / edges.inverse_depth[shown]
    assert (found >= bounds[0][shown] * 0.999).all()
    assert (found <= bounds[1][shown] * 1.001).all()
    elsewhere = AlongEdges(np.where(valid, depth_m, np.float32(3.0)), picture, Blocks(valid)).inverse_depth
    seen = np.kron(valid, np.ones((4, 4), bool))
    assert np.array_equal(elsewhere[seen], edges.inverse_depth[seen])


@given(depths, pictures, arrays.arrays(bool, (8, 12)))
@settings(max_examples=80, deadline=None)
def test_padding_holds_no_depth_that_nothing_shown_has(depth_m, picture, valid):
    """Found in review: through a lens the source's outermost pixels lie on it, and were up to 64 times as far off."""
    inverse = AlongEdges(depth_m, picture, Blocks(valid)).inverse_depth
    shown = depth_m[valid & np.isfinite(depth_m)]
    found = 1 / inverse[inverse > 0]
    assert not len(found) or found.max() <= shown.max() * 1.001
    assert not len(found) or found.min() >= shown.min() * 0.999


@pytest.mark.parametrize("camera", CAMERAS, ids=NAMES)
def test_where_the_horizon_leaves_the_picture_no_depth_is_beyond_the_ground(camera):
    """Found in review: 26 pixels a frame of a lens with distortion, at its sides, lay up to 64 times too far."""
    grid = NetworkGrid(camera, 150)
    picture = np.random.default_rng(0).integers(0, 256, (grid.camera.height, grid.camera.width, 3), np.uint8)
    ground = np.full(grid.valid.shape, 20.0, np.float32)
    ground[: len(ground) // 2] = np.nan
    found = grid.along_edges(ground, picture).depth_m
    assert np.allclose(found[np.isfinite(found)], 20.0)


def test_other_maps_take_the_same_side():
    near = disc()
    depth_m, picture = clean_sides(near)
    mark = np.where(depth_m < 2 * NEAR_M, np.float32(1), np.float32(np.nan))
    sigma_m = np.where(depth_m < 2 * NEAR_M, np.float32(0.1), np.float32(7))
    edges = AlongEdges(depth_m, picture, all_valid(depth_m))
    found = edges.inverse_depth > 2 / FAR_M
    assert np.array_equal(np.isfinite(edges.marks(mark)), found)
    assert np.allclose(edges.finer(sigma_m), np.where(found, 0.1, 7), atol=1e-5)


@pytest.mark.parametrize("camera", CAMERAS, ids=NAMES)
def test_nothing_hangs_in_the_air_at_the_sources_pixels(camera):
    grid = NetworkGrid(camera, 256)
    height, width = grid.camera.height, grid.camera.width
    rows, columns = np.indices((height, width))
    near = np.hypot(rows - height / 2, columns - width / 2) < height / 4
    depth_m, picture = clean_sides(near)
    found = grid.along_edges(depth_m, picture)
    known = np.isfinite(found.depth_m)
    assert np.array_equal(known, np.isfinite(grid.to_source(depth_m)))  # what a lens sees beyond the grid
    depths = found.depth_m[known]
    assert ((depths < 1.02 * NEAR_M) | (depths > FAR_M / 1.02)).all()
    assert 0.03 < (depths < 2 * NEAR_M).mean() < 0.5
    sigma_m = found(np.full_like(depth_m, 0.5))
    assert np.array_equal(np.isfinite(sigma_m), known)
    assert np.allclose(sigma_m[known], 0.5)


@pytest.mark.parametrize("camera", CAMERAS, ids=NAMES)
def test_a_constant_depth_stays_constant(camera):
    grid = NetworkGrid(camera, 128)
    picture = np.random.default_rng(1).integers(0, 256, (grid.camera.height, grid.camera.width, 3), np.uint8)
    found = grid.along_edges(np.full(grid.valid.shape, 7.0, np.float32), picture).depth_m
    assert found.dtype == np.float32
    assert found.shape == (camera.height, camera.width)
    assert np.allclose(found[np.isfinite(found)], 7.0)


def test_of_no_depth_at_all_there_is_none_anywhere():
    grid = NetworkGrid(PINHOLE, 128)
    picture = np.zeros((grid.camera.height, grid.camera.width, 3), np.uint8)
    nothing = np.full(grid.valid.shape, np.nan, np.float32)
    found = grid.along_edges(nothing, picture)
    assert np.isnan(found.depth_m).all()
    assert np.isnan(found(nothing)).all()
    assert (found.marks(np.full_like(nothing, 5.0)) == 5.0).all()
