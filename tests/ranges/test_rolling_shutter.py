"""A rolling shutter's bend: by rotation matrices, in rays, in pictures whose rows were turned, and in flight."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.ranges import MultiRangeEstimator, remainder
from flightdepth.ranges.derotation import Derotation, derotated
from flightdepth.ranges.pairs import Frame, Pair
from flightdepth.ranges.rolling_shutter import bent, rays_times, row_times
from flightdepth.ranges.tracks import Tracker
from flightdepth.ranges.turning import turned
from flightdepth.renderers.raycast import render
from flightdepth.runtimes.network import load_network
from flightdepth.scenes.outdoor import draw_outdoor, outdoor_flight
from flightdepth.scenes.outdoor_config import OutdoorConfig
from flightdepth.scenes.outdoor_textures import outdoor_textures
from flightdepth.stillbox import PairRule, Picture, TestSet
from tests_textures import few_textures

CAMERA = Camera.from_fov(256, 256, 90)
OFF_CENTRE = Camera(320, 180, 150.0, 160.0, 170.0, 80.0)
WAYS = [(0, -1, 0), (0, 0, 1), (0, 0, -1), (0.5, 0.3, 0.8)]
BENDS_DEG = [(0.0, 0.6, 0.0), (0.5, 0.0, 0.0), (0.0, 0.0, -0.8), (0.4, -0.5, 0.3)]
TURN = np.radians([0.3, -0.4, 0.2])


def exp(rotation):
    return cv2.Rodrigues(np.asarray(rotation, dtype=np.float64))[0]


def rays_of(way, turn, bend, *, noise_px=0.1, seed=0, count=150):
    """Rays now and before 0.3 m; a row's earlier ones were turned by exp(bend t) R, worked out with whole matrices."""
    rng = np.random.default_rng(seed)
    points = np.column_stack([rng.uniform(-1, 1, (count, 2)), np.ones(count)])
    points *= np.exp(rng.uniform(np.log(2), np.log(60), (count, 1)))
    now, moved = points / points[:, 2:], points + 0.3 * np.array(way) / np.linalg.norm(way)
    times = (128 * now[:, 1] + 128) / 256 - 0.5
    before = np.array([(exp(bend * t) @ exp(turn)).T @ point for t, point in zip(times, moved, strict=True)])
    before /= before[:, 2:]
    before[:, :2] += rng.normal(0, noise_px / CAMERA.fx, (count, 2))
    return now, before


def read_in_rows(image, camera, turning):
    """A picture whose rows are read one after the other, the middle one at its time, by a camera that turns meanwhile.

    `turning` (3,): radians from the first row to the last. Each pixel looks where the camera of its row's time does.
    """
    rays = camera.rays()
    for row in range(camera.height):
        rays[row] = rays[row] @ exp(turning * ((row + 0.5) / camera.height - 0.5)).T
    at = rays @ camera.matrix.T
    x, y = ((at[..., axis] / at[..., 2]).astype(np.float32) for axis in (0, 1))
    return cv2.remap(image, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)


@pytest.mark.parametrize("camera", [CAMERA, OFF_CENTRE])
def test_rows_are_read_from_the_top_to_the_bottom_within_one_readout(camera):
    times = row_times(np.arange(camera.height), camera)
    assert times[0] == pytest.approx(-0.5 + 0.5 / camera.height)
    assert np.diff(times) == pytest.approx(1 / camera.height)
    assert rays_times(camera.rays(), camera) == pytest.approx(np.repeat(times[:, None], camera.width, axis=1))


def test_bent_rays_are_turned_by_their_share_of_the_bend():
    rays, bend = OFF_CENTRE.rays()[::20, ::20].reshape(-1, 3), np.array([2e-3, -1e-3, 3e-3])
    times = rays_times(rays, OFF_CENTRE)
    by_matrices = np.array([exp(bend * t) @ ray for t, ray in zip(times, rays, strict=True)])
    np.testing.assert_allclose(bent(rays, bend, times), by_matrices, atol=np.square(bend).sum())
    np.testing.assert_allclose(bent(bent(rays, bend, times), -bend, times), rays, atol=2e-5)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("bend_deg", BENDS_DEG)
def test_a_bend_is_found_beside_the_rotation(way, bend_deg):
    """To a tenth of a degree."""
    bend = np.radians(bend_deg)
    tries = [
        remainder.remainder(*rays_of(way, TURN, bend, seed=seed), np.array(way), CAMERA) for seed in range(6)
    ]
    assert all(each.bend is not None and each.turns for each in tries)
    assert np.degrees(np.median([np.linalg.norm(each.bend - bend) for each in tries])) < 0.12
    assert np.degrees(np.median([np.linalg.norm(each.rotation - TURN) for each in tries])) < 0.05


