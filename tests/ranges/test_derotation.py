"""What is left of a pair's motion: exact rays, noisy rays, the prior, and pictures turned by known angles."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.ranges import remainder as remainders
from flightdepth.ranges.derotation import Derotation, derotated
from flightdepth.ranges.pairs import Frame, Pair
from flightdepth.ranges.remainder import Remainder, remainder
from flightdepth.ranges.tracks import Tracker, in_grey, tracked_rays
from flightdepth.stillbox import PairRule, Picture, TestSet
from flightdepth.stillbox.motion_noise import rotated, tilted
from tests_textures import few_textures

FOCAL = 128.0
CAMERA = Camera.from_fov(256, 256, 90)
WAYS = [(1, 0, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1), (0.5, 0.3, 0.8)]
TURN = np.radians([0.3, -0.4, 0.2])
STEADY = np.eye(3)


def rays_of(way, turn, *, count=150, noise_px=0.0, outliers=0, seed=0, near_m=2.0, far_m=60.0):
    """Rays now and before a move of 0.3 m, seen by a camera that meanwhile turned by a rotation vector."""
    rng = np.random.default_rng(seed)
    points = np.column_stack([rng.uniform(-1, 1, (count, 2)), np.ones(count)])
    points *= np.exp(rng.uniform(np.log(near_m), np.log(far_m), (count, 1)))
    moved = (points + 0.3 * np.array(way) / np.linalg.norm(way)) @ cv2.Rodrigues(np.array(turn, dtype=float))[
        0
    ]
    now, before = points / points[:, 2:], moved / moved[:, 2:]
    before[:, :2] += rng.normal(0, noise_px / FOCAL, (count, 2))
    before[:outliers, :2] += rng.normal(0, 10 / FOCAL, (outliers, 2))
    return now, before


def degrees_off(found, turn):
    return float(np.degrees(np.linalg.norm(found.rotation - turn)))


@pytest.mark.parametrize("way", WAYS)
def test_exact_rays_give_the_rotation(way):
    """But for the prior's pull."""
    found = remainder(*rays_of(way, TURN), np.array(way), CAMERA)
    assert found.turns
    assert degrees_off(found, TURN) < 0.01


@pytest.mark.parametrize("way", WAYS)
def test_outliers_do_not_matter(way):
    found = remainder(*rays_of(way, TURN, noise_px=0.1, outliers=45), np.array(way), CAMERA)
    assert degrees_off(found, TURN) < 0.06


@pytest.mark.parametrize("way", WAYS)
def test_a_wrong_direction_is_mended_with_it(way):
    said = tilted(np.array(way, dtype=float), np.array([0.3, 0.5, -0.8]), 8.0)
    found = remainder(*rays_of(way, TURN, noise_px=0.05), said, CAMERA)
    cosine = found.unit @ np.array(way) / np.linalg.norm(way)
    assert found.heads_elsewhere
    assert np.degrees(np.arccos(cosine)) < 1.5
    assert degrees_off(found, TURN) < 0.05


def test_a_steady_pair_is_left_alone():
    """Of 40 nearly none is said to turn, and none by much."""
    found = [
        remainder(*rays_of((1, 0, 0.3), (0, 0, 0), noise_px=0.1, seed=k), np.array([1, 0, 0.3]), CAMERA)
        for k in range(40)
    ]
    assert np.mean([each.turns for each in found]) < 0.1
    assert np.mean([each.heads_elsewhere for each in found]) < 0.1
    assert max(degrees_off(each, np.zeros(3)) for each in found) < 0.1


def test_the_covariance_tells_the_error():
    tries = [
        remainder(*rays_of((1, 0, 0.3), TURN, noise_px=0.1, seed=k), np.array([1, 0, 0.3]), CAMERA)
        for k in range(60)
    ]
    errors = np.array([each.rotation - TURN for each in tries])
    sigmas = np.array([np.sqrt(np.diag(each.covariance)[:3]) for each in tries])
    # Independent points: the deviation told allows for tracks that err together.
    assert np.abs(errors / sigmas).mean() < 1
    assert (sigmas < 3 * 2.5 * errors.std(axis=0)).all()


def over_fields(seed, wrong):
    """Rays, direction and camera of a flight sideways over the ground; some tracks jumped aside and backwards."""
    focal, way, rng = 148.0, np.array([1.0, 0, 0]), np.random.default_rng(seed)
    points = np.column_stack([rng.uniform(-0.85, 0.85, 100), rng.uniform(-0.05, 0.4, 100), np.ones(100)])
    points *= (8 / np.maximum(points[:, 1], 0.1) * np.exp(rng.uniform(-0.2, 0.2, 100)))[:, None]
    moved = points + 0.37 * way
    now, before = points / points[:, 2:], moved / moved[:, 2:]
    before[:, :2] += rng.normal(0, 0.07 / focal, (100, 2))
    aside = rng.choice([-1, 1], wrong) * rng.uniform(1, 2, wrong)
    jumps = np.column_stack([-rng.uniform(0.5, 1, wrong), aside])
    before[:wrong, :2] = now[:wrong, :2] + jumps / focal
    return now, before, way, Camera(252, 140, focal, focal, 125.5, 69.5)


