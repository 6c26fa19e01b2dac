from dataclasses import replace

import cv2
import numpy as np
import pytest
from range_oracle import (
    CAMERA,
    CLAMPED,
    FRAME_NS,
    Oracle,
    card,
    fly,
    ground_and_sky,
    picture,
    straight,
    two_walls,
    wall,
)

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.flight.steadiness import MAX_DEROTATED_RAD, MAX_REPORTED_RAD, MAX_TURN_RAD
from flightdepth.motion import NED_FROM_CAMERA, quaternion_from_rotation, rotation_from_euler
from flightdepth.ranges import MultiRangeEstimator, RangedDepth
from flightdepth.ranges.pairs import MAX_FRAMES
from flightdepth.ranges.plan import SCOUT_EVERY_S

SIDEWAYS = (3.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def over_two_walls() -> RangedDepth:
    """The last of 120 frames."""
    oracle = Oracle(two_walls(12.0, 90.0), straight(SIDEWAYS))
    return fly(MultiRangeEstimator(oracle, CAMERA, ranges=2), SIDEWAYS, range(120))[-1]


def test_a_flight_over_two_walls_converges_to_their_depths(over_two_walls) -> None:
    result = over_two_walls
    np.testing.assert_allclose(result.depth_m[:, :60], 12.0, rtol=1e-4)
    np.testing.assert_allclose(result.depth_m[:, 68:], 90.0, rtol=1e-4)
    np.testing.assert_allclose(result.centroids_m, [12.0, 90.0], rtol=0.05)
    assert result.confidence[:, :60].min() > 0.8
    assert result.confidence[:, 68:].min() > 0.8


def test_displacements_used_are_those_wanted_to_half_a_frame(over_two_walls) -> None:
    wanted = over_two_walls.centroids_m / (CLAMPED.alpha * 0.4)
    assert np.abs(over_two_walls.displacements_m - wanted).max() <= 3.0 * FRAME_NS * 1e-9 / 2 + 1e-9


def test_forward_flight_to_a_wall_keeps_its_depth_right() -> None:
    forward = (0.0, 0.0, 4.0)
    oracle = Oracle(wall(60.0), straight(forward))
    results = fly(MultiRangeEstimator(oracle, CAMERA, ranges=1), forward, range(300))
    for index in range(60, 300):
        truth = 60.0 - straight(forward)(index)[2]
        np.testing.assert_allclose(results[index].depth_m, truth, rtol=1e-4)


@pytest.fixture(scope="module")
def over_ground_under_a_sky() -> tuple[Oracle, list[RangedDepth]]:
    """300 frames; what the network was asked, and all that was told."""
    oracle = Oracle(ground_and_sky(10.0), straight(SIDEWAYS))
    return oracle, fly(MultiRangeEstimator(oracle, CAMERA, ranges=2), SIDEWAYS, range(300))


def test_the_sky_does_not_drag_the_far_displacement(over_ground_under_a_sky) -> None:
    _, results = over_ground_under_a_sky
    longest = [result.displacements_m[~np.isnan(result.centroids_m)].max() for result in results[60:]]
    # The near quarter of the picture bounds the displacement: a quarter of the picture at its depth.
    near = np.quantile(ground_and_sky(10.0)(np.zeros(3), CAMERA.resized(32, 32)), 0.25, method="lower")
    assert max(longest) <= 0.25 * 2 * near + 3.0 * FRAME_NS * 1e-9 / 2


def test_the_sky_is_unknown_with_a_bound_not_a_wall(over_ground_under_a_sky) -> None:
    _, results = over_ground_under_a_sky
    for result in results[60:]:
        sky = np.s_[:60]
        assert np.isnan(result.depth_m[sky]).all()
        assert (result.confidence[sky] == 0).all()
        assert (result.farther_than_m[sky] > 30).all()
        assert np.isfinite(result.depth_m[80:]).mean() > 0.95


def test_the_papers_fusion_makes_a_wall_of_the_sky() -> None:
    oracle = Oracle(ground_and_sky(10.0), straight(SIDEWAYS))
    result = fly(MultiRangeEstimator(oracle, CAMERA, ranges=2, fusion="paper"), SIDEWAYS, range(90))[-1]
    assert np.isfinite(result.depth_m[:60]).all()


def test_ground_depth_is_right_wherever_it_is_known() -> None:
    oracle = Oracle(ground_and_sky(10.0), straight(SIDEWAYS))
    result = fly(MultiRangeEstimator(oracle, CAMERA, ranges=3), SIDEWAYS, range(120))[-1]
    truth = ground_and_sky(10.0)(np.zeros(3), CAMERA)[100:-4]
    np.testing.assert_allclose(result.depth_m[100:-4], truth, rtol=0.02)


def test_things_beyond_every_range_are_found_by_scouts() -> None:
    # A tenth of the picture is near from the first pair on; its cluster alone would never look at 150 m.
    def near_strip(position, camera):
        return np.broadcast_to(
            np.where(np.arange(camera.height) < camera.height / 10, 6.0, 150.0), (32, 32)
        ).T

    oracle = Oracle(near_strip, straight(SIDEWAYS))
    result = fly(MultiRangeEstimator(oracle, CAMERA, ranges=2), SIDEWAYS, range(150))[-1]
    np.testing.assert_allclose(result.depth_m[40:], 150.0, rtol=1e-4)


def test_a_thing_too_near_is_found_by_a_scout() -> None:
    # Everything at 80 m; from frame 100 on an eighth is 3 m off, nearer than the pair in use can see.
    def popping_up(position, camera):
        near = 3.0 if position[0] > 100 * 3 * FRAME_NS * 1e-9 else 80.0
        return np.broadcast_to(np.where(np.arange(32) < 4, near, 80.0), (32, 32))

    oracle = Oracle(popping_up, straight(SIDEWAYS))
    results = fly(MultiRangeEstimator(oracle, CAMERA, ranges=1), SIDEWAYS, range(140))
    soon = 102 + 3 * int(SCOUT_EVERY_S * 1e9 / FRAME_NS + 1)  # 37 m, 8 m, 2 m: "at most" after each scout
    assert any(np.allclose(result.depth_m[:, :12], 3.0, rtol=1e-3) for result in results[101:soon])


def test_scouts_come_no_more_often_than_stated(over_ground_under_a_sky) -> None:
    oracle, _ = over_ground_under_a_sky
    scouted = sum(len(batch) > 2 for batch in oracle.batches)
    assert 0 < scouted <= 300 * FRAME_NS * 1e-9 / SCOUT_EVERY_S + 1


def test_scaling_scene_and_speed_scales_the_depth() -> None:
    one = fly(
        MultiRangeEstimator(Oracle(two_walls(12, 90), straight(SIDEWAYS)), CAMERA), SIDEWAYS, range(100)
    )[-1]
    faster = (9.0, 0.0, 0.0)
    three = fly(
        MultiRangeEstimator(Oracle(two_walls(36, 270), straight(faster)), CAMERA), faster, range(100)
    )[-1]
    np.testing.assert_allclose(three.depth_m, 3 * one.depth_m, rtol=1e-4)
    np.testing.assert_array_equal(three.shifts, one.shifts)


def test_a_wrong_speed_gives_a_proportionally_wrong_depth() -> None:
    oracle = Oracle(wall(40.0), straight(SIDEWAYS))
    told = (3.3, 0.0, 0.0)
    result = fly(MultiRangeEstimator(oracle, CAMERA, ranges=1), told, range(100))[-1]
    np.testing.assert_allclose(result.depth_m, 44.0, rtol=1e-4)


def test_one_range_reproduces_the_single_shift_equation() -> None:
    oracle = Oracle(two_walls(20.0, 40.0), straight(SIDEWAYS), card())
    last, result = fly(MultiRangeEstimator(oracle, CAMERA, ranges=1, fusion="paper"), SIDEWAYS, range(80))[
        -2:
    ]
    mean_m = 30.0
    np.testing.assert_allclose(result.centroids_m, [mean_m], rtol=0.01)
    optimal = mean_m / (100 / 0.3 * 0.4)
    available = 3.0 * FRAME_NS * 1e-9 * np.arange(1, 60)
    np.testing.assert_allclose(
        result.displacements_m, [available[np.abs(available - optimal).argmin()]], rtol=1e-9
    )
    assert last.reason is None


@pytest.mark.parametrize("ranges", [1, 2, 3, 4])
def test_pairs_are_distinct_and_shortest_first(ranges: int) -> None:
    oracle = Oracle(ground_and_sky(10.0), straight(SIDEWAYS))
    for result in fly(MultiRangeEstimator(oracle, CAMERA, ranges=ranges), SIDEWAYS, range(60))[1:]:
        assert (np.diff(result.shifts) > 0).all()
        assert 1 <= len(result.shifts) <= ranges + 1


def test_equal_shifts_are_merged() -> None:
    oracle = Oracle(wall(40.0), straight(SIDEWAYS))
    result = fly(MultiRangeEstimator(oracle, CAMERA, ranges=4), SIDEWAYS, range(100))[-1]
    assert len(result.shifts) == len(result.displacements_m) == len(result.range_depths_m) == 1


def test_the_source_size_comes_back_from_another_lens() -> None:
    camera = Camera.from_fov(854, 480, 64.4)
    oracle = Oracle(wall(40.0), straight(SIDEWAYS))
    result = fly(MultiRangeEstimator(oracle, camera, ranges=2), SIDEWAYS, range(60), camera)[-1]
    assert result.depth_m.shape == result.confidence.shape == result.farther_than_m.shape == (480, 854)
    np.testing.assert_allclose(result.depth_m, 40.0, rtol=1e-4)


def test_the_first_frame_has_no_depth_and_says_why() -> None:
    result = fly(MultiRangeEstimator(Oracle(wall(40), straight(SIDEWAYS)), CAMERA), SIDEWAYS, range(1))[0]
    assert result.reason == "first frame: no earlier one to pair it with"
    assert np.isnan(result.depth_m).all()
    assert (result.confidence == 0).all()
    assert np.isnan(result.farther_than_m).all()


def test_a_frame_in_seconds_is_refused_and_not_kept() -> None:
    estimator = MultiRangeEstimator(Oracle(wall(40), straight(SIDEWAYS)), CAMERA)
    with pytest.raises(BadInput, match="whole nanoseconds"):
        estimator.add_frame(0.04, picture(0))  # type: ignore[arg-type]
    result = estimator.add_frame(0, picture(1))
    assert result.reason is not None and "dropped" not in result.reason


def test_without_motion_there_is_no_depth() -> None:
    estimator = MultiRangeEstimator(Oracle(wall(40), straight(SIDEWAYS)), CAMERA)
    results = [estimator.add_frame(i * FRAME_NS, picture(i)) for i in range(5)]
    assert {result.reason for result in results} == {
        "no motion known: no velocity or pose near this frame's time"
    }


def test_hovering_is_unknown_not_far() -> None:
    still = (0.02, 0.0, 0.0)
    result = fly(MultiRangeEstimator(Oracle(wall(40), straight(still)), CAMERA), still, range(90))[-1]
    assert result.reason is not None
    assert result.reason.startswith("hovering: flown 0.06 m in 2.97 s")
    assert np.isnan(result.farther_than_m).all()


def test_speed_below_its_own_noise_is_hovering() -> None:
    estimator = MultiRangeEstimator(Oracle(wall(40), straight((0.5, 0, 0))), CAMERA)
    for i in range(30):
        estimator.add_velocity(i * FRAME_NS, (0.5, 0, 0), sigma=0.2)
        result = estimator.add_frame(i * FRAME_NS, picture(i))
    assert result.reason == "hovering: flown 0.48 m in 0.97 s, no more than the log's velocities may err"


def test_depth_returns_after_a_hover() -> None:
    # 1 s at 3 m/s, then still: pairs across the flight remain for as long as the buffer holds them.
    moved = 30
    position = lambda index: np.array([3.0, 0, 0]) * (min(index, moved) * FRAME_NS * 1e-9)  # noqa: E731
    estimator = MultiRangeEstimator(Oracle(wall(40), position), CAMERA, buffer_s=2.0)
    results = []
    for i in range(150):
        estimator.add_velocity(i * FRAME_NS, SIDEWAYS if i < moved else (0, 0, 0))
        results.append(estimator.add_frame(i * FRAME_NS, picture(i)))
    assert results[moved + 30].reason is None
    assert results[-1].reason is not None
    assert results[-1].reason.startswith("hovering")


def test_a_gap_in_the_velocity_is_named() -> None:
    estimator = MultiRangeEstimator(Oracle(wall(40), straight(SIDEWAYS)), CAMERA)
    fly(estimator, SIDEWAYS, range(30))
    silent = [estimator.add_frame(i * FRAME_NS, picture(i)) for i in range(30, 90)]
    assert silent[0].reason is None  # held
    assert silent[20].reason == "no motion known: no velocity or pose near this frame's time"
    after = fly(estimator, SIDEWAYS, range(90, 92))
    assert after[0].reason == "gap in the motion: no earlier frame is connected to this one"
    assert after[1].reason is None


@pytest.mark.parametrize("stamp", [9, 10])
def test_frames_that_do_not_advance_are_dropped_and_counted(stamp: int) -> None:
    oracle = Oracle(wall(40), straight(SIDEWAYS))
    estimator = MultiRangeEstimator(oracle, CAMERA)
    fly(estimator, SIDEWAYS, range(11))
    batches = len(oracle.batches)
    result = estimator.add_frame(stamp * FRAME_NS, picture(stamp))
    assert result.reason == f"dropped: stamp {stamp * FRAME_NS} is not after {10 * FRAME_NS}"
    assert estimator.dropped == {"frame not after the one before": 1}
    assert len(oracle.batches) == batches


def test_a_dropped_frame_changes_nothing() -> None:
    plain = MultiRangeEstimator(Oracle(wall(40), straight(SIDEWAYS)), CAMERA)
    disturbed = MultiRangeEstimator(Oracle(wall(40), straight(SIDEWAYS)), CAMERA)
    fly(plain, SIDEWAYS, range(40))
    fly(disturbed, SIDEWAYS, range(40))
    disturbed.add_frame(3 * FRAME_NS, picture(3))
    expected = fly(plain, SIDEWAYS, range(40, 41))[0]
    np.testing.assert_array_equal(fly(disturbed, SIDEWAYS, range(40, 41))[0].depth_m, expected.depth_m)


def test_an_unusable_frame_ends_the_history_of_an_unknown_attitude() -> None:
    estimator = MultiRangeEstimator(Oracle(wall(40), straight(SIDEWAYS)), CAMERA)
    fly(estimator, SIDEWAYS, range(30))
    result = estimator.add_frame(30 * FRAME_NS, picture(30), unusable="turning 0.9 rad/s")
    assert result.reason == "turning 0.9 rad/s"
    assert fly(estimator, SIDEWAYS, range(31, 32))[0].reason == "first frame: no earlier one to pair it with"


def test_an_unusable_frame_keeps_the_history_of_a_known_attitude() -> None:
    estimator = MultiRangeEstimator(Oracle(wall(40), straight(SIDEWAYS)), CAMERA)
    for i in range(35):
        estimator.add_attitude(i * FRAME_NS, (1, 0, 0, 0))
    fly(estimator, SIDEWAYS, range(30))
    estimator.add_frame(30 * FRAME_NS, picture(30), unusable="turning 0.9 rad/s")
    assert fly(estimator, SIDEWAYS, range(31, 32))[0].reason is None


def test_poses_replace_velocities() -> None:
    estimator = MultiRangeEstimator(Oracle(wall(40), straight(SIDEWAYS)), CAMERA, ranges=1)
    for i in range(60):
        pose = np.eye(4)
        pose[:3, 3] = straight(SIDEWAYS)(i)
        estimator.add_pose(i * FRAME_NS, pose)
        estimator.add_velocity(i * FRAME_NS, (50.0, 0, 0))
        result = estimator.add_frame(i * FRAME_NS, picture(i))
    np.testing.assert_allclose(result.depth_m, 40.0, rtol=1e-4)


def test_no_depth_comes_from_a_jump_of_poses() -> None:
    """Found in review: the displacement over a loop closure of 3 m was believed, and depth with it."""
    estimator = MultiRangeEstimator(Oracle(wall(40), straight(SIDEWAYS)), CAMERA, ranges=1)
    results = []
    for i in range(60):
        pose = np.eye(4)
        pose[:3, 3] = straight(SIDEWAYS)(i) + (3.0 if i >= 30 else 0.0)
        estimator.add_pose(i * FRAME_NS, pose)
        results.append(estimator.add_frame(i * FRAME_NS, picture(i)))
    known = [np.isfinite(result.depth_m).all() for result in results]
    assert all(known[20:30])
    assert all(known[50:])
    for depth_m in (result.depth_m[np.isfinite(result.depth_m)] for result in results):
        np.testing.assert_allclose(depth_m, 40.0, rtol=1e-4)
    assert estimator.dropped == {"way between two poses: a jump": 1}


def test_the_displacement_is_given_in_the_cameras_orientation() -> None:
    # The camera is yawed by 90 degrees: its z axis is world x (rotation about the camera's y, "down").
    world_from_camera = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    oracle = Oracle(wall(40), straight(SIDEWAYS))
    estimator = MultiRangeEstimator(oracle, CAMERA)
    for i in range(10):
        estimator.add_attitude(i * FRAME_NS, quaternion_from_rotation(world_from_camera))
    fly(estimator, SIDEWAYS, range(10))
    directions = oracle.displacements[-1] / np.linalg.norm(oracle.displacements[-1], axis=1, keepdims=True)
    np.testing.assert_allclose(directions, np.tile([0.0, 0, 1], (len(directions), 1)), atol=1e-9)


def test_a_camera_frame_velocity_without_attitude_is_noted() -> None:
    estimator = MultiRangeEstimator(Oracle(wall(40), straight(SIDEWAYS)), CAMERA)
    for i in range(5):
        estimator.add_velocity(i * FRAME_NS, SIDEWAYS, frame="camera")
        result = estimator.add_frame(i * FRAME_NS, picture(i))
    assert result.notes == ("camera-frame velocity without attitude: the camera is taken not to turn",)


def test_world_velocities_need_no_note() -> None:
    estimator = MultiRangeEstimator(Oracle(wall(40), straight(SIDEWAYS)), CAMERA)
    assert fly(estimator, SIDEWAYS, range(5))[-1].notes == ()


def test_a_turned_away_camera_is_named() -> None:
    estimator = MultiRangeEstimator(Oracle(wall(40), straight(SIDEWAYS)), CAMERA)
    for i in range(4):
        q = quaternion_from_rotation(rotation_from_euler(0, 0.6 * i, 0))
        estimator.add_attitude(i * FRAME_NS, q)
    result = fly(estimator, SIDEWAYS, range(4))[-1]
    assert result.reason == "the camera turned away from all that earlier frames saw"


def test_what_a_turn_brought_into_view_is_unknown() -> None:
    estimator = MultiRangeEstimator(Oracle(wall(40), straight(SIDEWAYS)), CAMERA, ranges=1)
    for i in range(60):
        # The camera turns right by 0.2 rad at frame 59: what enters at the right was never seen.
        angle = 0.2 if i == 59 else 0.0
        turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
        estimator.add_attitude(i * FRAME_NS, quaternion_from_rotation(turn))
    result = fly(estimator, SIDEWAYS, range(60))[-1]
    assert np.isnan(result.depth_m[:, -10:]).all()
    # The oracle's wall turns with the camera, so that what is averaged with the frames before is not 40 m.
    assert np.isfinite(result.depth_m[64, :90]).all()
    np.testing.assert_allclose(result.range_depths_m, 40.0, rtol=1e-4)


def test_memory_is_bounded() -> None:
    estimator = MultiRangeEstimator(Oracle(wall(40), straight(SIDEWAYS)), CAMERA, ranges=1)
    for i in range(1201):  # the last one is a frame
        stamp = i * 4_000_000  # 250 velocities/s, 83 frames/s
        estimator.add_velocity(stamp, SIDEWAYS)
        if i % 3 == 0:
            estimator.add_frame(stamp, picture(i))
    assert len(estimator._buffer.frames) <= MAX_FRAMES
    assert len(estimator._trajectory._velocities) <= 4.0 / 0.004 + 2
    frames = estimator._buffer.frames
    assert frames[-1].stamp_ns - frames[0].stamp_ns > 3.9e9


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"ranges": 0}, "ranges: expected 1 to 4, got 0"),
        ({"ranges": 5}, "ranges: expected 1 to 4, got 5"),
        ({"fusion": "mean"}, "fusion: expected saturation or paper, got 'mean'"),
        ({"buffer_s": 0}, "buffer: expected more than 0 seconds, got 0"),
        ({"buffer_s": float("nan")}, "buffer: expected more than 0 seconds, got nan"),
        ({"buffer_s": 1e300}, "buffer: expected at most 3600 seconds, got 1e+300"),
        ({"ranges": 2.5}, "ranges: expected 1 to 4, got 2.5"),
        ({"turns": 0}, "turns: expected 1, 2, ..., got 0"),
        ({"turns": 1.5}, "turns: expected 1, 2, ..., got 1.5"),
        ({"turns": float("nan")}, "turns: expected 1, 2, ..., got nan"),
    ],
)
def test_bad_options_are_named(options: dict, message: str) -> None:
    with pytest.raises(BadInput) as error:
        MultiRangeEstimator(Oracle(wall(40), straight(SIDEWAYS)), CAMERA, **options)
    assert str(error.value) == message


