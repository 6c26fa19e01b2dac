import numpy as np
import pytest

from flightdepth.flight.rotation import Flow, likeliest_rotation, rotation_flow

FOCAL_PX = 127.0
NOISE = 0.1 / FOCAL_PX


def scene(seed, translation, rotation, *, near=5.0, far=200.0, noise=NOISE, count=80):
    """Flow of `count` points of a 64 by 39 degree view at depths `near` to `far`."""
    rng = np.random.default_rng(seed)
    points = rng.uniform([-0.63, -0.35], [0.63, 0.35], (count, 2))
    inverse_depth = rng.uniform(1 / far, 1 / near, count)[:, None]
    tx, ty, tz = translation
    flying = np.stack([points[:, 0] * tz - tx, points[:, 1] * tz - ty], axis=1) * inverse_depth
    along_x, along_y = rotation_flow(points)
    turning = np.stack([along_x @ rotation, along_y @ rotation], axis=1)
    return Flow(points, flying + turning + rng.normal(0, noise, (count, 2)))


def test_rotation_flow_is_that_of_turned_rays():
    points, small = np.array([[0.3, -0.2], [0.0, 0.0], [-0.5, 0.4]]), 1e-6
    for axis in range(3):
        turned = np.eye(3)
        w = np.zeros(3)
        w[axis] = small
        turned -= np.array(
            [[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]]
        )  # points move against the camera
        rays = np.c_[points, np.ones(3)] @ turned.T
        moved = (rays[:, :2] / rays[:, 2:] - points) / small
        along_x, along_y = rotation_flow(points)
        assert np.allclose(moved, np.stack([along_x[:, axis], along_y[:, axis]], axis=1), atol=1e-5)


@pytest.mark.parametrize("rotation", [(0, 0.03, 0), (0.02, 0, 0), (0, 0, 0.05), (0.01, -0.02, 0.01)])
def test_a_pure_turn_is_found(rotation):
    found = likeliest_rotation(scene(0, (0, 0, 0), rotation), NOISE)
    assert np.allclose(found, rotation, atol=0.004)


@pytest.mark.parametrize("translation", [(0, 0, 0.8), (0.5, 0, 0), (0, 0.4, 0), (-0.4, 0.1, 0.3)])
def test_flying_steadily_is_no_turn(translation):
    turns = [np.linalg.norm(likeliest_rotation(scene(k, translation, (0, 0, 0)), NOISE)) for k in range(10)]
    assert max(turns) < 0.004


@pytest.mark.parametrize("translation", [(0, 0, 0.8), (0.5, 0, 0), (-0.4, 0.1, 0.3)])
def test_a_turn_is_found_while_flying(translation):
    rotation = np.array([0.0, 0.03, 0.0])
    turns = [np.linalg.norm(likeliest_rotation(scene(k, translation, rotation), NOISE)) for k in range(10)]
    assert 0.02 < np.median(turns) < 0.035


def test_standing_still_is_no_turn():
    assert np.linalg.norm(likeliest_rotation(scene(0, (0, 0, 0), (0, 0, 0), noise=0), NOISE)) < 1e-9


def test_a_view_too_narrow_to_tell_turning_from_flying_makes_a_turn_smaller_and_never_larger():
    """Of 3.4 degrees; all moves by three noises. A large turn is rarer than a small one."""
    for seed in range(5):
        rng = np.random.default_rng(seed)
        motions = rng.normal((0.01, 0.0), NOISE, (80, 2))
        found = likeliest_rotation(Flow(rng.uniform(-0.03, 0.03, (80, 2)), motions), 0.003)
        assert np.linalg.norm(found) < 0.01


def test_outliers_do_not_turn_the_camera():
    flow = scene(0, (0, 0, 0.5), (0, 0, 0))
    motions = flow.motions.copy()
    motions[:16] += [0.05, 0.02]  # a fifth of the points follow something that moves
    assert np.linalg.norm(likeliest_rotation(Flow(flow.points, motions), NOISE)) < 0.004


def test_a_mirrored_flow_turns_the_other_way():
    flow = scene(3, (0, 0, 0.3), (0, 0.03, 0))
    mirror = np.array([-1.0, 1.0])
    mirrored = likeliest_rotation(Flow(flow.points * mirror, flow.motions * mirror), NOISE)
    assert np.allclose(mirrored * [1, -1, -1], likeliest_rotation(flow, NOISE), atol=0.003)


@pytest.mark.parametrize("translation", [(0.5, 0, 0), (0.35, 0, 0.35), (0, 0, 0.5)])
@pytest.mark.parametrize("yaw", [-0.02, 0.02, -0.06])
def test_a_turn_beside_a_near_foreground_is_told_apart_from_flying(translation, yaw):
    """It was told for sideways flight, and the other way round: off by a fifth in half of such pairs."""
    turns = [likeliest_rotation(scene(k, translation, (0, yaw, 0), near=1.5), NOISE)[1] for k in range(20)]
    assert np.mean(np.abs(np.array(turns) - yaw) < 0.2 * abs(yaw)) > 0.85


@pytest.mark.parametrize("translation", [(0.5, 0, 0), (0.35, 0, 0.35), (0, 0, 0.5)])
def test_flying_past_a_near_foreground_is_no_turn(translation):
    flows = [scene(k, translation, (0, 0, 0), near=1.5) for k in range(20)]
    assert max(np.linalg.norm(likeliest_rotation(flow, NOISE)) for flow in flows) < 0.0075
