"""A camera's path in the original's metadata."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightdepth.motion import rotation_from_euler
from flightdepth.scenes import StillBoxConfig, draw_scene
from flightdepth.stillbox.camera_path import described_path, path_from


def flown(position, orientation=None):
    """A scene whose camera goes there."""
    scene = draw_scene(StillBoxConfig(frames=len(position)), 0, 1, 0)
    still = np.repeat(np.eye(3)[None], len(position), axis=0)
    return replace(
        scene,
        camera_position=np.array(position, float),
        world_from_camera=still if orientation is None else np.array(orientation, float),
    )


def there_and_back(scene, time_step_s=0.1):
    facts = json.loads(json.dumps(described_path(scene, time_step_s)))
    return path_from(facts | {"imgs": ["a"] * scene.frames})


@given(st.integers(0, 10_000), st.floats(0, 0.5), st.sampled_from([0.05, 0.1, 1.0]))
def test_what_is_between_frames_comes_back(number, noise, time_step_s):
    scene = draw_scene(StillBoxConfig(frames=4, orientation_noise_rad=noise), 0, 1, number)
    position, orientation = there_and_back(scene, time_step_s)
    for previous, current in ((0, 3), (2, 1)):
        moved = (position[current] - position[previous]) @ orientation[current]
        assert moved == pytest.approx(scene.displacement(previous, current), abs=1e-9)
        turned = orientation[previous].T @ orientation[current]
        before = scene.world_from_camera[previous].T @ scene.world_from_camera[current]
        assert turned == pytest.approx(before, abs=1e-9)


def test_speed_is_right_up_forward():
    facts = described_path(flown([[0, 0, 0], [0.1, 0.2, 0.3]]), 0.1)
    assert facts["speed"] == pytest.approx([1, -2, 3])
    assert (facts["length"], facts["time_step"]) == (2, 0.1)


def test_speed_is_in_the_first_cameras_axes():
    east = rotation_from_euler(0, np.pi / 2, 0)  # looks along the world's x
    facts = described_path(flown([[0, 0, 0], [0.1, 0, 0]], [east, east]), 0.1)
    assert facts["speed"] == pytest.approx([0, 0, 1])
    assert facts["orientation"] == []


def test_a_turn_to_the_right_is_one_about_down_and_minus_up():
    right = rotation_from_euler(0, 0.2, 0)  # about y, which is down: z goes to x
    facts = described_path(flown([[0, 0, 0], [0, 0, 0.1]], [np.eye(3), right]), 0.1)
    assert facts["orientation"][0] == pytest.approx([1, 0, 0, 0])
    # In right, up, forward (left-handed) the same turn takes forward to right: the matrix has + at [0, 2] still.
    assert facts["orientation"][1] == pytest.approx([np.cos(0.1), 0, np.sin(0.1), 0])


def test_a_still_camera_has_no_orientation_and_no_positions():
    facts = described_path(flown([[0, 0, 0], [0, 0, 0.1], [0, 0, 0.2]]), 0.1)
    assert facts.keys() == {"length", "speed", "time_step", "orientation"}
    assert facts["orientation"] == []


def test_a_bend_is_kept():
    bent = flown([[0, 0, 0], [0, 0, 0.1], [0.1, 0, 0.1]])
    assert described_path(bent, 0.1)["position"][2] == pytest.approx([0.1, 0, 0.1])
    assert there_and_back(bent)[0] == pytest.approx(bent.camera_position)


def test_one_frame_has_no_speed():
    assert described_path(flown([[0, 0, 0]]), 0.1)["speed"] == [0, 0, 0]


def test_a_bend_of_a_millimetre_is_kept():
    bent = flown([[0, 0, 0], [0, 0, 0.1], [0.001, 0, 0.2]])
    assert there_and_back(bent)[0] == pytest.approx(bent.camera_position, abs=1e-9)


def test_a_turn_of_a_thousandth_is_kept():
    turned = flown([[0, 0, 0], [0, 0, 0.1]], [np.eye(3), rotation_from_euler(0, 0.001, 0)])
    assert there_and_back(turned)[1] == pytest.approx(turned.world_from_camera, abs=1e-9)
