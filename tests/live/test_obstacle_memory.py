"""What older results still say: points and clear sectors, moved by the motion."""

from __future__ import annotations

import math

import numpy as np
import pytest
from obstacle_worlds import CAMERA, SETTINGS, SIGHT, camera_attitude, ground, nothing, result, wall

from flightdepth.flight.records import NS_PER_S
from flightdepth.live.obstacle_memory import ObstacleMap
from flightdepth.live.obstacle_messages import UNKNOWN, distances_cm
from flightdepth.live.obstacles import ObstacleSettings
from flightdepth.ranges.result import RangedDepth

FREE = 4001
NONE = RangedDepth.unknown(CAMERA.height, CAMERA.width, "hovering", 1.0)


def added(obstacles, time_s, depth, velocity, *, yaw=0.0, heading=None):
    """What is known just after a result."""
    stamp_ns = round(time_s * NS_PER_S)
    obstacles.add(
        stamp_ns,
        depth,
        CAMERA,
        world_from_camera=camera_attitude(yaw=yaw),
        heading_rad=math.radians(yaw if heading is None else heading),
        velocity_ned=None if velocity is None else np.array(velocity, float),
    )
    return obstacles.at(stamp_ns)


def cm(sectors):
    return distances_cm(sectors, SETTINGS).astype(int)


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
        obstacles.add(
            1,
            nothing(90.0),
            CAMERA,
            world_from_camera=attitude,
            heading_rad=heading,
            velocity_ned=np.array([0.0, 3.0, 0.0]),
        )
        assert (cm(obstacles.at(1)) == UNKNOWN).all()


SLOWLY = (0.0, 0.5, 0.0)  # so that sideways nothing moves to another sector


def test_what_is_seen_in_between_is_kept_each_fifth_of_a_second():
    """The second of three results saw the wall; ahead the third knows nothing, and the first saw none yet."""
    left = np.full((CAMERA.height, CAMERA.width), np.nan)
    left[:, :100] = 90.0
    obstacles = ObstacleMap(lambda _: SIGHT)
    added(obstacles, 0.0, nothing(90.0), SLOWLY)
    added(obstacles, 0.2, result(wall(camera_attitude(), 10.0)), SLOWLY)
    added(obstacles, 0.4, result(left), SLOWLY)
    assert added(obstacles, 0.7, NONE, SLOWLY).obstacle_m[0] == pytest.approx(10.0, abs=0.1)


def test_what_the_last_result_that_saw_anything_saw_is_remembered():
    """A wall that came into view less than a fifth of a second before depth ended was told as free."""
    obstacles = ObstacleMap(lambda _: SIGHT)
    added(obstacles, 0.0, nothing(90.0), SLOWLY)
    for step in range(1, 5):
        added(obstacles, step / 30, nothing(90.0), SLOWLY)
    added(obstacles, 5 / 30, result(wall(camera_attitude(), 10.0)), SLOWLY)
    for step in range(6, 15):
        assert cm(added(obstacles, step / 30, NONE, SLOWLY))[0] == pytest.approx(1000, abs=5)


def test_a_result_that_knows_nothing_takes_no_snapshots_place():
    obstacles = ObstacleMap(lambda _: SIGHT)
    added(obstacles, 0.0, NONE, SLOWLY)
    added(obstacles, 0.1, result(wall(camera_attitude(), 10.0)), SLOWLY)
    assert added(obstacles, 0.5, NONE, SLOWLY).obstacle_m[0] == pytest.approx(10.0, abs=0.1)


def test_an_obstacle_of_little_confidence_is_remembered():
    """Of it alone nothing is clear."""
    obstacles = ObstacleMap(lambda _: SIGHT)
    seen = added(obstacles, 0.0, result(wall(camera_attitude(), 10.0), confidence=0.3), SLOWLY)
    assert not seen.clear_m.any()
    assert added(obstacles, 0.4, NONE, SLOWLY).obstacle_m[0] == pytest.approx(10.0, abs=0.1)


