"""Sectors from depth: numbers by hand, and what must never be called free."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from obstacle_worlds import (
    CAMERA,
    SETTINGS,
    SIDEWAYS,
    SIGHT,
    blind_cone_deg,
    camera_attitude,
    ground,
    looked,
    nothing,
    result,
    wall,
)

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.live.obstacle_messages import UNKNOWN, distances_cm
from flightdepth.live.obstacle_rays import (
    STILL,
    Moved,
    _clear,
    _Ends,
    _ends,
    _nearest,
    rays_of,
    sectors_of,
)
from flightdepth.live.obstacles import (
    LEAST_PARALLAX_PX,
    SECTORS,
    ObstacleSettings,
    Pose,
    Sectors,
    Sight,
    heading_rad,
)
from flightdepth.motion import quaternion_from_rotation, rotation_from_euler
from flightdepth.ranges.fusion import ends
from flightdepth.ranges.result import RangedDepth
from tests_networks import swept_card

FREE = 4001  # max_distance + 1
INNER = range(-6, 7)  # whole sectors within 80 degrees: up to 32.5 off the axis
NEAR = 0.02


def cm(sectors, settings=SETTINGS):
    return distances_cm(sectors, settings).astype(int)


def moved_on(depth, step_m, turn_deg=0.0, velocity=SIDEWAYS):
    """What a result of a camera that looks ahead says after the drone moved (forward, right, down) and turned."""
    pose = Pose.of(camera_attitude(), 0.0, np.array(velocity))
    seen = rays_of(depth, CAMERA, pose, SIGHT, SETTINGS)
    return sectors_of(seen, SETTINGS, Moved(np.array(step_m), math.radians(turn_deg)))


@pytest.mark.parametrize("sector", INNER)
def test_a_wall_ahead_is_ten_over_cosine(sector):
    found = looked(result(wall(camera_attitude(), 10.0)))
    # Its nearest 5 % lie near the edge of the sector that is nearest to the wall's foot.
    edge = max(abs(sector) * 5 - 2.5, 0.0)
    low, high = 10 / math.cos(math.radians(edge)), 10 / math.cos(math.radians(abs(sector) * 5))
    assert low * (1 - NEAR) <= found.obstacle_m[sector] <= high * (1 + 1e-4)


def test_outside_the_view_is_unknown():
    values = cm(looked(result(wall(camera_attitude(), 10.0))))
    behind = [sector for sector in range(SECTORS) if min(sector, SECTORS - sector) > 8]
    assert (values[behind] == UNKNOWN).all()
    assert np.isfinite(values[[0, 1, 71]]).all() and (values[[0, 1, 71]] < FREE).all()


def test_range_is_horizontal_not_along_the_axis():
    """A camera that looks 25 degrees down sees the foot of a wall: z-depth is 9.06 m in its middle column."""
    attitude = camera_attitude(pitch=-25)
    settings = ObstacleSettings(above_m=3, below_m=8)
    found = looked(result(wall(attitude, 10.0)), attitude, settings=settings)
    assert found.obstacle_m[0] == pytest.approx(10.0, rel=NEAR)


@pytest.mark.parametrize("yaw", [-90, -35, 20, 60, 180])
def test_a_turned_gimbal_turns_the_sectors(yaw):
    attitude = camera_attitude(yaw=yaw)
    velocity = tuple(np.array([-math.sin(math.radians(yaw)), math.cos(math.radians(yaw)), 0]) * 3)
    found = looked(result(wall(attitude, 10.0, bearing_deg=yaw)), attitude, velocity=velocity)
    ahead = round(yaw / 5) % SECTORS
    assert found.obstacle_m[ahead] == pytest.approx(10.0, rel=NEAR)
    seen = np.flatnonzero(np.isfinite(found.obstacle_m))
    assert all(min((s - ahead) % SECTORS, (ahead - s) % SECTORS) <= 8 for s in seen)


def test_the_nose_is_sector_zero_wherever_north_is():
    attitude = camera_attitude(yaw=60)
    velocity = (-math.sin(math.radians(60)) * 3, math.cos(math.radians(60)) * 3, 0.0)
    found = looked(result(wall(attitude, 10.0, bearing_deg=60)), attitude, heading_deg=60, velocity=velocity)
    assert found.obstacle_m[0] == pytest.approx(10.0, rel=NEAR)


@pytest.mark.parametrize("roll", [-40, -10, 25])
def test_a_rolled_drone_sees_the_same_wall(roll):
    attitude = camera_attitude(roll=roll)
    found = looked(result(wall(attitude, 10.0)), attitude)
    for sector in (-3, 0, 3):
        level = looked(result(wall(camera_attitude(), 10.0))).obstacle_m[sector]
        assert found.obstacle_m[sector] == pytest.approx(level, rel=NEAR)


def test_right_is_clockwise():
    """A wall on the right half only: positive sectors see it, negative ones are clear."""
    depth = wall(camera_attitude(), 10.0)
    depth[:, : CAMERA.width // 2] = 100.0
    values = cm(looked(result(depth)))
    assert values[3] < 1100 and values[-3] == FREE


def test_ground_below_the_corridor_is_no_obstacle():
    """Flying 5 m over level ground: rays reach it 5 m below, the corridor ends at 1.5 m."""
    found = looked(result(ground(camera_attitude(), 5.0), farther_m=60.0))
    assert np.isnan(found.obstacle_m).all()
    assert cm(found)[0] == FREE


def test_near_the_ground_the_corridor_ends_above_it():
    depth = ground(camera_attitude(pitch=-10), 1.2)
    low = looked(result(depth, farther_m=60.0), camera_attitude(pitch=-10))
    mended = SETTINGS.over_ground(1.2)
    assert np.isfinite(low.obstacle_m).any()
    assert mended.below_m == pytest.approx(0.7)
    found = looked(result(depth, farther_m=60.0), camera_attitude(pitch=-10), settings=mended)
    assert np.isnan(found.obstacle_m).all()


def test_a_pole_is_found_and_noise_is_not():
    depth = wall(camera_attitude(), 100.0)
    pole = depth.copy()
    pole[:, 158:161] = 12.0  # 3 of the sector's 17 columns
    assert looked(result(pole)).obstacle_m[0] == pytest.approx(12.0, rel=NEAR)
    speck = depth.copy()
    speck[118:121, 158:160] = 12.0
    assert np.isnan(looked(result(speck)).obstacle_m[0])


def test_free_needs_a_bound_as_far_as_max():
    assert cm(looked(nothing(60.0)))[0] == FREE
    assert cm(looked(nothing(25.0)))[0] == pytest.approx(2500, abs=2)  # free up to the bound, never beyond
    assert cm(looked(nothing()))[0] == UNKNOWN


def test_far_depth_with_little_confidence_is_unknown():
    far = np.full((CAMERA.height, CAMERA.width), 90.0)
    assert cm(looked(result(far, confidence=0.9)))[0] == FREE
    assert cm(looked(result(far, confidence=0.3)))[0] == UNKNOWN


def test_an_obstacle_needs_less_confidence_than_free():
    """A miss is worse than a false alarm: 0.3 is enough for a wall, and not for clear air behind it."""
    assert cm(looked(result(wall(camera_attitude(), 10.0), confidence=0.3)))[0] == pytest.approx(1000, abs=2)
    assert cm(looked(result(wall(camera_attitude(), 10.0), confidence=0.1)))[0] == UNKNOWN


def test_at_most_is_an_obstacle():
    """What is too near for every range was unknown, and the wall behind it was told."""
    depth = wall(camera_attitude(), 30.0)
    depth[:, 150:160] = np.nan
    behind = result(depth)
    assert cm(looked(behind))[0] == pytest.approx(3000, abs=5)
    nearer = np.where(np.isnan(depth), np.float32(4.0), np.float32(np.nan))
    assert cm(looked(replace(behind, nearer_than_m=nearer)))[0] == pytest.approx(400, abs=2)


def test_an_unknown_strip_of_a_degree_keeps_a_sector_from_being_free():
    far = np.full((CAMERA.height, CAMERA.width), 90.0)
    far[:, 162:168] = np.nan
    values = cm(looked(result(far)))
    assert values[0] == UNKNOWN and values[3] == FREE


def test_a_half_seen_sector_is_not_free():
    """The view ends 40 degrees off the axis: the sector at 40 is seen by half, that at 35 whole."""
    values = cm(looked(nothing(60.0)))
    assert values[7] == FREE and values[8] == UNKNOWN and values[-8] == UNKNOWN


def test_looking_down_says_nothing_of_what_is_ahead():
    attitude = camera_attitude(pitch=-75)
    assert (cm(looked(nothing(60.0), attitude)) == UNKNOWN).all()


def test_flying_at_a_wall_nothing_is_known_in_the_cone():
    """40 m and 1 m flown: 11.5 degrees. 10 m: 2.9 degrees, so that wall is seen from sector 1 on."""
    assert pytest.approx(1.0) == LEAST_PARALLAX_PX
    ahead = (4.0, 0.0, 0.0)
    free = cm(looked(nothing(90.0), velocity=ahead))
    cone = blind_cone_deg(SETTINGS.max_m + 4.0 * SETTINGS.stale_s, 1.0, SIGHT)
    for sector in (-2, -1, 0, 1, 2):
        assert abs(sector) * 5 < cone + 5 and free[sector] == UNKNOWN
    assert free[4] == FREE and free[-4] == FREE
    near = cm(looked(result(wall(camera_attitude(), 10.0)), velocity=ahead))
    assert near[0] < 1100 and near[1] < 1100  # its rows above and below the cone of 2.9 degrees show it
    ball = np.full((CAMERA.height, CAMERA.width), np.nan)
    ball[115:125, 155:165] = 10.0  # within 2 degrees of the way
    assert cm(looked(result(ball, farther_m=90.0), velocity=ahead))[0] == UNKNOWN
    assert cm(looked(result(ball, farther_m=90.0)))[0] == pytest.approx(1000, abs=2)  # seen in passing


def test_flying_backwards_blinds_as_well():
    assert cm(looked(nothing(90.0), velocity=(-4.0, 0.0, 0.0)))[0] == UNKNOWN


def test_a_longer_range_narrows_the_cone():
    short = cm(looked(nothing(90.0), velocity=(4.0, 0.0, 0.0)))
    far = np.full((CAMERA.height, CAMERA.width), np.nan)
    both = result(far, farther_m=90.0, displacements_m=(1.0, 6.0))
    long = cm(looked(both, velocity=(4.0, 0.0, 0.0)))
    assert (short == FREE).sum() < (long == FREE).sum()


def test_what_a_long_range_cannot_see_does_not_count_for_it():
    """A wall at 10 m: 6 m are too far apart to see it, so its parallax is that of 0.2 m: 14.5 degrees."""
    sight = Sight(SIGHT.focal_px, least_depth_per_m=5.0)
    seen = result(wall(camera_attitude(), 10.0), displacements_m=(0.2, 6.0))
    found = cm(looked(seen, velocity=(4.0, 0.0, 0.0), sight=sight))
    assert found[1] == UNKNOWN and found[4] < 1300


@pytest.mark.parametrize("step_m", [(0.9, 0.0, 0.0), (-0.7, 0.0, 0.0), (0.0, 0.6, 0.0), (0.5, -0.8, 0.2)])
@pytest.mark.parametrize("turn_deg", [0, 15, -40])
def test_a_wall_is_where_one_sees_it_who_moved_there(step_m, turn_deg):
    """Law: what a result says after a step and a turn is what is seen from there."""
    found = moved_on(result(wall(camera_attitude(), 10.0)), step_m, turn_deg)
    there = camera_attitude(yaw=turn_deg)
    seen = looked(result(wall(there, 10.0 - step_m[0])), there, heading_deg=turn_deg)
    bearing = np.arange(-4, 5) - round(turn_deg / 5)  # within both views
    both = [sector for sector in bearing if abs(sector) <= 5]
    np.testing.assert_allclose(found.obstacle_m[both], seen.obstacle_m[both], rtol=0.01)
    np.testing.assert_allclose(found.clear_m[both], seen.clear_m[both], rtol=0.03)


def test_what_stands_beside_the_way_leaves_its_sector():
    """A post 5 m ahead; after half a metre to the left it stands 5.7 degrees to the right."""
    depth = np.full((CAMERA.height, CAMERA.width), 90.0)
    depth[:, 155:165] = 5.0
    before, after = (cm(moved_on(result(depth), step_m)) for step_m in ((0, 0, 0), (0, -0.5, 0)))
    assert before[0] == pytest.approx(500, rel=NEAR) and before[2] == FREE
    assert after[1] == pytest.approx(500, rel=NEAR) and after[-1] == FREE


@pytest.mark.parametrize(("sunk_m", "seen"), [(0.0, True), (0.9, True), (1.7, False), (-1.7, False)])
def test_who_climbed_or_sank_has_another_corridor(sunk_m, seen):
    """A ball at the camera's height."""
    ball = np.full((CAMERA.height, CAMERA.width), 90.0)
    ball[118:122, 150:170] = 12.0
    assert np.isfinite(moved_on(result(ball), (0.0, 0.0, sunk_m)).obstacle_m[0]) == seen