def test_a_frame_of_another_size_is_refused() -> None:
    estimator = MultiRangeEstimator(Oracle(wall(40), straight(SIDEWAYS)), CAMERA)
    with pytest.raises(BadInput, match="128, 128, 3"):
        estimator.add_frame(0, np.zeros((10, 10, 3), dtype=np.uint8))


def test_outside_a_wide_lens_nothing_is_claimed() -> None:
    # A fisheye sees beyond what the pinhole of the network can show: no depth there, no confidence either.
    camera = Camera(256, 256, 80, 80, 127.5, 127.5, (0.0, 0.0, 0.0, 0.0), "fisheye")
    oracle = Oracle(wall(40.0), straight(SIDEWAYS))
    result = fly(MultiRangeEstimator(oracle, camera, ranges=1), SIDEWAYS, range(40), camera)[-1]
    unknown = np.isnan(result.depth_m)
    assert 0 < unknown.sum() < unknown.size
    np.testing.assert_array_equal(result.confidence == 0, unknown)


@pytest.mark.parametrize("distortion", [(), (-0.3, 0.1, 0.0, 0.0)])
def test_depth_and_bounds_exclude_each_other(distortion: tuple[float, ...]) -> None:
    camera = replace(Camera.from_fov(300, 200, 80), distortion=distortion)
    oracle = Oracle(ground_and_sky(10.0), straight(SIDEWAYS))
    result = fly(MultiRangeEstimator(oracle, camera, ranges=2), SIDEWAYS, range(60), camera)[-1]
    assert not (np.isfinite(result.depth_m) & np.isfinite(result.farther_than_m)).any()
    np.testing.assert_array_equal(result.confidence == 0, np.isnan(result.depth_m))
    assert np.isfinite(result.farther_than_m).mean() > 0.4