@pytest.mark.parametrize(("degrees", "found"), [(0.06, False), (0.12, True)])
def test_what_long_lenses_tracks_err_by_is_no_bend_however_clear(degrees, found):
    """A twelfth of a degree is what divides them."""
    bend, way = np.radians([0.0, degrees, 0.0]), (0, 0, 1)
    tries = [
        remainder.remainder(*rays_of(way, TURN, bend, noise_px=0.01, seed=k), np.array(way), CAMERA)
        for k in range(5)
    ]
    assert [each.bend is not None for each in tries] == [found] * 5


@pytest.mark.parametrize(
    ("degrees", "left", "told", "found"),
    [
        (0.25, np.zeros(3), np.zeros(3), False),
        (0.25, TURN, np.zeros(3), True),
        (0.25, np.zeros(3), TURN, True),
        (0.25, TURN, -TURN, False),
        (0.6, np.zeros(3), np.zeros(3), True),
    ],
)
def test_a_camera_that_hardly_turns_has_no_small_bend(degrees, left, told, found):
    """By what was found of a turn and what was known together."""
    bend, way = np.radians([0.0, degrees, 0.0]), np.array([0, 0, 1])
    tries = [
        remainder.remainder(*rays_of(way, left, bend, noise_px=0.01, seed=k), way, CAMERA, turn=exp(told))
        for k in range(5)
    ]
    assert [each.bend is not None for each in tries] == [found] * 5


@pytest.mark.parametrize("bend_deg", BENDS_DEG)
def test_flying_along_the_rows_leaves_one_open_that_looks_like_a_turn(bend_deg):
    """About the view, where a turn about the vertical moves corners off their lines alike; all else is told."""
    bend, way = np.radians(bend_deg), (1, 0, 0)
    found = [remainder.remainder(*rays_of(way, TURN, bend, seed=k), np.array(way), CAMERA) for k in range(6)]
    off = np.degrees([np.concatenate([each.rotation - TURN, each.bend - bend]) for each in found])
    assert np.median(np.abs(off[:, [0, 2, 3, 4]]), axis=0).max() < 0.1
    # Off its line goes a point at (x, y) by xy of the turn, and by x times y / 2 of the bend.
    assert off[:, 5] == pytest.approx(-2 * off[:, 1], abs=0.12)


def test_rays_without_one_have_none():
    found = [
        remainder.remainder(*rays_of(way, turn, np.zeros(3), seed=seed), np.array(way), CAMERA)
        for way in WAYS
        for turn in (TURN, np.zeros(3))
        for seed in range(20)
    ]
    assert np.mean([each.bend is not None for each in found]) < 0.05


def test_corners_lie_on_their_lines_once_bend_and_rotation_are_taken_out():
    way, bend = (1, 0, 0.3), np.radians([0.4, -0.5, 0.3])
    now, before = rays_of(way, TURN, bend)
    found = remainder.remainder(now, before, np.array(way), CAMERA)
    right = rays_of(way, np.zeros(3), np.zeros(3))
    had_px = remainder.off_lines_px(*right, np.array(way) / np.linalg.norm(way), CAMERA.fx)
    assert found.left_px(now, before, CAMERA) < 1.1 * had_px


@pytest.mark.parametrize("camera", [CAMERA, OFF_CENTRE])
def test_each_row_of_a_turned_picture_is_turned_by_its_own_rotation(camera):
    """Against the plain turn of the whole picture, row by row."""
    rng = np.random.default_rng(0)
    image = cv2.GaussianBlur(rng.uniform(0, 255, (camera.height, camera.width, 3)), (0, 0), 3)
    image = image.astype(np.float32)
    bend, turn = np.radians([1.0, -1.5, 2.0]), exp(np.radians([1.0, 2.0, -1.0]))
    found = turned(image, turn, camera, bend)
    for row in range(20, camera.height - 20, 17):
        time = (row + 0.5) / camera.height - 0.5
        whole = turned(image, exp(bend * time) @ turn, camera)
        assert np.abs(found[row, 20:-20] - whole[row, 20:-20]).max() < 1.0
    assert np.abs(found - turned(image, turn, camera)).max() > 5


def test_what_a_wide_lens_did_not_see_before_does_not_come_back_mirrored():
    """Through 140 degrees, turned by 35: what lies behind the earlier picture has the colour of its edge."""
    wide = Camera.from_fov(320, 180, 140)
    image = np.tile(np.linspace(0, 255, 320, dtype=np.float32), (180, 1))
    found = turned(image, exp([0.0, np.radians(35), 0.0]), wide, np.full(3, 1e-9))
    assert (np.diff(found, axis=1) >= -0.5).all()
    assert found[:, 0] == pytest.approx(0, abs=0.5)


@pytest.fixture(scope="module")
def pairs():
    return list(TestSet(Picture(256, 256, 256), PairRule(), scenes=10, textures=few_textures()))


def asked(pair, previous):
    length_m = float(np.linalg.norm(pair.displacement))
    return Pair(Frame(0, 0, previous), pair.displacement, length_m, 5.0, np.eye(3), 0.0)