def test_what_was_clear_is_so_for_less_after_a_step_ahead():
    """41 m; a metre and a half are kept in reserve, as much as 3 m/s take in half a second."""
    told = [cm(moved_on(nothing(41.0), (ahead_m, 0.0, 0.0)))[0] for ahead_m in (0.0, 0.9, 1.2)]
    assert told[:2] == [FREE, FREE] and told[2] == pytest.approx(3980, abs=2)
    assert cm(moved_on(nothing(60.0), (1.5, 0.0, 0.0)))[0] == FREE


def test_who_knew_nothing_knows_nothing_after_a_step():
    none = RangedDepth.unknown(CAMERA.height, CAMERA.width, "hovering", 1.0)
    for depth in (nothing(), none):
        assert (cm(moved_on(depth, (0.5, 0.5, 0.0), 20)) == UNKNOWN).all()


def test_touching_is_the_least_distance_never_zero():
    seen = result(wall(camera_attitude(), 0.2))
    assert cm(looked(seen))[0] == 100
    assert cm(moved_on(seen, (0.15, 0.0, 0.0)))[0] == 100


def test_a_camera_that_looks_straight_down_says_nothing_of_what_is_beside():
    down = camera_attitude(pitch=-90)
    assert (cm(looked(result(ground(down, 10.0)), down)) == UNKNOWN).all()