def test_a_memory_does_not_renew_itself():
    """Results come each tenth of a second, and none of them sees anything: the wall is gone after a second."""
    obstacles = ObstacleMap(lambda _: SIGHT)
    added(obstacles, 0.0, result(wall(camera_attitude(), 10.0)), SLOWLY)
    found = [added(obstacles, step / 10, NONE, SLOWLY).obstacle_m[0] for step in range(1, 13)]
    assert np.isfinite(found).tolist() == [True] * 10 + [False] * 2


@pytest.mark.parametrize(("gap_s", "kept"), [(0.5, True), (0.51, False)])
def test_over_a_gap_of_half_a_second_the_way_is_known(gap_s, kept):
    obstacles = ObstacleMap(lambda _: SIGHT)
    added(obstacles, 1.0, result(wall(camera_attitude(), 10.0)), SLOWLY)
    assert np.isfinite(added(obstacles, 1.0 + gap_s, NONE, SLOWLY).obstacle_m[0]) == kept


@pytest.mark.parametrize(("apart_s", "near"), [(0.25, True), (0.26, False)])
def test_results_a_quarter_of_a_second_apart_count_as_one(apart_s, near):
    obstacles = ObstacleMap(lambda _: SIGHT)
    added(obstacles, 0.0, result(wall(camera_attitude(), 8.0)), SLOWLY)
    found = added(obstacles, apart_s, result(wall(camera_attitude(), 30.0)), SLOWLY)
    assert found.obstacle_m[0] == pytest.approx(8.0 if near else 30.0, abs=0.1)


def test_a_result_of_the_same_time_forgets_nothing():
    obstacles = ObstacleMap(lambda _: SIGHT)
    added(obstacles, 0.0, result(wall(camera_attitude(), 10.0)), (0.0, 3.0, 0.0))
    assert added(obstacles, 0.0, NONE, (0.0, 3.0, 0.0)).obstacle_m[0] == pytest.approx(10.0, abs=0.1)


def test_of_two_results_in_a_row_each_may_call_clear_what_it_knows():
    """The second knows 25 m only; a third of a second later what it knows is all that is told."""
    for apart_s, told in ((0.1, FREE), (0.3, 2500)):
        obstacles = ObstacleMap(lambda _: SIGHT)
        added(obstacles, 0.0, nothing(90.0), SLOWLY)
        found = added(obstacles, apart_s, nothing(25.0), SLOWLY)
        assert cm(found)[0] == pytest.approx(told, abs=1) and not found.remembered[0]


def test_what_is_clear_ends_at_the_obstacle_that_either_of_two_saw():
    obstacles = ObstacleMap(lambda _: SIGHT)
    added(obstacles, 0.0, result(wall(camera_attitude(), 10.0)), SLOWLY)
    found = added(obstacles, 0.05, nothing(90.0), SLOWLY)
    assert found.clear_m[0] == found.obstacle_m[0] == pytest.approx(10.0, abs=0.1)


def test_what_was_clear_ends_at_the_obstacle_that_a_later_snapshot_saw():
    """Of little confidence, so that alone it says nothing of what is clear."""
    obstacles = ObstacleMap(lambda _: SIGHT)
    added(obstacles, 0.0, nothing(90.0), SLOWLY)
    added(obstacles, 0.3, result(wall(camera_attitude(), 10.0), confidence=0.3), SLOWLY)
    found = added(obstacles, 0.6, NONE, SLOWLY)
    assert found.clear_m[0] == found.obstacle_m[0] == pytest.approx(10.0, abs=0.1)


def test_remembered_is_only_what_the_newest_did_not_see_itself():
    obstacles = ObstacleMap(lambda _: SIGHT)
    for time_s in (0.0, 0.1):
        found = added(obstacles, time_s, result(wall(camera_attitude(), 10.0)), SLOWLY)
    assert np.isfinite(found.obstacle_m[0]) and not found.remembered[0]
    assert not found.remembered[18:55].any()  # nobody ever saw there
    found = added(obstacles, 0.5, NONE, SLOWLY)
    assert found.remembered[0] and not found.remembered[18:55].any()