def test_the_caller_may_reuse_its_image() -> None:
    oracle = Oracle(wall(40.0), straight(SIDEWAYS))
    estimator = MultiRangeEstimator(oracle, CAMERA, ranges=1)
    image = picture(0)
    for i in range(60):
        image[:] = picture(i)
        estimator.add_velocity(i * FRAME_NS, SIDEWAYS)
        result = estimator.add_frame(i * FRAME_NS, image)
    np.testing.assert_allclose(result.depth_m, 40.0, rtol=1e-4)


def test_a_refused_picture_may_come_again_mended() -> None:
    """Found in review: its stamp was taken as given, so that the mended picture came "not after" itself."""
    estimator = MultiRangeEstimator(Oracle(wall(20.0), straight(SIDEWAYS)), CAMERA, ranges=1)
    fly(estimator, SIDEWAYS, range(10))
    stamp_ns = 10 * FRAME_NS
    with pytest.raises(BadInput, match="uint8 RGB"):
        estimator.add_frame(stamp_ns, picture(10)[..., 0])
    estimator.add_velocity(stamp_ns, SIDEWAYS)
    assert estimator.add_frame(stamp_ns, picture(10)).reason is None
    assert not estimator.dropped


def test_a_camera_that_zooms_drops_its_earlier_pictures() -> None:
    oracle = Oracle(wall(10.0), straight(SIDEWAYS))
    wide, narrow = CAMERA, Camera.from_fov(CAMERA.width, CAMERA.height, 60)
    estimator = MultiRangeEstimator(oracle, wide)
    reasons = []
    for index in range(8):
        estimator.add_velocity(index * FRAME_NS, SIDEWAYS)
        estimator.see_through(wide if index < 4 else narrow)
        reasons.append(estimator.add_frame(index * FRAME_NS, picture(index)).reason)
    assert [reason is None for reason in reasons] == [False, True, True, True, False, True, True, True]


