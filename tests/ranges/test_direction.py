"""Direction of motion: exact rays, noisy rays, outliers, and pictures of scenes with known motion."""

import cv2
import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.ranges import direction
from flightdepth.ranges.direction import direction_of, direction_seen, estimate_direction
from flightdepth.stillbox import PairRule, Picture, TestSet
from tests_textures import few_textures

FOCAL = 200.0
CAMERA = Camera.from_fov(400, 240, 90)
WAYS = [(1, 0, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1), (0.5, 0.3, 0.8), (-0.7, 0.1, -0.4)]


def rays_of(way, *, count=120, noise_px=0.0, outliers=0, seed=0):
    """Rays to random points now and before a move of 0.5 m."""
    rng = np.random.default_rng(seed)
    points = np.column_stack([rng.uniform(-1, 1, count), rng.uniform(-0.6, 0.6, count), np.ones(count)])
    points *= rng.uniform(4, 30, (count, 1))
    moved = points + 0.5 * np.array(way) / np.linalg.norm(way)
    now, before = points / points[:, 2:], moved / moved[:, 2:]
    before[:, :2] += rng.normal(0, noise_px / FOCAL, (count, 2))
    before[:outliers, :2] += rng.normal(0, 20 / FOCAL, (outliers, 2))
    return now, before


def degrees_between(a, b) -> float:
    cosine = np.dot(a, b) / np.linalg.norm(a) / np.linalg.norm(b)
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


@pytest.mark.parametrize("way", WAYS)
def test_exact_rays_give_the_direction_and_its_sign(way):
    found = direction_of(*rays_of(way), FOCAL)
    assert degrees_between(found.unit, way) < 1e-3


@pytest.mark.parametrize("way", WAYS)
def test_a_third_of_outliers_does_not_matter(way):
    found = direction_of(*rays_of(way, noise_px=0.2, outliers=40), FOCAL)
    assert degrees_between(found.unit, way) < 3


@pytest.mark.parametrize("way", WAYS)
def test_sigma_tells_the_error(way):
    """Of 40 tries two in three and more lie within one sigma, nearly all within three."""
    tries = [direction_of(*rays_of(way, noise_px=0.2, seed=seed), FOCAL) for seed in range(40)]
    shares = [degrees_between(each.unit, way) / np.degrees(each.sigma_rad) for each in tries]
    assert np.mean(np.array(shares) < 1.5) > 0.55
    assert np.mean(np.array(shares) < 4) > 0.9


def test_too_few_points_tell_nothing():
    now, before = rays_of((1, 0, 0), count=10)
    assert direction_of(now, before, FOCAL) is None


def test_points_that_do_not_move_tell_nothing():
    now, _ = rays_of((1, 0, 0))
    rng = np.random.default_rng(0)
    before = now + np.column_stack([rng.normal(0, 0.2 / FOCAL, (len(now), 2)), np.zeros(len(now))])
    assert direction_of(now, before, FOCAL) is None


def test_a_quarter_of_the_points_that_moved_is_enough():
    """Slow flight above a far ground: most points move by a quarter of a pixel, near things by 5 and more."""
    for near, found in ((40, True), (20, False)):
        now, before = rays_of((1, 0, 0), noise_px=0.1)
        before[near:, :2] = now[near:, :2] + 0.05 * (before[near:, :2] - now[near:, :2])
        direction = direction_of(now, before, FOCAL)
        assert (direction is not None) == found
        assert direction is None or degrees_between(direction.unit, (1, 0, 0)) < 3


def test_a_direction_that_half_of_the_points_deny_is_none():
    now, before = rays_of((0, 0, 1), noise_px=0.1, outliers=60)
    assert direction_of(now, before, FOCAL) is None


def turned_meanwhile(before, degrees, *, seed=0):
    axis = np.random.default_rng(seed).normal(size=3)
    turned = before @ cv2.Rodrigues(axis / np.linalg.norm(axis) * np.radians(degrees))[0]
    return turned / turned[:, 2:]


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("degrees", [0.3, 1.0, 3.0])
def test_a_camera_that_turned_meanwhile_does_not_hide_the_direction(way, degrees):
    """Of the pictures' two explanations, flight alone and flight with a turn, the better one; never a wrong one."""
    now, before = rays_of(way, noise_px=0.1, outliers=10)
    found = [direction_seen(now, turned_meanwhile(before, degrees, seed=k), CAMERA) for k in range(4)]
    told = [degrees_between(each, way) for each in found if each is not None]
    assert len(told) >= 3
    assert max(told) < 6


@pytest.mark.parametrize("way", WAYS)
def test_a_camera_that_did_not_turn_is_not_said_to(way):
    now, before = rays_of(way, noise_px=0.1)
    assert (direction_seen(now, before, CAMERA) == direction_of(now, before, FOCAL).unit).all()


def test_points_that_move_each_their_own_way_have_no_direction_with_a_turn_either():
    now, _ = rays_of((1, 0, 0))
    before = now + np.column_stack(
        [np.random.default_rng(1).normal(0, 5 / FOCAL, (len(now), 2)), np.zeros(len(now))]
    )
    assert direction_seen(now, before, CAMERA) is None


def test_a_blank_picture_has_no_direction():
    blank = np.full((64, 64, 3), 90, np.uint8)
    assert estimate_direction(blank, blank, Camera.from_fov(64, 64, 90)) is None