def test_clear_that_an_older_snapshot_told_is_remembered_and_told_so():
    """The later one knew 25 m of it."""
    obstacles = ObstacleMap(lambda _: SIGHT)
    added(obstacles, 0.0, nothing(90.0), SLOWLY)
    added(obstacles, 0.3, nothing(25.0), SLOWLY)
    found = added(obstacles, 0.6, NONE, (0.0, 0.0, 0.0))
    assert cm(found)[0] == FREE and found.remembered[0] and np.isnan(found.obstacle_m[0])


def test_a_newer_obstacle_stands_before_a_nearer_one_of_the_memory():
    obstacles = ObstacleMap(lambda _: SIGHT)
    added(obstacles, 0.0, result(wall(camera_attitude(), 8.0)), SLOWLY)
    found = added(obstacles, 0.3, result(wall(camera_attitude(), 12.0), confidence=0.3), SLOWLY)
    assert found.obstacle_m[0] == pytest.approx(12.0, abs=0.1)


@pytest.mark.parametrize("heading", [0, 40, -170])
def test_turning_from_any_heading_turns_what_was_clear(heading):
    """80 degrees were seen; 30 degrees of turn to the right move them as much to the left. So for a wall."""
    east, north = 0.5 * math.cos(math.radians(heading)), -0.5 * math.sin(math.radians(heading))
    obstacles = ObstacleMap(lambda _: SIGHT)
    added(obstacles, 0.0, nothing(90.0), (north, east, 0.0), yaw=heading)
    found = added(obstacles, 0.01, NONE, (0.0, 0.0, 0.0), yaw=heading + 30)
    clear = np.flatnonzero(found.clear_m)
    assert sorted((clear + 36) % 72 - 36) == list(range(-13, 2))
    attitude = camera_attitude(yaw=heading)
    walled = ObstacleMap(lambda _: SIGHT)
    added(walled, 0.0, result(wall(attitude, 10.0, bearing_deg=heading)), (north, east, 0.0), yaw=heading)
    found = added(walled, 0.01, NONE, (0.0, 0.0, 0.0), yaw=heading + 30)
    assert np.nanmin(found.obstacle_m[[65, 66, 67]]) == pytest.approx(10.0, abs=0.1)
    assert np.isnan(found.obstacle_m[4:56]).all()


def test_a_sector_is_clear_as_far_as_all_its_width_was():
    """Sector 7 was seen whole, sector 8 by half; 2 degrees of turn bring the edge of the one into the other."""
    obstacles = ObstacleMap(lambda _: SIGHT)
    seen = added(obstacles, 0.0, nothing(90.0), SLOWLY)
    assert cm(seen)[7] == FREE and cm(seen)[8] == UNKNOWN
    found = cm(added(obstacles, 0.3, NONE, (0.0, 0.0, 0.0), yaw=2))
    assert found[6] == FREE and found[7] == UNKNOWN


@pytest.mark.parametrize(("bound_m", "told"), [(20.5, 2000), (19.5, UNKNOWN)])
def test_clear_for_less_than_half_of_the_reach_is_not_remembered(bound_m, told):
    obstacles = ObstacleMap(lambda _: SIGHT)
    added(obstacles, 0.0, nothing(bound_m), SLOWLY)
    assert cm(added(obstacles, 0.3, NONE, (0.0, 0.0, 0.0)))[0] == told


def test_clear_is_remembered_in_steps_of_a_metre_never_farther_than_it_was():
    obstacles = ObstacleMap(lambda _: SIGHT)
    added(obstacles, 0.0, nothing(25.5), SLOWLY)
    assert cm(added(obstacles, 0.3, NONE, (0.0, 0.0, 0.0)))[0] == 2500