def test_hovering_or_no_depth_is_unknown():
    hovering = looked(result(wall(camera_attitude(), 10.0)), velocity=(0.0, 0.1, 0.0))
    assert (cm(hovering) == UNKNOWN).all()
    none = RangedDepth.unknown(CAMERA.height, CAMERA.width, "hovering", 1.0)
    assert (cm(looked(none)) == UNKNOWN).all()


def test_a_bent_lens_sees_the_same_wall():
    bent = Camera(320, 240, 190, 190, 159.5, 119.5, (-0.2, 0.02, 0.0, 0.0))
    from flightdepth.runtimes.lens import undistort

    rows, columns = np.mgrid[0:240, 0:320]
    rays = undistort(np.stack([columns, rows], axis=-1).astype(float), bent)
    depth = np.full(rays.shape[:2], 10.0)  # a wall across the axis has one z-depth
    found = looked(result(depth), camera=bent)
    assert found.obstacle_m[0] == pytest.approx(10.0, rel=NEAR)
    assert found.obstacle_m[5] == pytest.approx(10 / math.cos(math.radians(22.5)), rel=NEAR)


def test_heading_of_a_banked_body():
    body = quaternion_from_rotation(rotation_from_euler(0.4, -0.3, 2.0))
    assert heading_rad(body) == pytest.approx(2.0)