def turned_with_some_wrong(seed, wrong):
    """The same of a camera that turned; some tracks are off by 2 px any way."""
    way = np.array([1, 0, 0.3])
    now, before = rays_of(way, TURN, noise_px=0.1, seed=seed)
    before[:wrong, :2] += np.random.default_rng(seed).normal(0, 2 / FOCAL, (wrong, 2))
    return now, before, way, CAMERA


def usual_degrees_off(tries, turn):
    return float(np.sqrt(np.mean([degrees_off(each, turn) ** 2 for each in tries])))


def test_three_wrong_tracks_are_no_turn():
    """Ten deviations off their lines, they were believed that they moved against the parallax: 39 of 40 turned."""
    found = [remainder(*over_fields(seed, wrong=3)) for seed in range(40)]
    right = [remainder(*over_fields(seed, wrong=0)) for seed in range(40)]
    assert not any(each.turns for each in found)
    assert usual_degrees_off(found, 0) < 1.2 * usual_degrees_off(right, 0)


def test_four_wrong_tracks_in_ten_leave_little_more():
    """They left five times as much rotation as none."""
    found = [remainder(*turned_with_some_wrong(seed, wrong=60)) for seed in range(40)]
    right = [remainder(*turned_with_some_wrong(seed, wrong=0)) for seed in range(40)]
    assert usual_degrees_off(found, TURN) < 2.5 * usual_degrees_off(right, TURN)


def test_poor_tracks_among_good_ones_tell_little(monkeypatch):
    """Four in ten err seven times as much, as at edges or on waves; wider weights alone leave more of it."""

    def left():
        tries = []
        for seed in range(40):
            now, before = rays_of((0.5, 0.3, 0.8), TURN, noise_px=0.05, seed=seed)
            before[:60, :2] += np.random.default_rng(seed).normal(0, 0.35 / FOCAL, (60, 2))
            tries.append(remainder(now, before, np.array([0.5, 0.3, 0.8]), CAMERA))
        return usual_degrees_off(tries, TURN)

    narrow = left()
    monkeypatch.setattr(remainders, "MCCLURE", remainders.MCCLURE[:1])
    assert narrow < 0.95 * left()


def test_where_turning_looks_like_flying_the_prior_holds():
    """A narrow view of one depth, flying sideways: a turn right and a shift are nearly the same."""
    narrow, wall = Camera(200, 200, 2000.0, 2000.0, 99.5, 99.5), {"near_m": 20.0, "far_m": 20.1}
    now, before = rays_of((1, 0, 0), (0, 0, 0), noise_px=0.1, **wall)
    scale = np.array([0.05, 0.05, 1.0])
    found = remainder(now * scale, before * scale, np.array([1.0, 0, 0]), narrow)
    assert not found.turns and not found.heads_elsewhere
    assert degrees_off(found, np.zeros(3)) < 0.3
    # It says so itself: it knows little more than the prior.
    assert 0.2 < np.degrees(np.sqrt(found.covariance[1, 1])) <= 0.3


def test_through_a_long_lens_the_noise_does_not_outweigh_what_is_known():
    """Of a direction that was right and is known to 4 degrees; 15 degrees across, 14 to 40 m away."""
    way, camera, off = np.array([0.9, 0.0, 0.4]), Camera(256, 144, 970.0, 970.0, 127.5, 71.5), []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        points = np.column_stack([rng.uniform(-0.13, 0.13, 150), rng.uniform(-0.07, 0.07, 150), np.ones(150)])
        points *= np.exp(rng.uniform(np.log(14), np.log(40), (150, 1)))
        moved = points + 0.17 * way
        now, before = points / points[:, 2:], moved / moved[:, 2:]
        before[:, :2] += rng.normal(0, 0.07 / camera.fx, (150, 2))
        off.append(remainder(now, before, way, camera).off)
    assert np.degrees(np.sqrt(np.mean(np.square(off)))) < 2


def test_a_turn_far_beyond_the_usual_is_not_held_back():
    turn = np.radians([1.5, -2.0, 1.0])
    way = np.array([1, 0, 0.3])
    tries = [remainder(*rays_of(way, turn, noise_px=0.3, seed=k), way, CAMERA) for k in range(20)]
    assert np.median([degrees_off(found, turn) for found in tries]) < 0.05


