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
from flightdepth.live.obstacles import (
    LEAST_PARALLAX_PX,
    SECTORS,
    ObstacleSettings,
    Sight,
    heading_rad,
)
from flightdepth.motion import quaternion_from_rotation, rotation_from_euler
from flightdepth.ranges.result import RangedDepth

FREE = 4001  # max_distance + 1
INNER = range(-6, 7)  # whole sectors within 80 degrees: up to 32.5 off the axis
NEAR = 0.02


def cm(sectors, age_s=0.0, settings=SETTINGS):
    return distances_cm(sectors, age_s, settings).astype(int)


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


def test_age_costs_the_way_flown():
    found = looked(result(wall(camera_attitude(), 10.0)))
    assert cm(found, 0.0)[0] - cm(found, 0.3)[0] == pytest.approx(90, abs=1)  # 3 m/s


def test_free_is_not_free_when_it_is_too_old():
    found = looked(nothing(60.0))
    assert cm(found, SETTINGS.stale_s)[0] == FREE
    assert cm(found, SETTINGS.stale_s + 0.5)[0] < FREE


def test_touching_is_the_least_distance_never_zero():
    found = looked(result(wall(camera_attitude(), 0.2)))
    assert cm(found)[0] == 100
    assert cm(found, 10.0)[0] == 100


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
