"""Scenes in the open: what stands, what is opened, what stays as it was."""

import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.renderers.raycast import render
from flightdepth.scenes import StillBoxConfig, Textures, draw_scene
from flightdepth.scenes.open_air import GROUND_HALF_M

CLOSED, OPEN = StillBoxConfig(), StillBoxConfig(open_share=1.0)


def test_the_objects_are_those_of_the_closed_scene() -> None:
    closed, opened = draw_scene(CLOSED, 8, 3, 1), draw_scene(OPEN, 8, 3, 1)
    np.testing.assert_array_equal(opened.world_from_object[:-1], closed.world_from_object)
    np.testing.assert_array_equal(opened.camera_position, closed.camera_position)
    assert len(opened.shape) == len(closed.shape) + 1


def test_the_share_opens_as_many_scenes() -> None:
    half = StillBoxConfig(open_share=0.5)
    opened = [bool(np.isinf(draw_scene(half, 8, 3, number).room_half).all()) for number in range(200)]
    assert 0.4 < np.mean(opened) < 0.6


@pytest.mark.parametrize("knobs", [{}, {"frames": 100}, {"speed_m_s": 5.0, "time_step_s": 0.2}])
def test_the_path_stays_above_the_ground(knobs) -> None:
    """However far it sinks."""
    config = StillBoxConfig(open_share=1.0, **knobs)
    for number in range(50):
        scene = draw_scene(config, 8, 3, number)
        ground = scene.world_from_object[-1]
        local = np.linalg.solve(ground[:, :3], (scene.camera_position - ground[:, 3]).T)
        above_m = (-1 - local[1]) * GROUND_HALF_M  # y points down: the top face is y = -1
        assert above_m.min() > config.clearance_m - 1e-6


def test_rays_that_miss_everything_see_the_sky_infinitely_far() -> None:
    textures, camera = Textures.procedural(4, 0), Camera.from_fov(32, 32, 90)
    depth = np.concatenate(
        [render(draw_scene(OPEN, 4, 3, n), textures, camera, frames=[0]).depth_m for n in range(6)]
    )
    assert np.isinf(depth).any()
    assert np.isfinite(depth).any()
    assert (depth > 0).all()
