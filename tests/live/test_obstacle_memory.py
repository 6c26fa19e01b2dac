"""What older results still say: points and clear sectors, moved by the motion."""

from __future__ import annotations

import math

import numpy as np
import pytest
from obstacle_worlds import CAMERA, SETTINGS, SIGHT, camera_attitude, nothing, result, wall

from flightdepth.flight.records import NS_PER_S
from flightdepth.live.obstacle_memory import ObstacleMap
from flightdepth.live.obstacle_messages import UNKNOWN, distances_cm
from flightdepth.live.obstacles import ObstacleSettings
from flightdepth.ranges.result import RangedDepth

FREE = 4001
NONE = RangedDepth.unknown(CAMERA.height, CAMERA.width, "hovering", 1.0)


def added(obstacles, time_s, depth, velocity, *, yaw=0.0, heading=None):
    return obstacles.add(
        round(time_s * NS_PER_S),
        depth,
        CAMERA,
        world_from_camera=camera_attitude(yaw=yaw),
        heading_rad=math.radians(yaw if heading is None else heading),
        velocity_ned=None if velocity is None else np.array(velocity, float),
    )


def cm(sectors):
    return distances_cm(sectors, 0.0, SETTINGS).astype(int)


def test_a_wall_comes_nearer_in_the_dark():
    """10 m ahead, then no depth while flying 2 m/s at it for half a second: 9 m."""
    obstacles = ObstacleMap(lambda _: SIGHT)
    added(obstacles, 0.0, result(wall(camera_attitude(), 10.0)), (2.0, 3.0, 0.0))
    for step in range(1, 6):
        found = added(obstacles, step / 10, NONE, (2.0, 0.0, 0.0))
    # Sideways flight went on for half of the first tenth: the velocity runs straight between its samples.
    assert found.remembered[0] and found.obstacle_m[0] == pytest.approx(9.0, abs=0.1)


def test_a_memory_ends():
    obstacles = ObstacleMap(lambda _: SIGHT, ObstacleSettings(memory_s=0.6))
    added(obstacles, 0.0, result(wall(camera_attitude(), 10.0)), (0.0, 3.0, 0.0))
    assert cm(added(obstacles, 0.4, NONE, (0.0, 3.0, 0.0)))[0] < FREE
    assert (cm(added(obstacles, 0.7, NONE, (0.0, 3.0, 0.0))) == UNKNOWN).all()


def test_turning_turns_what_is_remembered():
    """The nose turns 30 degrees right: a wall to the north is then 30 degrees to the left."""
    obstacles = ObstacleMap(lambda _: SIGHT)
    seen = added(obstacles, 0.0, result(wall(camera_attitude(), 10.0)), (0.0, 3.0, 0.0))
    found = added(obstacles, 0.01, NONE, (0.0, 3.0, 0.0), yaw=30)
    for sector in range(-4, 5):  # a sector's nearest point is at its edge, so it may count for the next one
        near = found.obstacle_m[[sector - 7, sector - 6, sector - 5]]
        assert np.nanmin(abs(near - seen.obstacle_m[sector])) < 0.05
    assert np.isnan(found.obstacle_m[6:20]).all()


def test_clear_is_remembered_and_shrinks_with_the_way():
    obstacles = ObstacleMap(lambda _: SIGHT, ObstacleSettings(max_m=30))
    added(obstacles, 0.0, nothing(90.0), (0.0, 4.0, 0.0))
    still = added(obstacles, 0.05, NONE, (0.0, 0.0, 0.0))
    assert still.remembered[0] and still.clear_m[0] >= 30
    for step in range(1, 5):
        ahead = added(obstacles, 0.05 + step / 5, NONE, (20.0, 0.0, 0.0))
    assert 0 < ahead.clear_m[0] < still.clear_m[0] - 8


