"""What an uncertain motion adds to the error bar: against motions that were changed a little, and against chance."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.ranges import MultiRangeEstimator
from flightdepth.ranges.motion_error import widened, with_motion_error
from flightdepth.ranges.pairs import Frame, Pair
from flightdepth.ranges.remainder import SHARE, Remainder
from flightdepth.runtimes.network import Network
from flightdepth.runtimes.prediction import Prediction
from flightdepth.triangulation import depth_errors
from tests_networks import BestHypothesis, swept_card

CAMERA = Camera.from_fov(256, 192, 80)
SHAPE = (48, 64)
WAYS = [(0.6, 0.0, 0.0), (0.1, -0.2, 0.5), (0.0, 0.3, -0.5)]
SMALL = 1e-4  # radians


def some_depth() -> np.ndarray:
    rows, columns = np.indices(SHAPE)
    return (4 + rows / 8 + 3 * np.sin(columns / 9)).astype(np.float32)


def triangulated(depth_m: np.ndarray, way: np.ndarray, turn: np.ndarray, told: np.ndarray) -> np.ndarray:
    """Depth by rays in double precision, [h, w], of who takes a point seen after `turn` for one moved by `told`."""
    rays = CAMERA.resized(*SHAPE[::-1]).rays()
    before = rays * depth_m[..., None] + way
    before = before @ cv2.Rodrigues(turn)[0].T
    before /= before[..., 2:]
    # Z (x, y, 1) + told = s before: the point of the line nearest to where it was seen, which is what flow leaves.
    moved = before - rays
    line = told[:2] - before[..., :2] * told[2]
    return (line * line).sum(-1) / (line * moved[..., :2]).sum(-1)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("kind", range(6))
def test_each_error_moves_depth_as_triangulation_says(way, kind):
    way, depth_m = np.array(way), some_depth()
    turn, told = np.zeros(3), way.copy()
    if kind < 3:
        turn[kind] = SMALL
    else:
        told = way + np.linalg.norm(way) * SMALL * np.eye(3)[kind - 3]
    exact = triangulated(depth_m, way, np.zeros(3), way)
    assert exact == pytest.approx(depth_m, rel=1e-4)
    share = (triangulated(depth_m, way, turn, told) / exact - 1) / SMALL
    found = depth_errors(depth_m, way, CAMERA)[kind]
    rays = CAMERA.resized(*SHAPE[::-1]).rays()
    clear = np.hypot(way[0] - rays[..., 0] * way[2], way[1] - rays[..., 1] * way[2]) > 0.1 * np.linalg.norm(
        way
    )
    assert clear.mean() > 0.9
    assert found[clear] == pytest.approx(
        share[clear], rel=0.05, abs=max(1e-3, 0.05 * np.abs(share[clear]).max())
    )


def test_a_likely_motion_is_as_far_off_as_the_bar_says():
    """Many motions drawn from a covariance: their depths deviate by what is told for it, pixel by pixel."""
    rng, way, depth_m = np.random.default_rng(3), np.array(WAYS[1]), some_depth()
    half = rng.normal(size=(5, 5)) * np.radians(0.02)
    remainder = Remainder(np.zeros(3), way / np.linalg.norm(way), half @ half.T, np.zeros(2))
    covariance = remainder.left_open(turned_back=True, redirected=True)
    depths = []
    for errors in rng.multivariate_normal(np.zeros(6), covariance, 400):
        told = way + np.linalg.norm(way) * errors[3:]
        depths.append(triangulated(depth_m, way, errors[:3], told))
    deviation = np.std(depths, axis=0)
    told_m = with_motion_error(np.zeros(SHAPE, np.float32), depth_m, way, covariance, CAMERA)
    small = deviation < 0.1 * depth_m  # where it is still linear
    assert small.mean() > 0.8
    assert told_m[small] == pytest.approx(deviation[small], rel=0.2)


def test_the_direction_is_never_longer_or_shorter():
    unit = np.array([0.36, 0.48, 0.8])
    remainder = Remainder(np.zeros(3), unit, np.eye(5) * 1e-4, np.array([0.01, 0.02]))
    covariance = remainder.left_open(turned_back=True, redirected=False)
    assert unit @ covariance[3:, 3:] @ unit == pytest.approx(0, abs=1e-12)
    from_tracks = SHARE**2 * 1e-4
    assert np.linalg.eigvalsh(covariance[3:, 3:]) == pytest.approx(
        [0, from_tracks, from_tracks + 5e-4], abs=1e-10
    )


@pytest.mark.parametrize(("turned_back", "redirected"), [(True, False), (False, True), (False, False)])
def test_what_was_found_and_left_is_off_by_itself(turned_back, redirected):
    rotation, off = np.array([0.001, -0.002, 0.0005]), np.array([0.01, -0.02])
    remainder = Remainder(rotation, np.array([0.0, 0.6, 0.8]), np.eye(5) * 1e-12, off)
    variances = np.diag(remainder.left_open(turned_back=turned_back, redirected=redirected))
    assert np.sqrt(variances[:3]) == pytest.approx(0 * rotation if turned_back else abs(rotation), abs=2e-6)
    assert np.sqrt(variances[3:].sum()) == pytest.approx(0 if redirected else np.hypot(*off), abs=2e-6)


def pair_of(covariance: np.ndarray | None) -> Pair:
    frame = Frame(0, 0, np.zeros((192, 256, 3), np.uint8))
    return Pair(frame, np.array(WAYS[1]), 0.55, 10.0, np.eye(3), 0.0, covariance=covariance)


def test_pairs_are_widened_each_by_its_own_motion():
    depth_m = np.stack([some_depth()] * 3)
    found = Prediction(depth_m / 100, depth_m, np.full_like(depth_m, 0.5), np.ones(SHAPE, bool))
    pairs = [pair_of(None), pair_of(np.eye(6) * 1e-6), pair_of(np.eye(6) * 1e-4)]
    sigma_m = widened(found, pairs, CAMERA).sigma_m
    assert sigma_m.dtype == np.float32 and np.isfinite(sigma_m).all()
    assert (sigma_m[0] == 0.5).all()
    assert (sigma_m[1] > 0.5).all() and (sigma_m[2] > sigma_m[1]).all()


@pytest.mark.parametrize("own_m", [0.0, 0.5])
def test_an_uncertain_length_makes_depth_uncertain_by_its_share(own_m):
    depth_m = some_depth()[None]
    found = Prediction(depth_m / 100, depth_m, np.full_like(depth_m, own_m), np.ones(SHAPE, bool))
    pair = replace(pair_of(None), length_sigma_m=0.055)  # of 0.55 m
    assert widened(found, [pair], CAMERA).sigma_m == pytest.approx(np.hypot(own_m, 0.1 * depth_m), rel=1e-5)


def test_it_is_largest_at_the_focus_of_expansion_and_far_away():
    ahead = np.array([0.0, 0.0, 0.5])
    covariance = np.diag([1e-7] * 3 + [1e-4, 1e-4, 0.0])
    nothing, near = np.zeros(SHAPE, np.float32), np.full(SHAPE, 5.0, np.float32)
    share = with_motion_error(nothing, near, ahead, covariance, CAMERA) / near
    middle = share[SHAPE[0] // 2 - 1 : SHAPE[0] // 2 + 1, SHAPE[1] // 2 - 1 : SHAPE[1] // 2 + 1]
    assert middle.min() > 5 * share[0, 0]
    assert np.isfinite(share).all()
    farther = with_motion_error(nothing, 4 * near, ahead, covariance, CAMERA) / (4 * near)
    assert (farther > share).all()


def test_where_nothing_is_told_nothing_is_widened():
    depth_m = some_depth()[None]
    found = Prediction(depth_m / 100, depth_m, None, np.ones(SHAPE, bool))
    assert widened(found, [pair_of(np.eye(6))], CAMERA) is found
    still = replace(found, sigma_m=np.ones_like(depth_m), depth_m=np.full_like(depth_m, np.nan))
    assert np.isnan(widened(still, [pair_of(np.eye(6))], CAMERA).sigma_m).all()


def test_in_flight_the_bar_holds_what_the_tracks_leave_open():
    """The same flight, sideways past a textured wall, with and without tracks: same depth, a wider bar with them."""
    noise = np.random.default_rng(4).integers(0, 256, (192, 320), dtype=np.uint8)
    wall = np.repeat(
        (cv2.GaussianBlur(noise, (0, 0), 2.0) * 3.0 - 256).clip(0, 255).astype(np.uint8)[..., None], 3, 2
    )
    results = []
    for derotate in (True, False):
        estimator = MultiRangeEstimator(
            Network(swept_card(), BestHypothesis()), CAMERA, ranges=1, derotate=derotate
        )
        for number in range(6):
            estimator.add_velocity(number * 10**8, [1.0, 0.0, 0.0], frame="camera")
            result = estimator.add_frame(number * 10**8, wall[:, 3 * number : 3 * number + 256])
        results.append(result)
    tracked, untracked = results
    known = np.isfinite(tracked.sigma_m) & np.isfinite(untracked.sigma_m)
    assert known.mean() > 0.5
    assert tracked.depth_m[known] == pytest.approx(untracked.depth_m[known], rel=1e-3)
    share = (tracked.sigma_m / untracked.sigma_m)[known]
    assert share.min() > 1 and share.max() < 3


def test_in_flight_the_bar_holds_what_the_log_says_of_its_velocity():
    """0.2 of 1 m/s: a fifth of the depth beside what the network says; depth itself stays."""
    noise = np.random.default_rng(4).integers(0, 256, (192, 320, 3), dtype=np.uint8)
    wall = cv2.GaussianBlur(noise, (0, 0), 2.0)
    results = []
    for sigma in (None, 0.2):
        estimator = MultiRangeEstimator(Network(swept_card(), BestHypothesis()), CAMERA, derotate=False)
        for number in range(4):
            estimator.add_velocity(number * 10**8, [1.0, 0.0, 0.0], frame="camera", sigma=sigma)
            result = estimator.add_frame(number * 10**8, wall[:, 3 * number : 3 * number + 256])
        results.append(result)
    sure, unsure = results
    known = np.isfinite(unsure.depth_m)
    assert known.mean() > 0.5
    assert unsure.depth_m[known] == pytest.approx(sure.depth_m[known], rel=1e-4)
    told = np.hypot(sure.sigma_m, 0.2 * sure.depth_m)[known]
    off = np.abs(unsure.sigma_m[known] / told - 1)
    assert (off < 0.02).mean() > 0.98  # but for edges, where bars of two things are mixed
    assert unsure.confidence[known].mean() < sure.confidence[known].mean() - 0.1


@pytest.mark.parametrize("depth_m", [0.0, 2.0, 5.0, 1e6])
@pytest.mark.parametrize("way", [(0.0, 0.0, 0.0), (0.0, 0.0, -5.0), (0.3, 0.0, 0.1)])
def test_errors_stay_finite_where_depth_or_motion_is_nothing(way, depth_m):
    """At the focus of expansion, and of points that the camera has flown past, too."""
    centred = Camera(65, 49, 60.0, 60.0, 32.0, 24.0)  # a pixel lies on the focus
    assert np.isfinite(depth_errors(np.full((49, 65), depth_m, np.float32), way, centred)).all()