@hypothesis_settings(max_examples=10, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    roll=st.floats(-30, 30),
    pitch=st.floats(-40, 20),
    yaw=st.floats(-180, 180),
    unknown=st.floats(0.35, 1.0),
)
def test_mostly_unknown_pixels_are_never_free(seed, roll, pitch, yaw, unknown):
    """Law: where more than 30 % of the rays say nothing, no sector is free, whatever the others say."""
    rng = np.random.default_rng(seed)
    far = np.full((CAMERA.height, CAMERA.width), 90.0)
    # Every row and column the same share, so that each degree of each sector has it.
    far[rng.permuted(np.tile(np.arange(320) < unknown * 320, (240, 1)), axis=1)] = np.nan
    attitude = camera_attitude(roll, pitch, yaw)
    velocity = (-3 * math.sin(math.radians(yaw)), 3 * math.cos(math.radians(yaw)), 0.0)
    values = cm(looked(result(far), attitude, velocity=velocity))
    assert (values == FREE).sum() <= (0 if unknown > 0.6 else 2)  # a degree of 5 columns may have luck


@hypothesis_settings(max_examples=10, deadline=None)
@given(scale=st.floats(0.3, 3.0), yaw=st.floats(-180, 180))
def test_distances_grow_with_the_scene(scale, yaw):
    """Law: scene, displacement, corridor and limits times s give s times the distances."""
    attitude = camera_attitude(pitch=-5, yaw=yaw)
    velocity = (-3 * math.sin(math.radians(yaw)), 3 * math.cos(math.radians(yaw)), 0.0)
    depth = wall(attitude, 10.0, bearing_deg=yaw)
    one = looked(result(depth), attitude, velocity=velocity)
    larger = ObstacleSettings(min_m=scale, max_m=40 * scale, above_m=1.5 * scale, below_m=1.5 * scale)
    many = looked(
        result(depth * np.float32(scale), displacements_m=(scale,)),
        attitude,
        velocity=tuple(np.array(velocity) * scale),
        settings=larger,
    )
    np.testing.assert_allclose(many.obstacle_m, one.obstacle_m * scale, rtol=1e-2)


