"""The sweep against pictures that a numpy formula draws: a plane at one depth, seen before and after a move."""

import cv2
import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.sweep import LEVELS, Level, motion_field, sweep, unit_direction, warp_matrix

CAMERA = Camera(128, 64, 100.0, 100.0, 60.0, 35.0)
MOVES = [(0.3, 0.0, 0.0), (0.0, -0.2, 0.0), (0.1, 0.2, 0.4), (-0.1, 0.05, -0.5), (0.0, 0.0, 0.3)]


def plane_picture(camera: Camera, eye: np.ndarray, depth_m: float) -> np.ndarray:
    """A pattern of smooth waves on the plane z = depth_m of the present camera, seen from `eye`."""
    rays = camera.rays()
    points = eye + rays * (depth_m - eye[2])
    x, y = points[..., 0] / depth_m, points[..., 1] / depth_m
    grey = 128 + 60 * np.sin(18 * x + 3 * y) + 50 * np.cos(15 * y - 4 * x)
    return np.repeat(np.rint(grey).astype(np.uint8)[..., None], 3, axis=2)


@pytest.mark.parametrize("move", MOVES)
@pytest.mark.parametrize("level", range(3))
def test_the_right_hypothesis_looks_like_the_present_picture(move, level):
    move = np.array(move)
    shift_px = LEVELS[level].shifts_px[-2]
    depth_m = CAMERA.fx * float(np.linalg.norm(move)) / shift_px
    current, previous = (plane_picture(CAMERA, eye, depth_m) for eye in (np.zeros(3), -move))
    found = sweep(previous, current, move, CAMERA)
    scale = LEVELS[level].scale
    present = cv2.resize(current[..., 0], None, fx=1 / scale, fy=1 / scale, interpolation=cv2.INTER_AREA)
    errors = [np.abs(each.astype(float) - present).mean() for each in found.swept[level]]
    assert int(np.argmin(errors)) == len(errors) - 2
    assert errors[-2] < 0.6 * sorted(errors)[1]


@pytest.mark.parametrize("move", MOVES)
def test_a_pixel_is_looked_up_where_the_point_was_seen(move):
    depth_m, pixel = 7.0, np.array([20.0, 50.0])
    ray = np.array([(pixel[0] - CAMERA.cx) / CAMERA.fx, (pixel[1] - CAMERA.cy) / CAMERA.fy, 1.0])
    before = ray * depth_m + np.array(move)
    expected = before[:2] / before[2] * 100.0 + np.array([CAMERA.cx, CAMERA.cy])
    shift_px = CAMERA.fx * float(np.linalg.norm(move)) / depth_m
    matrix = warp_matrix(shift_px, unit_direction(move), CAMERA)
    assert matrix @ np.append(pixel, 1) == pytest.approx(expected)


def test_only_the_direction_counts():
    rng = np.random.default_rng(0)
    previous, current = rng.integers(0, 256, (2, 64, 128, 3), dtype=np.uint8)
    near, far = (sweep(previous, current, np.array([1, 2, 3]) * s, CAMERA) for s in (0.01, 40.0))
    assert all(np.array_equal(a, b) for a, b in zip(near.swept, far.swept, strict=True))


def test_nothing_moves_without_a_displacement():
    rng = np.random.default_rng(1)
    previous, current = rng.integers(0, 256, (2, 64, 128, 3), dtype=np.uint8)
    found = sweep(previous, current, np.zeros(3), CAMERA)
    grey = cv2.cvtColor(previous, cv2.COLOR_RGB2GRAY)
    assert all(np.array_equal(each, grey) for each in found.swept[0])
    assert not found.field.any()


def test_outside_the_earlier_picture_the_present_one_stands():
    previous, current = np.full((2, 64, 128, 3), [[[[10]]], [[[200]]]], dtype=np.uint8)
    found = sweep(previous, current, [1.0, 0.0, 0.0], CAMERA)
    last = LEVELS[2].shifts_px[-1] / 4
    columns = found.swept[2][-1].mean(axis=0)
    inside = 32 - 1 - last
    assert (columns[: int(inside) + 1] == 10).all()
    assert (columns[int(inside) + 2 :] == 200).all()


def test_levels_between_whole_ones_are_rounded_once():
    """Of a slope, whose warped pictures are known: off by a rounding, not by one of each step."""
    slope = (40 + np.arange(128) / 3 + np.arange(64)[:, None] / 7).astype(np.float32)
    picture = np.repeat(slope[..., None], 3, axis=2)
    found = sweep(picture, picture, [1.0, 0.0, 0.0], CAMERA)
    assert found.current.dtype == np.uint8
    for shift_px, swept in zip(LEVELS[0].shifts_px, found.swept[0], strict=True):
        exact = (slope + shift_px / 3)[:, : 128 - int(np.ceil(shift_px))]
        np.testing.assert_allclose(swept[:, : exact.shape[1]], exact, atol=0.52)


def test_bytes_and_levels_of_the_same_values_agree():
    rng = np.random.default_rng(2)
    previous, current = rng.integers(0, 256, (2, 64, 128, 3), dtype=np.uint8)
    of_bytes = sweep(previous, current, [0.6, -0.2, 0.3], CAMERA)
    mixed = sweep(previous, current.astype(np.float32), [0.6, -0.2, 0.3], CAMERA)
    np.testing.assert_array_equal(mixed.current, of_bytes.current)
    for one, other in zip(mixed.swept, of_bytes.swept, strict=True):
        assert np.abs(one.astype(int) - other).max() <= 2


def test_the_field_is_zero_where_the_camera_goes():
    direction = unit_direction([0.2, -0.1, 1.0])
    small = CAMERA.resized(32, 16)
    column, row = 0.2 * small.fx + small.cx, -0.1 * small.fy + small.cy
    field = motion_field(direction, CAMERA)
    assert np.hypot(*field).argmin() == round(row) * 32 + round(column)
    assert field.shape == (2, 16, 32)


def test_the_field_is_the_direction_of_sideways_motion():
    assert motion_field([1.0, 0.0, 0.0], CAMERA)[0] == pytest.approx(1.0)


def test_levels_are_whole_parts_of_a_network_grid():
    for level in LEVELS:
        assert isinstance(level, Level)
        assert 64 % level.scale == 0
        assert list(level.shifts_px) == sorted(level.shifts_px)