@pytest.mark.parametrize("mask", [None, np.full((CAMERA.height, CAMERA.width), 255, np.uint8)])
def test_a_zoom_that_changes_the_size_is_refused_and_changes_nothing(mask) -> None:
    estimator = MultiRangeEstimator(Oracle(wall(10.0), straight(SIDEWAYS)), CAMERA, mask=mask)
    fly(estimator, SIDEWAYS, range(10))
    with pytest.raises(BadInput, match="camera: expected 128x128, as before, got 256x128"):
        estimator.see_through(Camera.from_fov(256, 128, 60))
    assert fly(estimator, SIDEWAYS, range(10, 12))[-1].reason is None


@pytest.mark.parametrize("kind", [np.uint64, np.uint32, np.int64])
def test_times_may_be_of_any_whole_kind(kind) -> None:
    """Unsigned ones wrapped where something was subtracted: for four seconds there was no earlier frame."""
    estimator = MultiRangeEstimator(Oracle(wall(10.0), straight(SIDEWAYS)), CAMERA)
    for index in range(4):
        stamp_ns = kind(index * FRAME_NS)
        estimator.add_velocity(stamp_ns, SIDEWAYS)
        result = estimator.add_frame(stamp_ns, picture(index))
    np.testing.assert_allclose(result.depth_m, 10.0, rtol=1e-4)