def test_few_points_tell_nothing():
    assert remainder(*rays_of((1, 0, 0), TURN, count=11), np.array([1.0, 0, 0]), CAMERA) is None
    blank = np.full((256, 256, 3), 90, np.uint8)
    moved = np.array([0.3, 0.0, 0.0])
    image, displacement, covariance = derotated(blank, blank, moved, CAMERA)
    assert image is blank and displacement is moved and covariance is None


@pytest.fixture(scope="module")
def pairs():
    return list(TestSet(Picture(256, 256, 256), PairRule(), scenes=10, textures=few_textures()))


@pytest.mark.parametrize("degrees", [0.0, 0.1, 0.5, 2.0])
def test_rendered_pairs_that_were_turned(pairs, degrees):
    off = []
    for number, pair in enumerate(pairs):
        axis = np.random.default_rng(number).normal(size=3)
        turn = axis / np.linalg.norm(axis) * np.radians(degrees)
        rays = tracked_rays(rotated(pair.previous, CAMERA, turn), pair.current, CAMERA)
        off.append(degrees_off(remainder(*rays, pair.displacement, CAMERA), turn))
    assert np.median(off) < 0.05
    assert np.percentile(off, 90) < 0.15


def pair_of(pair, previous, *, directed=True, turn=STEADY):
    length_m = float(np.linalg.norm(pair.displacement))
    angle = float(np.linalg.norm(cv2.Rodrigues(turn)[0]))
    return Pair(Frame(0, 0, previous), pair.displacement, length_m, 5.0, turn, angle, directed)


@pytest.mark.parametrize("degrees", [0.9, 2.0])
def test_a_pair_keeps_what_was_known_of_its_turn(pairs, degrees):
    """A reported turn that is wrong by TURN: the two together are what the picture was turned by."""
    reported = cv2.Rodrigues(np.radians([0.0, degrees, 0.0]))[0]
    pair = pairs[0]
    whole = cv2.Rodrigues(TURN)[0] @ reported
    previous = rotated(pair.previous, CAMERA, cv2.Rodrigues(whole)[0][:, 0])
    tracker = Tracker(CAMERA)
    asked = pair_of(pair, previous, turn=reported)
    found = Derotation(CAMERA, tracker).of([asked], Frame(1, 1, pair.current))[0]
    left = cv2.Rodrigues(found.current_from_previous @ whole.T)[0]
    assert np.degrees(np.linalg.norm(left)) < 0.08
    assert found.turn_rad == pytest.approx(np.linalg.norm(cv2.Rodrigues(whole)[0]), abs=1e-3)
    assert found.length_m == asked.length_m


def test_a_direction_seen_elsewhere_tells_the_rotation(pairs):
    """One that is 5 degrees off, as where it was seen in a pair of another length."""
    pair = pairs[0]
    asked = pair_of(pair, rotated(pair.previous, CAMERA, TURN), directed=False)
    seen_m = tilted(pair.displacement, np.array([0.3, 0.5, -0.8]), 5.0)
    asked = replace(asked, displacement_m=seen_m, seen=True)
    found = Derotation(CAMERA, Tracker(CAMERA)).of([asked], Frame(1, 1, pair.current))[0]
    assert np.degrees(np.linalg.norm(cv2.Rodrigues(found.current_from_previous)[0][:, 0] - TURN)) < 0.15


def test_a_pair_whose_direction_nobody_tells_stays_as_it_is(pairs):
    pair = pairs[0]
    asked = pair_of(pair, rotated(pair.previous, CAMERA, TURN), directed=False)
    assert Derotation(CAMERA, Tracker(CAMERA)).of([asked], Frame(1, 1, pair.current))[0] is asked


