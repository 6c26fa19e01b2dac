import math

import numpy as np
import pytest
from pydantic import ValidationError

from flightdepth.scenes import StillBoxConfig, draw_scene


def test_defaults_are_the_original_s_flight():
    config = StillBoxConfig()
    assert (config.frames, config.step_m, config.horizontal_fov_deg) == (10, 0.1, 90)
    assert config.focal_px(256) == pytest.approx(128)


def test_focal_length_of_a_narrow_lens():
    assert StillBoxConfig(horizontal_fov_deg=60).focal_px(100) == pytest.approx(50 / math.tan(math.pi / 6))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"meshes": (9, 3)}, "meshes"),
        ({"distance_m": (-1, 3)}, "distance_m"),
        ({"distance_m": (0, 3)}, "distance_m: expected more than 0"),
        ({"angular_size": (0, 0)}, "angular_size: expected more than 0"),  # numpy: singular matrix
        ({"room_half_m": (1, 30)}, "room_half_m: expected at least half the path"),
        ({"frames": 0}, "frames"),
        ({"lamps": (0, 32)}, "lamps: expected at most 31, got 32"),  # refused by the renderer, in the middle
        ({"meshes": (0, 32_767)}, "meshes: expected at most 32766, got 32767"),
        ({"texture_ratio": 1.1}, "texture_ratio"),
        ({"horizontal_fov_deg": 180}, "horizontal_fov_deg"),
        ({"colour": "red"}, "colour"),
        ({"distance_m": (1.0, math.inf)}, "finite number"),
    ],
)
def test_what_cannot_be_is_refused(change, said):
    with pytest.raises(ValidationError, match=said):
        StillBoxConfig(**change)


def test_counts_of_frames_objects_and_lamps_are_kept():
    config = StillBoxConfig(
        frames=3, meshes=(4, 4), lamps=(2, 2), distance_m=(10, 20), angular_size=(0.1, 0.2)
    )
    scene = draw_scene(config, 0, 0, 0)
    assert (scene.frames, len(scene.shape), len(scene.lamp_position)) == (3, 4, 2)


def test_an_empty_scene_can_be_drawn():
    scene = draw_scene(StillBoxConfig(meshes=(0, 0), lamps=(0, 0)), 0, 0, 0)
    assert scene.world_from_object.shape == (0, 3, 4)
    assert not np.isnan(scene.room_half).any()


def test_the_most_lamps_and_objects_are_taken():
    config = StillBoxConfig(lamps=(1, 31), meshes=(0, 32_766))
    assert (config.lamps[1], config.meshes[1]) == (31, 32_766)