@pytest.mark.parametrize(
    "bad", [{"min_m": 0.0}, {"max_m": 0.5}, {"max_m": 700.0}, {"below_m": 0.0}, {"hit_share": 1.5}]
)
def test_settings_are_checked(bad):
    with pytest.raises(BadInput):
        ObstacleSettings(**bad)


def band(low_row, high_row, depth_m, *, farther_m=90.0):
    """Something in these rows of the picture, as wide as the view; row 119.5 looks level."""
    depth = np.full((CAMERA.height, CAMERA.width), np.nan)
    depth[low_row:high_row] = depth_m
    return result(depth, farther_m=farther_m)


@pytest.mark.parametrize(
    ("rows", "seen"), [((98, 104), True), ((84, 90), False), ((134, 140), False), ((124, 130), True)]
)
def test_the_corridor_is_as_high_above_as_below_only_where_both_are_the_same(rows, seen):
    """10 m away, 190.7 px of focal length: 15.5 to 21.5 rows over the middle are 0.8 to 1.1 m, 29.5 and on 1.5 m."""
    settings = ObstacleSettings(above_m=1.4, below_m=0.7)
    assert np.isfinite(looked(band(*rows, 10.0), settings=settings).obstacle_m[0]) == seen


@pytest.mark.parametrize(("known", "told"), [(slice(0, 120), FREE), (slice(120, 240), UNKNOWN)])
def test_rays_count_for_clear_where_their_side_of_the_corridor_reaches_as_far(known, told):
    """8 m above and 0.3 m below: what looks up stays within it for long, what looks down leaves it soon."""
    far = np.full((CAMERA.height, CAMERA.width), np.nan)
    far[known] = 90.0
    settings = ObstacleSettings(above_m=8.0, below_m=0.3)
    assert cm(looked(result(far), settings=settings))[0] == told


def test_both_edges_of_the_view_see_half_a_sector():
    found = looked(result(wall(camera_attitude(), 10.0)))
    assert found.obstacle_m[8] == pytest.approx(found.obstacle_m[-8], rel=0.01)
    assert found.obstacle_m[8] == pytest.approx(10 / math.cos(math.radians(37.5)), rel=NEAR)


@pytest.mark.parametrize(("speed_m_s", "known"), [(0.29, False), (0.31, True)])
def test_a_velocity_tells_the_way_from_a_foot_a_second_on(speed_m_s, known):
    found = looked(result(wall(camera_attitude(), 10.0)), velocity=(0.0, speed_m_s, 0.0))
    assert np.isfinite(found.obstacle_m[0]) == known


def test_displacements_whose_direction_is_known_need_no_velocity():
    """A drone that just stopped after 1 m to the right; and one told to fly ahead, whose pictures know better."""
    moved = replace(result(wall(camera_attitude(), 10.0)), moved_m=np.array([[1.0, 0.0, 0.0]]))
    assert looked(moved, velocity=(0.0, 0.0, 0.0)).obstacle_m[0] == pytest.approx(10.0, rel=NEAR)
    free = replace(nothing(90.0), moved_m=np.array([[1.0, 0.0, 0.0]]))
    assert cm(looked(free, velocity=(4.0, 0.0, 0.0)))[0] == FREE
    ahead = replace(nothing(90.0), moved_m=np.array([[0.0, 0.0, 1.0]]))
    assert cm(looked(ahead))[0] == UNKNOWN