@pytest.mark.parametrize("fault", ["moves by itself", "turned by 9 degrees", "heads elsewhere"])
def test_a_pair_that_nothing_small_makes_right_is_left_out(pairs, fault):
    """No depth is better than one that looks right; the pair beside it stays."""
    pair, current = pairs[0], Frame(1, 1, pairs[0].current)
    wrong = pair_of(pair, pair.previous)
    if fault == "moves by itself":  # each quarter of the picture another way
        parts = [np.roll(pair.previous, shift, axis=(0, 1)) for shift in ((4, 0), (-4, 0), (0, 4), (0, -4))]
        mixed = pair.previous.copy()
        for k, part in enumerate(parts):
            where = np.s_[128 * (k // 2) : 128 * (k // 2 + 1), 128 * (k % 2) : 128 * (k % 2 + 1)]
            mixed[where] = part[where]
        wrong = pair_of(pair, mixed)
    if fault == "turned by 9 degrees":
        wrong = pair_of(pair, rotated(pair.previous, CAMERA, np.radians([0, 0, 9.0])))
    if fault == "heads elsewhere":
        wrong = replace(wrong, displacement_m=-pair.displacement)
    right = pair_of(pair, pair.previous)
    found = Derotation(CAMERA, Tracker(CAMERA)).of([wrong, right], current)
    assert [each.previous for each in found] == [right.previous]


def test_one_pair_is_mended_as_those_of_a_flight_are(pairs):
    """Turned back, and headed elsewhere where it was; what is left is less than what had been."""
    pair = pairs[0]
    seen = rotated(pair.previous, CAMERA, TURN)
    said = tilted(pair.displacement, np.array([0.3, 0.5, -0.8]), 8.0)
    image, moved, covariance = derotated(seen, pair.current, said, CAMERA)
    inner = np.s_[16:-16, 16:-16]
    off, had = (np.abs(each[inner].astype(float) - pair.previous[inner]).mean() for each in (image, seen))
    assert off < 0.3 * had
    assert np.linalg.norm(moved) == pytest.approx(np.linalg.norm(said))
    assert moved @ pair.displacement > 0.999 * np.linalg.norm(said) * np.linalg.norm(pair.displacement)
    assert np.sqrt(np.trace(covariance[:3, :3])) < 0.5 * np.linalg.norm(TURN)
    assert np.sqrt(np.trace(covariance[3:, 3:])) < np.radians(4)
    far = rotated(pair.previous, CAMERA, np.radians([0, 0, 9.0]))
    given = derotated(far, pair.current, pair.displacement, CAMERA)
    assert given[0] is far and given[1] is pair.displacement and given[2] is None
    same, still, _ = derotated(pair.previous, pair.current, pair.displacement, CAMERA)
    assert same is pair.previous and still is pair.displacement


def chance(sigmas, seed=0):
    """Shares of such a noise that are said to turn, and to head elsewhere."""
    noise, covariance = np.random.default_rng(seed).normal(size=(2000, 5)) * sigmas, np.diag(sigmas**2)
    each = [Remainder(row[:3], np.array([0.0, 0.0, 1.0]), covariance, row[3:]) for row in noise]
    return np.mean([one.turns for one in each]), np.mean([one.heads_elsewhere for one in each])


def test_noise_passes_for_a_turn_or_another_direction_once_in_twenty():
    assert chance(np.array([1e-4, 3e-4, 2e-3, 1e-3, 0.03])) == pytest.approx((0.05, 0.05), abs=0.015)


@pytest.mark.parametrize(
    ("turned_deg", "off_deg", "small"),
    [((2.8, 2.8, 2.8), (0, 0), True), ((3, 3, 3), (0, 0), False), ((0, 0, 0), (11, 11), True),
     ((0, 0, 0), (-12, 12), False)],
)  # fmt: skip
def test_small_is_five_degrees_of_a_turn_and_four_deviations_of_a_direction(turned_deg, off_deg, small):
    """All axes together, whichever way: 4.8 and 5.2 degrees, 15.6 and 17 of 4 times 4."""
    found = Remainder(np.radians(turned_deg), np.array([0.0, 0.0, 1.0]), np.eye(5), np.radians(off_deg))
    assert found.is_small(np.radians(4)) == small


def test_corners_of_oblong_pixels_have_rays_of_their_own_scales(pairs):
    """A picture moved by 4 pixels to the right and 6 down."""
    oblong, image = Camera(256, 256, 128.0, 100.0, 120.0, 130.0), pairs[0].current
    now, before = tracked_rays(np.roll(image, (6, 4), axis=(0, 1)), image, oblong)
    assert np.median(before - now, axis=0) == pytest.approx([4 / 128, 6 / 100, 0], abs=1e-4)
    at = now[:, :2] * (128, 100) + (120, 130)
    np.testing.assert_allclose(at % 2, 0.5, atol=1e-6)  # corners of blocks of two pixels
    assert at.min() >= 0 and at.max() < 256


def test_grey_pictures_are_tracked_as_their_colours_are(pairs):
    colours = Tracker(CAMERA).rays(pairs[0].previous, pairs[0].current)
    greys = Tracker(CAMERA).rays(in_grey(pairs[0].previous), in_grey(pairs[0].current))
    np.testing.assert_array_equal(colours, greys)


def test_a_pair_is_tracked_once(pairs):
    tracker = Tracker(CAMERA)
    first = tracker.rays(pairs[0].previous, pairs[0].current)
    assert tracker.rays(pairs[0].previous, pairs[0].current) is first
    assert tracker.rays(pairs[0].previous, pairs[1].current) is not first
