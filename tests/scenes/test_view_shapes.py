"""Pictures wider or taller than square are filled as square ones are."""

import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.scenes import StillBoxConfig, draw_scene

CONFIG = StillBoxConfig()
SHAPES = [(96, 32), (32, 96), (64, 48)]


def shares_in_view(width: int, height: int) -> tuple[float, float]:
    """Of the objects' centres: how many lie between left and right edge, and between top and bottom edge."""
    camera = Camera.from_fov(width, height, 90)
    inside = []
    for number in range(60):
        x, y, z = draw_scene(CONFIG, 0, 8, number, height / width).world_from_object[:, :, 3].T
        column, row = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
        inside += [
            *zip(np.abs(column - camera.cx) < width / 2, np.abs(row - camera.cy) < height / 2, strict=True)
        ]
    return tuple(np.mean(inside, axis=0))


@pytest.mark.parametrize(("width", "height"), SHAPES)
def test_objects_reach_as_far_beyond_each_edge_as_in_a_square(width, height):
    # Uniform over 1.15 times the view each way.
    assert shares_in_view(width, height) == pytest.approx((1 / 1.15, 1 / 1.15), abs=0.04)


def test_a_square_is_the_default():
    square, default = draw_scene(CONFIG, 8, 1, 2, 1.0), draw_scene(CONFIG, 8, 1, 2)
    np.testing.assert_array_equal(square.world_from_object, default.world_from_object)


@pytest.mark.parametrize(("width", "height"), SHAPES)
def test_the_flight_and_the_room_do_not_depend_on_the_view(width, height):
    square, other = draw_scene(CONFIG, 8, 1, 2), draw_scene(CONFIG, 8, 1, 2, height / width)
    np.testing.assert_array_equal(other.camera_position, square.camera_position)
    np.testing.assert_array_equal(other.room_half, square.room_half)