def test_a_first_velocity_that_no_drone_flies_is_left_out() -> None:
    """It was believed: the pair after it was told four times as long as it was."""
    oracle = Oracle(wall(10.0), straight(SIDEWAYS))
    estimator = MultiRangeEstimator(oracle, CAMERA)
    estimator.add_velocity(-1, (300.0, 0.0, 0.0))
    result = fly(estimator, SIDEWAYS, range(5))[-1]
    np.testing.assert_allclose(result.depth_m, 10.0, rtol=1e-4)
    assert estimator.dropped == {"velocity faster than any drone": 1}


def test_shifts_count_all_frames_of_a_fast_camera() -> None:
    """At 100 frames a second one in four is kept."""
    estimator = MultiRangeEstimator(Oracle(wall(10.0), straight(SIDEWAYS)), CAMERA, ranges=1)
    for index in range(100):
        estimator.add_velocity(index * 10**7, SIDEWAYS)
        result = estimator.add_frame(index * 10**7, picture(index))
    np.testing.assert_allclose(result.displacements_m, 0.03 * result.shifts, rtol=1e-6)
    assert result.shifts[0] > 4


@pytest.mark.parametrize(
    ("fusion", "frame", "averaged"),
    [("saturation", "camera", True), ("saturation", "world", False), ("paper", "camera", False)],
)
def test_depth_is_averaged_where_the_way_is_known_but_in_the_papers_fusion(fusion, frame, averaged) -> None:
    """Of a wall that seems a tenth farther away in every second frame; nobody tells the camera's attitude."""

    def flickering(position, camera):
        odd = round(position[0] / (3.0 * FRAME_NS * 1e-9)) % 2
        return np.full((camera.height, camera.width), 44.0 if odd else 40.0)

    oracle, told_m = Oracle(flickering, straight(SIDEWAYS), card()), []
    estimator = MultiRangeEstimator(oracle, CAMERA, ranges=1, fusion=fusion)
    for i in range(10):
        estimator.add_velocity(i * FRAME_NS, SIDEWAYS, frame=frame)
        told_m.append(float(np.median(estimator.add_frame(i * FRAME_NS, picture(i)).depth_m)))
    if averaged:
        assert min(told_m[-2:]) > 41 and max(told_m[-2:]) < 43
    else:
        assert told_m[-2:] == pytest.approx([40, 44], rel=1e-4)