def test_pictures_whose_turn_begins_between_them_show_what_the_turn_rates_differ_by(pairs):
    """(R w1 - w2) times the readout, by pictures whose rows were each turned for themselves."""
    before, after = np.radians([0.1, 0.2, -0.1]), np.radians([-0.2, -0.5, 0.3])
    found = []
    for pair in pairs:
        earlier = read_in_rows(pair.previous, CAMERA, before)
        current = Frame(1, 1, read_in_rows(pair.current, CAMERA, after))
        found += Derotation(CAMERA, Tracker(CAMERA)).of([asked(pair, earlier)], current)
    bends = [each.bend for each in found if each.bend is not None]
    assert len(bends) >= 9
    assert np.degrees(np.linalg.norm(np.median(bends, axis=0) - (before - after))) < 0.1


@pytest.mark.parametrize(("turned_before", "least", "most"), [(True, 0.8, 1.0), (False, 0.0, 0.2)])
def test_where_a_swing_returns_its_bend_is_still_sought(pairs, turned_before, least, most):
    """Between two pictures that look the same way, while the frame before had turned."""
    bend, turn, found = np.radians([0.0, 0.25, 0.0]), exp(np.radians([0.0, 1.0, 0.0])), []
    for pair in pairs:
        derotation, current = Derotation(CAMERA, Tracker(CAMERA)), Frame(1, 1, pair.current)
        if turned_before:
            derotation.of([asked(pair, turned(pair.previous, turn, CAMERA))], current)
        found += derotation.of([asked(pair, read_in_rows(pair.previous, CAMERA, bend))], current)
    assert least <= np.mean([each.bend is not None for each in found]) <= most


def test_an_even_turn_bends_both_pictures_alike(pairs):
    turning, bends = np.radians([0.2, 0.5, -0.3]), []
    for pair in pairs:
        earlier, now = (read_in_rows(each, CAMERA, turning) for each in (pair.previous, pair.current))
        found = Derotation(CAMERA, Tracker(CAMERA)).of([asked(pair, earlier)], Frame(1, 1, now))
        bends += [each.bend for each in found]
    assert np.mean([bend is not None for bend in bends]) <= 0.1


def test_one_pair_is_made_as_an_unbent_one_is(pairs):
    """As by the bend that it was given: two resamplings do not give the picture back."""
    bend, inner, off = np.radians([0.3, 0.6, -0.4]), np.s_[16:-16, 16:-16], []
    for pair in pairs:
        seen = read_in_rows(pair.previous, CAMERA, bend)
        image, _, _ = derotated(seen, pair.current, pair.displacement, CAMERA)
        right = turned(seen, np.eye(3), CAMERA, bend)
        off.append([np.abs(each[inner].astype(float) - right[inner]).mean() for each in (image, seen)])
    left, had = np.median(off, axis=0)
    assert left < 0.3 * had


def test_depth_in_flight_hardly_minds_a_turn_that_begins(monkeypatch):
    """Outdoors, swinging by up to 50 degrees a second, 20 ms a picture: nearly as if all rows were read at once."""
    config = OutdoorConfig(frames=12, legs="any", turn_over_s=0.3, speed_m_s=(4.5, 5.5), height_m=(6.0, 10.0))
    camera, network = Camera.from_fov(448, 256, 80.0), load_network("motion")
    scene, flight = draw_outdoor(config, 3, 0), outdoor_flight(config, 3, 0)
    times_s, swing_rad_s = np.arange(config.frames) / config.rate_hz, 2 * np.pi * 0.8
    yaws_rad = np.radians(50) / swing_rad_s * np.sin(swing_rad_s * times_s)
    rates_rad_s = np.radians(50) * np.cos(swing_rad_s * times_s)
    turning = np.array([exp([0.0, yaw, 0.0]) @ flight.world_from_camera for yaw in yaws_rad])
    seen = render(replace(scene, world_from_camera=turning), outdoor_textures(0), camera)
    down = flight.world_from_camera.T @ np.array([0.0, 1.0, 0.0])
    bent_ones = [
        read_in_rows(image, camera, down * rate * 0.02)
        for image, rate in zip(seen.images, rates_rad_s, strict=True)
    ]

    def error(pictures):
        estimator, errors = MultiRangeEstimator(network, camera, ranges=1), []
        moved = scene.camera_position - scene.camera_position[0]
        for time_s, position, turn in zip(times_s, moved, turning, strict=True):
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = turn, position
            estimator.add_pose(round(time_s * 1e9), pose)
        for k, picture in enumerate(pictures):
            found = estimator.add_frame(round(times_s[k] * 1e9), picture).depth_m
            near = (seen.depth_m[k] < 80) & np.isfinite(found)
            errors += list(np.abs(found[near] / seen.depth_m[k][near] - 1)) if k >= 7 else []
        return np.mean(errors)

    unbent, mended = error(seen.images), error(bent_ones)
    monkeypatch.setattr(remainder, "CLEAR_BEND", np.inf)
    left = error(bent_ones)
    assert mended < 1.3 * unbent
    assert left > 1.6 * unbent