def test_what_is_remembered_as_free_is_free_until_the_result_is_old():
    obstacles = ObstacleMap(lambda _: SIGHT)
    added(obstacles, 0.0, nothing(90.0), (0.0, 4.0, 0.0))
    added(obstacles, 0.02, NONE, (0.0, 4.0, 0.0))
    assert cm(obstacles.at(NS_PER_S // 5))[0] == FREE


@pytest.mark.parametrize(("back_m", "free"), [(1.5, True), (2.2, False)])
def test_flying_backwards_only_the_drones_own_place_counts_as_seen(back_m, free):
    """Sector 0 begins then behind where the camera looked from: within a metre of it nothing else can have been."""
    obstacles = ObstacleMap(lambda _: SIGHT)
    added(obstacles, 0.0, nothing(90.0), SLOWLY)
    added(obstacles, 0.01, NONE, (-10 * back_m, 0.0, 0.0))
    found = added(obstacles, 0.11, NONE, (-10 * back_m, 0.0, 0.0))
    assert (cm(found)[0] != UNKNOWN) == free


@pytest.mark.parametrize(("sunk_m", "free"), [(-0.55, False), (-0.45, True), (0.45, True), (0.55, False)])
def test_what_was_clear_is_not_where_the_corridor_left_the_old_one(sunk_m, free):
    """It may move by half of its lesser half: here 0.5 m, up or down."""
    obstacles = ObstacleMap(lambda _: SIGHT, ObstacleSettings(above_m=1.0, below_m=1.5))
    added(obstacles, 0.0, nothing(90.0), (0.0, 0.5, 2.5 * sunk_m))
    found = added(obstacles, 0.4, NONE, (0.0, 0.0, 2.5 * sunk_m))
    assert (cm(found)[0] == FREE) == free


def ball(distance_m):
    """A ball at the camera's height, a metre wide."""
    depth = np.full((CAMERA.height, CAMERA.width), np.nan)
    depth[118:122, 150:170] = distance_m
    return result(depth, farther_m=90.0)


@pytest.mark.parametrize(("sunk_m", "kept"), [(-1.3, False), (-0.8, True), (1.3, True), (1.8, False)])
def test_an_obstacle_that_left_the_corridor_is_forgotten(sunk_m, kept):
    """1.5 m over the camera and 1 m under it: after a climb of 1.3 m the ball lies below, after a descent within."""
    obstacles = ObstacleMap(lambda _: SIGHT, ObstacleSettings(above_m=1.5, below_m=1.0))
    added(obstacles, 0.0, ball(12.0), (0.0, 3.0, 4 * sunk_m))
    found = added(obstacles, 0.25, NONE, (0.0, 0.0, 4 * sunk_m))
    assert np.isfinite(found.obstacle_m).any() == kept


def test_a_remembered_wall_is_one_after_a_step_too():
    """Not one point in each sector: those moved apart, and left sectors between them unknown."""
    obstacles = ObstacleMap(lambda _: SIGHT)
    added(obstacles, 0.0, result(wall(camera_attitude(), 10.0)), (2.5, 3.0, 0.0))
    added(obstacles, 0.4, NONE, (2.5, 0.0, 0.0))
    found = added(obstacles, 0.8, NONE, (2.5, -3.0, 0.0))  # 2 m nearer
    beside = np.arange(-6, 7)
    nearest_deg = np.maximum(abs(beside) * 5 - 2.5, 0)
    np.testing.assert_allclose(found.obstacle_m[beside], 8 / np.cos(np.radians(nearest_deg)), rtol=0.02)


def test_of_results_that_look_near_and_far_in_turn_both_are_remembered():
    """Each fifth of a second one was kept, always of the same kind where results come as regularly."""
    near, far = np.full((2, CAMERA.height, CAMERA.width), np.nan)
    near[:, 100:160], far[:, 160:220] = 8.0, 30.0
    obstacles = ObstacleMap(lambda _: SIGHT)
    for step in range(12):
        added(obstacles, step / 30, result(far if step % 2 else near), SLOWLY)
    found = added(obstacles, 0.7, NONE, SLOWLY)
    assert found.obstacle_m[-1] == pytest.approx(8.0, rel=0.02)
    assert found.obstacle_m[1] == pytest.approx(30.0, rel=0.02)


def test_near_the_ground_the_corridor_of_a_result_ends_above_it():
    """The foot of the view meets the ground 1.2 m below: no obstacle where somebody tells that height."""
    attitude = camera_attitude(pitch=-10)
    for height_m, seen in ((None, True), (math.nan, True), (1.2, False)):
        obstacles = ObstacleMap(lambda _: SIGHT)
        obstacles.add(
            0,
            result(ground(attitude, 1.2), farther_m=60.0),
            CAMERA,
            world_from_camera=attitude,
            heading_rad=0.0,
            velocity_ned=np.array([0.0, 3.0, 0.0]),
            height_m=height_m,
        )
        assert np.isfinite(obstacles.at(0).obstacle_m).any() == seen


def test_few_snapshots_are_kept_however_many_results_come():
    """Each costs time with each result."""
    obstacles = ObstacleMap(lambda _: SIGHT)
    for step in range(45):
        added(obstacles, step / 30, nothing(90.0), SLOWLY)
    assert len(obstacles._kept) <= 7


def test_what_is_remembered_comes_nearer_as_the_drone_flies_on():
    """Hovering pictures show nothing, but the drone flies on at 2 m/s."""
    obstacles = ObstacleMap(lambda _: SIGHT)
    added(obstacles, 0.0, result(wall(camera_attitude(), 10.0)), (2.0, 3.0, 0.0))
    found = added(obstacles, 0.1, NONE, (2.0, 0.0, 0.0))
    assert cm(found)[0] - cm(obstacles.at(350_000_000))[0] == pytest.approx(50, abs=1)


# At a time after the newest result


def test_the_newest_result_moves_with_the_velocity_it_had():
    obstacles = ObstacleMap(lambda _: SIGHT)
    added(obstacles, 1.0, result(wall(camera_attitude(), 10.0)), (3.0, 3.0, 0.0))
    told = [cm(obstacles.at(1_000_000_000 + late_ms * 1_000_000))[0] for late_ms in (0, 100, 300)]
    assert told[0] == pytest.approx(1000, abs=2) and np.diff(told) == pytest.approx([-30, -60], abs=2)


def test_a_drone_that_brakes_is_told_the_way_that_it_flew():
    """From 4 m/s to 0 in 0.4 s it flies 0.8 m."""
    obstacles = ObstacleMap(lambda _: SIGHT)
    added(obstacles, 0.0, result(wall(camera_attitude(), 10.0)), (4.0, 3.0, 0.0))
    found = obstacles.at(400_000_000, velocity_ned=np.zeros(3))
    assert found.obstacle_m[0] == pytest.approx(9.2, abs=0.02)


def test_a_nose_that_turned_meanwhile_turns_the_sectors():
    """A wall to the north of a drone that flies east, with its nose first north, then 20 degrees to the right of it."""
    obstacles = ObstacleMap(lambda _: SIGHT)
    added(obstacles, 0.0, result(wall(camera_attitude(), 10.0)), (0.0, 3.0, 0.0))
    found = obstacles.at(100_000_000, heading_rad=math.radians(20))
    assert np.nanargmin(found.obstacle_m) == 72 - 4
    assert found.obstacle_m[-4] == pytest.approx(10.0, rel=0.01)


def test_both_of_two_results_move():
    """The one before saw a post 8 m ahead, the newest the wall behind it; half a metre to the left of both it stands
    to the right."""
    post = np.full((CAMERA.height, CAMERA.width), 30.0)
    post[:, 155:165] = 8.0
    obstacles = ObstacleMap(lambda _: SIGHT)
    added(obstacles, 0.0, result(post), (0.0, -2.5, 0.0))
    added(obstacles, 0.1, result(np.full_like(post, 30.0)), (0.0, -2.5, 0.0))
    found = cm(obstacles.at(300_000_000))  # 0.75 m to the left by now: 5.4 degrees
    assert found[1] == pytest.approx(800, rel=0.02) and found[-1] > 2900


def test_a_time_before_the_newest_result_is_taken_for_its_own():
    obstacles = ObstacleMap(lambda _: SIGHT)
    added(obstacles, 1.0, result(wall(camera_attitude(), 10.0)), (3.0, 3.0, 0.0))
    assert obstacles.at(960_000_000).obstacle_m[0] == obstacles.at(1_000_000_000).obstacle_m[0]


def test_before_the_first_result_all_is_unknown():
    assert (cm(ObstacleMap(lambda _: SIGHT).at(0)) == UNKNOWN).all()