@pytest.mark.parametrize(("degrees", "paired"), [(21.0, True), (24.0, False)])
def test_pairs_may_turn_by_a_quarter_of_the_view(degrees: float, paired: bool) -> None:
    """Of 90 degrees."""
    estimator = MultiRangeEstimator(Oracle(wall(40), straight(SIDEWAYS)), CAMERA, ranges=1)
    for i in range(6):
        turn = rotation_from_euler(0, np.radians(degrees) if i == 5 else 0.0, 0)
        estimator.add_attitude(i * FRAME_NS, quaternion_from_rotation(turn))
    assert (fly(estimator, SIDEWAYS, range(6))[-1].reason is None) == paired


def test_who_derotates_bears_a_larger_turn_and_a_larger_one_still_where_attitudes_tell_it() -> None:
    bears = []
    for derotate in (True, False):
        oracle = Oracle(wall(40), straight(SIDEWAYS))
        estimator = MultiRangeEstimator(oracle, CAMERA, derotate=derotate)
        before = estimator.max_turn_rad(0)
        for at_ns in (0, 10**9):
            estimator.add_attitude(at_ns, (1, 0, 0, 0))
        bears.append([before, *(estimator.max_turn_rad(at_ns) for at_ns in (5 * 10**8, 4 * 10**9))])
    assert bears == [[MAX_DEROTATED_RAD, MAX_REPORTED_RAD, MAX_DEROTATED_RAD], [MAX_TURN_RAD] * 3]