def test_what_was_not_seen_then_is_not_clear_now():
    obstacles = ObstacleMap(lambda _: SIGHT)
    added(obstacles, 0.0, nothing(90.0), (0.0, 4.0, 0.0))
    found = cm(added(obstacles, 0.05, NONE, (0.0, 4.0, 0.0)))
    assert found[18] == found[36] == found[54] == UNKNOWN  # right, behind, left: outside the view


def test_the_newest_result_stands_before_the_memory():
    obstacles = ObstacleMap(lambda _: SIGHT)
    added(obstacles, 0.0, result(wall(camera_attitude(), 10.0)), (0.0, 3.0, 0.0))
    found = added(obstacles, 0.3, nothing(90.0), (0.0, 3.0, 0.0))
    assert cm(found)[0] == FREE and not found.remembered[0]


def test_two_results_in_a_row_count_as_one():
    """Near and far in turn: the nearer obstacle of both stands, moved by the motion; not for long."""
    near, far = result(wall(camera_attitude(), 8.0)), result(wall(camera_attitude(), 30.0))
    for order in ((near, far), (far, near)):
        obstacles = ObstacleMap(lambda _: SIGHT)
        added(obstacles, 0.0, order[0], (1.0, 3.0, 0.0))
        found = added(obstacles, 0.1, order[1], (1.0, 3.0, 0.0))
        assert 7.85 <= found.obstacle_m[0] <= 8.01
    late = ObstacleMap(lambda _: SIGHT)
    added(late, 0.0, near, (1.0, 3.0, 0.0))
    assert added(late, 0.3, far, (1.0, 3.0, 0.0)).obstacle_m[0] == pytest.approx(30.0, abs=0.1)


def test_what_one_of_two_results_calls_free_the_other_may_take_back():
    obstacles = ObstacleMap(lambda _: SIGHT)
    added(obstacles, 0.0, result(wall(camera_attitude(), 8.0)), (0.0, 3.0, 0.0))
    assert cm(added(obstacles, 0.03, nothing(90.0), (0.0, 3.0, 0.0)))[0] == pytest.approx(800, abs=5)


def test_the_blind_cone_is_covered_by_what_was_seen_before():
    """A ball ahead seen while flying sideways, then straight at it: only the memory knows it."""
    ball = np.full((CAMERA.height, CAMERA.width), np.nan)
    ball[110:130, 150:170] = 12.0
    seen = result(ball, farther_m=90.0)
    blind = cm(added(ObstacleMap(lambda _: SIGHT), 0.0, seen, (4.0, 0.0, 0.0)))
    obstacles = ObstacleMap(lambda _: SIGHT)
    added(obstacles, 0.0, seen, (0.0, 4.0, 0.0))
    known = cm(added(obstacles, 0.05, seen, (4.0, 0.0, 0.0)))
    assert blind[0] == UNKNOWN and known[0] == pytest.approx(1190, abs=15)


@pytest.mark.parametrize("lacking", ["velocity", "gap", "time"])
def test_nothing_is_remembered_across_what_nobody_knows(lacking):
    obstacles = ObstacleMap(lambda _: SIGHT)
    added(obstacles, 1.0, result(wall(camera_attitude(), 10.0)), (0.0, 3.0, 0.0))
    if lacking == "velocity":
        added(obstacles, 1.1, NONE, None)
    time_s = {"velocity": 1.2, "gap": 1.8, "time": 0.5}[lacking]
    assert (cm(added(obstacles, time_s, NONE, (0.0, 3.0, 0.0))) == UNKNOWN).all()


def test_without_attitude_or_heading_all_is_unknown():
    obstacles = ObstacleMap(lambda _: SIGHT)
    for attitude, heading in ((None, 0.0), (camera_attitude(), None)):
        found = obstacles.add(
            1,
            nothing(90.0),
            CAMERA,
            world_from_camera=attitude,
            heading_rad=heading,
            velocity_ned=np.array([0.0, 3.0, 0.0]),
        )
        assert (cm(found) == UNKNOWN).all()