def test_confidence_0_is_never_used_whatever_is_asked():
    settings = ObstacleSettings(least_confidence=0.0, hit_confidence=0.0)
    for depth in (wall(camera_attitude(), 10.0), np.full((CAMERA.height, CAMERA.width), 90.0)):
        assert cm(looked(result(depth, confidence=0.0), settings=settings))[0] == UNKNOWN
        assert cm(looked(result(depth, confidence=0.01), settings=settings))[0] != UNKNOWN


def test_what_just_has_the_confidence_asked_for_counts():
    found = looked(result(wall(camera_attitude(), 10.0), confidence=0.25))
    assert cm(found)[0] == pytest.approx(1000, abs=2)
    far = np.full((CAMERA.height, CAMERA.width), 90.0)
    assert cm(looked(result(far, confidence=0.5)))[0] == FREE
    assert cm(looked(result(far, confidence=0.49)))[0] == UNKNOWN
    assert cm(looked(result(wall(camera_attitude(), 10.0), confidence=0.24)))[0] == UNKNOWN


def test_bounds_are_horizontal_too():
    """25 m along the axis are 25 / cos(angle) along the ground, less in no direction: the least of each sector."""
    values = cm(looked(nothing(25.0)))
    for sector in (-6, -3, 3, 6):
        least = 2500 / math.cos(math.radians(abs(sector) * 5 - 2.5))
        assert least - 1 <= values[sector] <= least * 1.012
    pitched = camera_attitude(pitch=-25)
    assert cm(looked(nothing(25.0), pitched))[0] == pytest.approx(2500 / math.cos(math.radians(25)), rel=0.02)


def test_the_order_of_the_ranges_does_not_matter():
    sight = Sight(SIGHT.focal_px, least_depth_per_m=5.0)
    nowhere = np.full((CAMERA.height, CAMERA.width), np.nan)
    for depth in (wall(camera_attitude(), 10.0), nowhere):
        one, other = (
            looked(
                result(depth, farther_m=90.0, displacements_m=lengths), velocity=(4.0, 0.0, 0.0), sight=sight
            )
            for lengths in ((0.2, 1.0, 6.0), (6.0, 0.2, 1.0))
        )
        np.testing.assert_array_equal(one.obstacle_m, other.obstacle_m)
        np.testing.assert_array_equal(one.clear_m, other.clear_m)


def test_an_obstacle_of_little_confidence_was_seen_by_the_range_that_can():
    """The shortest, 0.02 m, sees nothing beyond 4 m."""
    seen = result(wall(camera_attitude(), 10.0), confidence=0.3, displacements_m=(0.02, 1.0))
    assert looked(seen).obstacle_m[0] == pytest.approx(10.0, rel=NEAR)


def test_what_lies_beyond_the_reach_is_no_obstacle():
    found = looked(result(wall(camera_attitude(), 41.4)))
    assert found.obstacle_m[0] == pytest.approx(41.4, rel=NEAR)  # 40 m, and 3 m/s for half a second
    assert np.isnan(looked(result(wall(camera_attitude(), 41.6))).obstacle_m[0])


def test_the_nearest_of_a_sector_is_told_whatever_stands_behind_it():
    """Also where the farther lies in rows that come first."""
    depth = wall(camera_attitude(), 30.0)
    depth[118:130, 150:170] = 9.0
    assert looked(result(depth)).obstacle_m[0] == pytest.approx(9.0, rel=NEAR)
    assert looked(result(depth[::-1].copy())).obstacle_m[0] == pytest.approx(9.0, rel=NEAR)


def ray_ends(hit_m, leaves_m=math.inf):
    """Of rays in one degree that say nothing of what is clear."""
    n = len(hit_m)
    return _Ends(
        degree=np.zeros(n, np.intp),
        hit_m=np.array(hit_m),
        clear_m=np.zeros(n),
        leaves_m=np.broadcast_to(leaves_m, n),
    )