def test_a_map_of_a_lens_before_the_zoom_is_none_at_the_source() -> None:
    estimator = MultiRangeEstimator(Oracle(wall(10.0), straight(SIDEWAYS)), CAMERA)
    map_hw = np.full((32, 32), 7.0, np.float32)
    np.testing.assert_allclose(estimator.to_source(map_hw), np.full((128, 128), 7.0))
    estimator.see_through(Camera.from_fov(128, 128, 40))
    assert estimator.to_source(map_hw) is None


def test_nothing_of_frames_that_are_forgotten_is_averaged() -> None:
    """They may be damaged, or of another flight: a wall at 20 m before, at 18 m since."""
    far_m = 9.5 * 3.0 * FRAME_NS * 1e-9

    def changing(position, camera):
        return np.full((camera.height, camera.width), 20.0 if position[0] < far_m else 18.0)

    estimator = MultiRangeEstimator(Oracle(changing, straight(SIDEWAYS), card()), CAMERA, ranges=1)
    for i in range(12):
        if i == 10:
            estimator.forget_frames()
        estimator.add_velocity(i * FRAME_NS, SIDEWAYS, frame="camera")
        result = estimator.add_frame(i * FRAME_NS, picture(i))
    np.testing.assert_allclose(result.depth_m, 18.0, rtol=1e-4)


