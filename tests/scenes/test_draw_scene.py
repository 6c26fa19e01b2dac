import dataclasses
import hashlib

import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.renderers.raycast import render
from flightdepth.scenes import Scene, StillBoxConfig, Textures, chance, draw_scene
from flightdepth.scenes.draw import _camera_path

CONFIG = StillBoxConfig()


def digest(scene: Scene) -> str:
    """SHA-256 of every array of a scene."""
    parts = [getattr(scene, field.name) for field in dataclasses.fields(scene) if field.name != "materials"]
    parts += [getattr(scene.materials, field.name) for field in dataclasses.fields(scene.materials)]
    return hashlib.sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in parts)).hexdigest()


def test_parameters_are_bit_equal_everywhere():
    scene = draw_scene(CONFIG, 96, 0, 0)
    assert scene.shape.tolist()[:12] == [2, 0, 0, 2, 3, 0, 3, 1, 2, 3, 1, 0]
    assert len(scene.shape) == 23
    golden = {
        "camera": (
            scene.camera_position[9],
            "0x1.7eb3c889e91acp-2 0x1.9bd128d9e63d9p-1 0x1.39210e69fc9b2p-3",
        ),
        "room": (scene.room_half, "0x1.1b03b545e7fbcp+6 0x1.032bb3b45f782p+6 0x1.8230d84718b38p+4"),
        "object": (
            scene.world_from_object[0, :, 3],
            "-0x1.e60bc81bb85c3p+0 0x1.9f479fda5f34fp+0 0x1.0671ca0000000p+2",
        ),
        "light": (scene.lamp_power[0], "0x1.08f8c8a22eccdp+8 0x1.11e0fcf842e6ep+8 0x1.1553ffcb508a4p+8"),
        "lamp": (scene.lamp_position[-1], "-0x1.91d0402859232p+4 0x1.c1755daef03f5p+4 0x1.085f20f3cdd50p+1"),
    }
    for name, (values, hexadecimal) in golden.items():
        assert " ".join(float(value).hex() for value in values) == hexadecimal, name


def test_a_scene_can_be_drawn_alone():
    alone = digest(draw_scene(CONFIG, 96, 4, 7))
    for number in range(9):
        assert (digest(draw_scene(CONFIG, 96, 4, number)) == alone) == (number == 7)


def test_another_seed_is_another_scene():
    assert digest(draw_scene(CONFIG, 96, 1, 0)) != digest(draw_scene(CONFIG, 96, 2, 0))


def test_the_path_keeps_clear_of_every_object_and_wall():
    for number in range(120):
        scene = draw_scene(CONFIG, 0, 2, number)
        centres = scene.world_from_object[:, :, 3]
        gaps = np.linalg.norm(scene.camera_position[:, None] - centres, axis=2) - scene.bound_radii_m()
        assert gaps.min(initial=np.inf) > CONFIG.clearance_m
        in_room = (scene.camera_position - scene.world_from_room[:, 3]) @ scene.world_from_room[:, :3]
        assert (scene.room_half - np.abs(in_room)).min() > CONFIG.clearance_m


def test_lamps_are_inside_the_room():
    for number in range(60):
        scene = draw_scene(CONFIG, 0, 2, number)
        in_room = (scene.lamp_position - scene.world_from_room[:, 3]) @ scene.world_from_room[:, :3]
        assert (np.abs(in_room) < scene.room_half).all()


def test_the_camera_flies_straight_at_a_constant_step():
    steps = np.diff(draw_scene(CONFIG, 0, 2, 5).camera_position, axis=0)
    np.testing.assert_allclose(steps, np.broadcast_to(steps[0], (9, 3)), atol=1e-15)
    assert np.linalg.norm(steps[0]) == pytest.approx(0.1)


def test_directions_are_uniform_on_the_sphere():
    ends = [_camera_path(chance.stream(1, n), CONFIG)[-1] / CONFIG.path_length_m for n in range(3000)]
    directions = np.array(ends)
    # Deviations of the means: sqrt(1/3 / n) for x, sqrt(4/45 / n) for x^2, sqrt(1/15 / n) for x y.
    assert np.abs(directions.mean(axis=0)).max() < 4.5 * np.sqrt(1 / 3 / 3000)
    second = directions.T @ directions / 3000 - np.eye(3) / 3
    assert np.abs(np.diag(second)).max() < 4.5 * np.sqrt(4 / 45 / 3000)
    assert np.abs(second - np.diag(np.diag(second))).max() < 4.5 * np.sqrt(1 / 15 / 3000)


def test_rotations_are_rotations():
    for number in range(50):
        turn = chance.rotation(chance.stream(number))
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(turn) == pytest.approx(1)


def test_half_of_the_surfaces_are_textured():
    drawn = np.concatenate([draw_scene(CONFIG, 96, 3, n).materials.texture for n in range(60)])
    assert (drawn >= 0).mean() == pytest.approx(0.5, abs=0.05)
    assert set(drawn) == set(range(-1, 96))


def test_without_textures_everything_is_plain():
    assert (draw_scene(CONFIG, 0, 3, 1).materials.texture == -1).all()


def test_only_plain_objects_shine():
    materials = draw_scene(CONFIG, 96, 3, 1).materials
    assert (materials.specular[materials.texture >= 0] == 0).all()
    assert (materials.specular[:6] == 0).all()
    assert (materials.specular > 0.2).any()


def test_depth_percentiles_lie_inside_the_span_of_the_original_s_scenes():
    blank, camera = Textures.from_images([]), Camera.from_fov(32, 32, 90)
    depth_m = [render(draw_scene(CONFIG, 0, 6, n), blank, camera, frames=[4]).depth_m for n in range(200)]
    found = np.percentile(depth_m, [5, 25, 50, 75, 95])
    lowest, highest = [2.7, 4.3, 9.4, 20, 41], [5.5, 9.4, 47, 67, 81]
    assert (lowest < found).all()
    assert (found < highest).all()


def test_a_material_that_is_not_there_is_refused():
    with pytest.raises(ValueError, match="materials: expected numbers 0"):
        dataclasses.replace(draw_scene(CONFIG, 0, 1, 1), room_material=np.full(6, 99))


def test_arrays_of_another_length_are_refused():
    with pytest.raises(ValueError, match="torus_radius: expected shape"):
        dataclasses.replace(draw_scene(CONFIG, 0, 1, 1), torus_radius=np.zeros(99))