def test_an_obstacle_is_where_enough_rays_of_those_still_in_the_corridor_have_hit():
    """Of 100 rays 3 make one; farther on, where 40 are left, 2 do (1.2, rounded up)."""
    far = [math.inf] * 97
    assert _nearest(ray_ends([12.0, 11.0, 10.0, *far]), 40.0, 0.03).tolist() == [0]
    assert not len(_nearest(ray_ends([12.0, 11.0, math.inf, *far]), 40.0, 0.03))
    leaving = np.where(np.arange(100) < 40, math.inf, 20.0)
    assert _nearest(ray_ends([25.0, 21.0, math.inf, *far], leaving), 40.0, 0.03).tolist() == [0]
    assert not len(_nearest(ray_ends([25.0, math.inf, math.inf, *far], leaving), 40.0, 0.03))
    assert _nearest(ray_ends([10.0]), 40.0, 0.03).tolist() == [0]  # one of one


@hypothesis_settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), share=st.sampled_from([0.03, 0.2, 0.5]))
def test_the_nearest_of_each_sector_is_as_counted_one_by_one(seed, share):
    rng = np.random.default_rng(seed)
    n = 400
    some = _Ends(
        degree=rng.integers(0, 30, n),
        hit_m=np.where(rng.random(n) < 0.4, rng.uniform(1, 50, n), np.inf),
        clear_m=np.zeros(n),
        leaves_m=np.where(rng.random(n) < 0.3, np.inf, rng.uniform(1, 60, n)),
    )
    wanted = []
    for sector in range(6):
        within = np.flatnonzero(some.degree // 5 == sector)
        for place in within[np.argsort(some.hit_m[within])]:
            met = (some.hit_m[within] <= some.hit_m[place]).sum()
            if some.hit_m[place] <= 40 and met >= max(
                1, share * (some.leaves_m[within] >= some.hit_m[place]).sum()
            ):
                wanted.append(place)
                break
    assert _nearest(some, 40.0, share).tolist() == wanted


@pytest.mark.parametrize(("unknown", "clear_m"), [(2, 40.0), (3, 0.0)])
def test_a_degree_is_clear_where_seven_in_ten_of_its_rays_say_so(unknown, clear_m):
    """Of nine, seven: two may say nothing."""
    said = np.where(np.arange(9) < unknown, 0.0, 90.0)
    told = replace(ray_ends([math.inf] * 9), clear_m=said)
    assert _clear(told, 40.0, 0.7).tolist() == [clear_m] + [0.0] * 359
    assert not _clear(replace(told, leaves_m=np.full(9, 39.0)), 40.0, 0.7).any()


def test_a_large_picture_says_what_a_small_one_does():
    """Of its pixels not each is looked at: a wall, a ball to the right, something below the corridor to the left."""
    found = []
    for times in (1, 4):
        camera = Camera.from_fov(320 * times, 240 * times, 80)
        depth = wall(camera_attitude(), 20.0, camera=camera)
        depth[118 * times : 130 * times, 204 * times : 217 * times] = 9.0
        depth[200 * times : 220 * times, 60 * times : 80 * times] = 9.0
        found.append(looked(result(depth), camera=camera))
    small, large = found
    assert small.obstacle_m[3] == pytest.approx(9.0 / math.cos(math.radians(14)), rel=0.03)
    assert small.obstacle_m[-5] > 19
    np.testing.assert_allclose(large.obstacle_m, small.obstacle_m, rtol=0.01)
    np.testing.assert_array_equal(large.clear_m > 0, small.clear_m > 0)


def test_what_each_ray_says_is_horizontal():
    """Of a surface 10 m along the axis, seen 20 degrees down and rolled: its point, where it leaves the corridor."""
    attitude = camera_attitude(roll=15, pitch=-20, yaw=-70)
    settings = ObstacleSettings(above_m=1.2, below_m=0.8)
    depth = result(np.full((CAMERA.height, CAMERA.width), 10.0))
    pose = Pose.of(attitude, math.radians(30), np.array([2.8, 1.0, 0.0]))  # to its right
    found = _ends(rays_of(depth, CAMERA, pose, SIGHT, settings), settings, STILL)
    forward, right, down = 10.0 * CAMERA.rays()[::4].reshape(-1, 3).T  # each fourth row is looked at
    forward, right, down = pose.level_from_camera @ (forward, right, down)
    along = np.hypot(forward, right)
    inside = (down >= -1.2) & (down <= 0.8)
    np.testing.assert_allclose(found.hit_m, np.where(inside, along, np.inf), rtol=1e-5)
    np.testing.assert_allclose(found.clear_m, along, rtol=1e-5)
    leaves_m = along * np.where(down > 0, 0.8, 1.2) / abs(down)
    near = leaves_m < 1000  # beyond, float32 has too few digits for how little such a ray climbs
    np.testing.assert_allclose(found.leaves_m[near], leaves_m[near], rtol=1e-4)
    assert near.mean() > 0.99 and found.leaves_m[~near].min() > 990
    azimuth_deg = np.degrees(np.arctan2(right, forward))
    np.testing.assert_array_equal(found.degree, np.floor(azimuth_deg + 2.5) % 360)
    assert 0 < inside.mean() < 1 and found.degree.min() >= 0


@pytest.mark.parametrize(("displacement_m", "told"), [(0.26, FREE), (0.22, UNKNOWN)])
def test_beside_the_axis_as_much_is_seen_as_the_ground_is_long(displacement_m, told):
    """0.26 m sideways, 30 degrees off the axis: up to 200 px * 0.26 m * cos(30) = 45 m; 0.22 m: 38 m of 41.5."""
    nowhere = np.full((CAMERA.height, CAMERA.width), np.nan)
    values = cm(looked(result(nowhere, farther_m=90.0, displacements_m=(displacement_m,))))
    assert values[6] == values[-6] == told


# Settings, sight, pose


@pytest.mark.parametrize(
    "extreme",
    [{"max_m": 650.0}, {"min_m": 39.9}, {"known_share": 0.0, "hit_share": 0.0}, {"least_confidence": 1.0}],
)
def test_settings_that_just_can_be(extreme):
    assert ObstacleSettings(**extreme)


@pytest.mark.parametrize(
    "bad",
    [
        {"min_m": 40.0},
        {"above_m": 0.0},
        {"above_m": math.nan},
        {"least_confidence": 1.1},
        {"hit_confidence": -0.1},
        {"hit_share": -0.1},
        {"known_share": 1.1},
    ],
)
def test_settings_that_just_can_not_be(bad):
    with pytest.raises(BadInput):
        ObstacleSettings(**bad)


@pytest.mark.parametrize(
    ("height_m", "below_m"),
    [
        (None, 1.5),
        (math.nan, 1.5),
        (math.inf, 1.5),
        (9.0, 1.5),
        (2.0, 1.5),
        (1.9, 1.4),
        (0.8, 0.3),
        (0.1, 0.3),
    ],
)
def test_the_corridor_ends_half_a_metre_above_the_ground_and_below_the_drones_body(height_m, below_m):
    assert SETTINGS.over_ground(height_m).below_m == pytest.approx(below_m)


def test_what_a_network_sees_nearest_follows_its_lens():
    """100 m at 0.3 m of displacement through 64 px; through 128 px half of that."""
    card = swept_card(64.0)
    one, other = Sight.of(card, 64.0), Sight.of(card, 128.0)
    assert (one.focal_px, other.focal_px) == (64.0, 128.0)
    assert one.least_depth_per_m == pytest.approx(ends(card)[0] * 100.0 / 0.3)
    assert other.least_depth_per_m == pytest.approx(2 * one.least_depth_per_m)


def test_a_pose_turns_the_velocity_with_the_nose():
    """Flying east with the nose to the east is flying ahead; heading south, to the left."""
    for heading_deg, told in ((90, (3.0, 0.0, 1.0)), (180, (0.0, -3.0, 1.0))):
        pose = Pose.of(camera_attitude(), math.radians(heading_deg), np.array([0.0, 3.0, 1.0]))
        assert pose.velocity_level == pytest.approx(told, abs=1e-12)


@pytest.mark.parametrize("short", ["obstacle_m", "clear_m"])
def test_sectors_are_72(short):
    whole = Sectors.unknown()
    with pytest.raises(ValueError, match="72 sectors"):
        replace(whole, **{short: getattr(whole, short)[:71]})