def test_what_a_turn_brought_into_view_is_unknown_to_the_pair_across_it_alone() -> None:
    """Five frames ago the camera turned right by 0.2 rad; the short pair lies after that, and sees no 90 m."""
    estimator = MultiRangeEstimator(Oracle(two_walls(12.0, 90.0), straight(SIDEWAYS)), CAMERA, ranges=2)
    for i in range(60):
        turn = np.array([0.0, 0.2 if i >= 55 else 0.0, 0.0])
        estimator.add_attitude(i * FRAME_NS, quaternion_from_rotation(cv2.Rodrigues(turn)[0]))
    result = fly(estimator, SIDEWAYS, range(60))[-1]
    assert result.shifts[0] < 5 < result.shifts[-1]
    assert np.isnan(result.depth_m[:, -10:]).all()
    assert np.isfinite(result.depth_m[64, :90]).all()


def test_where_the_camera_moved_is_told_in_its_own_axes_or_not_at_all() -> None:
    """3 m/s north, looking north; then the same flight of a camera whose attitude nobody tells."""
    estimator, blind = (MultiRangeEstimator(Oracle(wall(40), straight(SIDEWAYS)), CAMERA) for _ in range(2))
    for i in range(10):
        estimator.add_attitude(i * FRAME_NS, quaternion_from_rotation(NED_FROM_CAMERA))
    result = fly(estimator, SIDEWAYS, range(10))[-1]
    np.testing.assert_allclose(result.moved_m, np.outer(result.displacements_m, [0, 0, 1]), atol=1e-9)
    assert fly(blind, SIDEWAYS, range(10))[-1].moved_m is None