def test_rendered_pairs():
    camera = Camera.from_fov(256, 256, 90)
    pairs = TestSet(Picture(256, 256, 256), PairRule(), scenes=12, textures=few_textures())
    found = [(estimate_direction(p.previous, p.current, camera), p.displacement) for p in pairs]
    errors = [degrees_between(each.unit, moved) for each, moved in found if each is not None]
    assert len(errors) >= 11
    assert np.median(errors) < 2


@pytest.mark.parametrize(("noise_px", "turn_deg", "sought"), [(0.5, 0.0, False), (0.1, 0.5, True)])
def test_a_turn_is_sought_round_the_sphere_only_where_one_shows(noise_px, turn_deg, sought, monkeypatch):
    """Long pairs have poor tracks: each was sought through eleven starts, which took most of a small network's time."""
    starts, seek = [], direction._turning
    monkeypatch.setattr(direction, "_turning", lambda *given: starts.append(1) or seek(*given))
    now, before = rays_of((1, 0, 0.3), noise_px=noise_px)
    before = before @ cv2.Rodrigues(np.radians([0.0, 0.0, turn_deg]))[0]
    assert degrees_between(direction_seen(now, before / before[:, 2:], CAMERA), (1, 0, 0.3)) < 5
    assert bool(starts) == sought


def in_one_row(way, *, seed, spread_px=2.0, noise_px=0.2, focal=320.0):
    """Rays, lens of 90 degrees, to 90 points of one row of the picture, 6 to 60 m away, that move by some pixels."""
    rng = np.random.default_rng(seed)
    row = rng.uniform(-140, 140)
    pixels = np.column_stack([rng.uniform(-320, 320, 90), row + rng.uniform(-spread_px, spread_px, 90)])
    points = np.column_stack([pixels / focal, np.ones(90)]) * np.exp(rng.uniform(1.8, 4.1, (90, 1)))
    moved = points + 0.3 * np.array(way) / np.linalg.norm(way)
    now, before = points / points[:, 2:], moved / moved[:, 2:]
    before[:, :2] += rng.normal(0, noise_px / focal, (90, 2))
    return now, before, focal


def told_in_one_row(way, **given):
    """Errors and deviations, degrees, of the directions that are told in 40 tries."""
    found = [direction_of(*in_one_row(way, seed=seed, **given)) for seed in range(40)]
    told = [each for each in found if each is not None]
    return np.array([(degrees_between(each.unit, way), np.degrees(each.sigma_rad)) for each in told]).T


@pytest.mark.parametrize("way", [(1, 0.1, 0), (-1, 0.05, 0.1), (1, 0, -0.2)])
@pytest.mark.parametrize("spread_px", [2.0, 20.0])
def test_points_of_one_row_are_not_sure_of_a_direction_along_it(way, spread_px):
    """Flying along it, forwards looks much like sideways: some were 48 to 88 degrees off, told as sure to 1 to 3."""
    errors, sigmas = told_in_one_row(way, spread_px=spread_px)
    assert np.mean(errors > 15) < 0.06
    assert np.mean(errors < 2 * sigmas) > 0.8


@pytest.mark.parametrize("way", [(0, 1, 0.1), (0.3, 0.5, 1)])
def test_points_of_one_row_tell_what_leads_across_it(way):
    errors, sigmas = told_in_one_row(way)
    assert len(errors) == 40
    assert np.median(errors) < 0.5
    assert 0.2 < np.median(sigmas) < 0.4


def test_exact_points_of_one_row_tell_nothing():
    """All of them move along the row, whichever way in its plane the camera flew."""
    assert direction_of(*in_one_row((1, 0, 0), seed=0, spread_px=0.0, noise_px=0.0)) is None


def test_points_of_one_place_tell_nothing():
    now = np.tile([0.2, -0.1, 1.0], (30, 1))
    assert direction_of(now, now + np.array([0.05, 0.02, 0.0]), FOCAL) is None


def test_twelve_points_are_enough():
    assert degrees_between(direction_of(*rays_of((1, 0, 0), count=12), FOCAL).unit, (1, 0, 0)) < 1e-3


@pytest.mark.parametrize(("pixels", "told"), [(1.1, True), (0.9, False)])
def test_points_count_as_moved_from_a_pixel_on(pixels, told):
    now, before = rays_of((1, 0, 0))
    before = now + (before - now) * (pixels / FOCAL / np.linalg.norm(before - now, axis=1, keepdims=True))
    assert (direction_of(now, before, FOCAL) is not None) == told


def test_just_a_quarter_of_the_points_moved():
    now, before = rays_of((1, 0, 0))
    before[30:] = now[30:]
    assert direction_of(now, before, FOCAL) is not None


def test_points_that_stay_do_not_speak_for_a_direction():
    """They lie on every line: of 40 points that moved, half are denied."""
    now, before = rays_of((1, 0, 0), noise_px=0.1, outliers=20)
    before[40:] = now[40:]
    assert direction_of(now, before, FOCAL) is None


def test_points_off_their_lines_do_not_turn_a_direction_round():
    now, before = rays_of((1, 0, 0))
    before[:36, :2] += np.array([-80, 6]) / FOCAL
    assert degrees_between(direction_of(now, before, FOCAL).unit, (1, 0, 0)) < 1e-3
