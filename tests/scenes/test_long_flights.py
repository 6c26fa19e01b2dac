"""Flights of any length keep clear of everything they were drawn with, at every point, not at frames only."""

import numpy as np
import pytest
from pydantic import ValidationError

from flightdepth.camera import Camera
from flightdepth.renderers.raycast import render
from flightdepth.scenes import Scene, Shape, StillBoxConfig, Textures, draw_scene
from flightdepth.scenes.draw import _gap_m

LONG = StillBoxConfig(frames=300, speed_m_s=1.0, time_step_s=1 / 30, clearance_m=2.0, objects_ahead_of="path")
COARSE = StillBoxConfig(
    frames=4, speed_m_s=8.0, time_step_s=1.0, clearance_m=0.5, room_half_m=(24.0, 60.0), meshes=(40, 60)
)
BLANK = Textures.from_images([])


def everywhere(scene: Scene) -> np.ndarray:
    """Points every 2 cm of the path, [P, 3]."""
    start, end = scene.camera_position[0], scene.camera_position[-1]
    return start + np.linspace(0, 1, int(np.linalg.norm(end - start) / 0.02) + 2)[:, None] * (end - start)


def nearest_m(scene: Scene, k: int, points: np.ndarray) -> float:
    """A lower bound of the distance from the points to object k, in object space, times its least scale."""
    linear = scene.world_from_object[k, :, :3]
    x, y, z = np.linalg.solve(linear, (points - scene.world_from_object[k, :, 3]).T)
    if scene.shape[k] == Shape.CUBE:
        away = np.linalg.norm(np.maximum(np.abs([x, y, z]) - 1, 0), axis=0)
    elif scene.shape[k] == Shape.SPHERE:
        away = np.sqrt(x * x + y * y + z * z) - 1
    elif scene.shape[k] == Shape.CONE:
        away = np.maximum((2 * np.hypot(x, y) + z - 1) / np.sqrt(5), np.abs(z) - 1)
    else:
        away = np.hypot(np.hypot(x, y) - 1, z) - scene.torus_radius[k]
    return float(away.min() * np.linalg.norm(linear, axis=0).min())


@pytest.mark.parametrize("config", [LONG, COARSE], ids=["300 frames", "8 m steps"])
def test_every_point_of_the_path_is_clear_of_bounds_and_walls(config):
    for number in range(60):
        scene = draw_scene(config, 0, 4, number)
        points = everywhere(scene)
        gaps = np.linalg.norm(points[:, None] - scene.world_from_object[:, :, 3], axis=2)
        assert (gaps - scene.bound_radii_m()).min(initial=np.inf) > 0.99 * config.clearance_m
        in_room = (points - scene.world_from_room[:, 3]) @ scene.world_from_room[:, :3]
        assert (scene.room_half - np.abs(in_room)).min() >= config.clearance_m


def test_the_path_does_not_pass_through_any_surface():
    for number in range(20):
        scene = draw_scene(COARSE, 0, 4, number)
        points = everywhere(scene)
        assert min(nearest_m(scene, k, points) for k in range(len(scene.shape))) > 0


def test_every_frame_of_a_long_flight_sees_no_depth_nearer_than_its_clearance_allows():
    # A surface at distance c lies at least at z = c cos(corner of the view), and cos is 1/sqrt(3) for 90 degrees.
    camera = Camera.from_fov(8, 8, 90)
    depth_m = render(draw_scene(LONG, 0, 4, 1), BLANK, camera).depth_m
    assert depth_m.shape == (300, 8, 8)
    assert depth_m.min() > LONG.clearance_m / 3**0.5
    assert np.isfinite(depth_m).all()


def test_a_long_flight_goes_on_at_its_step():
    steps = np.diff(draw_scene(LONG, 0, 4, 0).camera_position, axis=0)
    np.testing.assert_allclose(np.linalg.norm(steps, axis=1), 1 / 30)


def test_objects_stand_before_the_last_frames_too():
    """Over many scenes the last frame's view holds as many near objects as the first's."""

    def near(scene: Scene, frame: int) -> int:
        x, y, z = (scene.world_from_object[:, :, 3] - scene.camera_position[frame]).T
        return int(((z > 0) & (z < 12) & (np.abs(x) < z) & (np.abs(y) < z)).sum())

    seen = {}
    for ahead in ("path", "start"):
        config = LONG.model_copy(update={"objects_ahead_of": ahead, "speed_m_s": 2.0})
        scenes = [draw_scene(config, 0, 4, number) for number in range(150)]
        seen[ahead] = sum(near(s, -1) for s in scenes) / sum(near(s, 0) for s in scenes)
    assert 0.75 < seen["path"] < 1.33
    assert seen["start"] < seen["path"] - 0.2


# The distance


def test_between_far_positions_the_whole_way_counts():
    path = np.array([[0.0, 0, 0], [0, 0, 8]])
    assert _gap_m(path, np.array([3.0, 0, 4]), fine_m=0.5) == pytest.approx(3)


def test_beyond_the_ends_the_ends_count():
    path = np.array([[0.0, 0, 0], [0, 0, 8]])
    assert _gap_m(path, np.array([3.0, 0, 12]), fine_m=0.5) == pytest.approx(5)
    assert _gap_m(path, np.array([0.0, 4, -3]), fine_m=0.5) == pytest.approx(5)


def test_between_near_positions_the_positions_count():
    path = np.array([[0.0, 0, 0], [0, 0, 8]])
    assert _gap_m(path, np.array([3.0, 0, 4]), fine_m=8.0) == pytest.approx(5)


def test_a_flight_of_one_frame_is_a_point():
    assert _gap_m(np.zeros((1, 3)), np.array([3.0, 0, 4]), fine_m=0.0) == pytest.approx(5)


# The room


def test_a_room_that_just_holds_the_path_is_enough():
    config = StillBoxConfig(frames=41, speed_m_s=10.0, room_half_m=(21.2, 21.2), meshes=(0, 0))
    for number in range(40):
        scene = draw_scene(config, 0, 4, number)
        in_room = (scene.camera_position - scene.world_from_room[:, 3]) @ scene.world_from_room[:, :3]
        assert (scene.room_half - np.abs(in_room)).min() >= config.clearance_m - 1e-9


def test_a_room_that_is_too_small_says_how_to_mend_it():
    with pytest.raises(
        ValidationError, match=r"at least .* 31\.20 m, got 24\.0 m; larger rooms, fewer frames"
    ):
        StillBoxConfig(frames=601)
