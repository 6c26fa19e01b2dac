"""Laws of the photometric error: none at the true depth, all of it at infinity, more the more wrong depth is."""

import cv2
import numpy as np
import pytest
from plane_pairs import plane_pair

from flightdepth.camera import Camera
from flightdepth.evaluation.warping import Match, WarpedPair, inverse_at

CAMERA = Camera(256, 192, 200.0, 200.0, 127.5, 95.5)
WAYS = [(0.4, 0.0, 0.0), (0.0, -0.3, 0.0), (0.1, 0.05, 1.5), (0.2, 0.1, -1.2)]
ALL = np.ones((192, 256), np.bool_)


def warped(pair, displacement=None, known=ALL) -> WarpedPair:
    way = pair.displacement if displacement is None else displacement
    return WarpedPair(pair.previous, pair.current, way, CAMERA, known_previous=known, known_current=known)


def matched(pair: WarpedPair, depth_m) -> Match:
    return pair.match(pair.error_map(depth_m))


@pytest.mark.parametrize("way", WAYS)
def test_the_true_depth_leaves_next_to_nothing(way):
    pair = plane_pair(CAMERA, way, tilt=0.5)
    assert matched(warped(pair), pair.depth_m).error < 0.1


@pytest.mark.parametrize("way", WAYS)
def test_a_quarter_of_the_map_is_enough_for_a_plane(way):
    """Inverse depth of a plane is straight between pixels."""
    pair = plane_pair(CAMERA, way, tilt=0.5)
    quarter = cv2.resize(1 / pair.depth_m, (64, 48), interpolation=cv2.INTER_AREA)
    assert matched(warped(pair), 1 / quarter).error < 0.1


def test_infinity_leaves_everything():
    pair = plane_pair(CAMERA, (0.4, 0.0, 0.0))
    assert matched(warped(pair), np.full((192, 256), np.inf, np.float32)).error == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize("way", WAYS)
def test_doubled_depth_and_the_wrong_way_are_worse(way):
    pair = plane_pair(CAMERA, way)
    true, doubled = (matched(warped(pair), scale * pair.depth_m).error for scale in (1, 2))
    backward = matched(warped(pair, -pair.displacement), pair.depth_m).error
    assert true < 0.1
    assert min(doubled, backward) > 0.5


def test_the_size_of_the_error_by_hand():
    """A ramp of 2 grey levels a pixel, seen 3 pixels aside: 6 levels without a warp, 3 with half the shift."""
    ramp = np.repeat((2 * np.arange(100, dtype=np.uint8))[None, :, None], 64, axis=0).repeat(3, axis=2)
    camera = Camera(90, 64, 100.0, 100.0, 44.5, 31.5)
    known = np.ones((64, 90), np.bool_)
    previous, current = np.ascontiguousarray(ramp[:, :90]), np.ascontiguousarray(ramp[:, 3:93])
    pair = WarpedPair(
        previous, current, np.array([0.3, 0.0, 0.0]), camera, known_previous=known, known_current=known
    )
    errors = [
        np.nanmax(pair.error_map(np.full((64, 90), depth, np.float32))) for depth in (10.0, 20.0, np.inf)
    ]
    assert errors == pytest.approx([0.0, 3.0, 6.0], abs=1e-3)
    assert matched(pair, np.full((64, 90), 20.0, np.float32)).error == pytest.approx(0.5, abs=1e-4)
    assert matched(pair, np.full((64, 90), 10.0, np.float32)).inside == pytest.approx(87 / 90)


def test_the_best_constant_finds_a_wall_and_not_a_slope():
    wall, slope = (plane_pair(CAMERA, (0.4, 0.0, 0.0), tilt=tilt) for tilt in (0.0, 1.2))
    assert warped(wall).best_constant().error < 0.25
    assert warped(slope).best_constant().error > 2 * matched(warped(slope), slope.depth_m).error


def test_padding_and_unknown_depth_are_not_compared():
    pair = plane_pair(CAMERA, (0.4, 0.0, 0.0))
    known = ALL.copy()
    known[:, :64] = False
    depth_m = pair.depth_m.copy()
    depth_m[:48] = np.nan
    error = warped(pair, known=known).error_map(depth_m)
    assert np.isnan(error[:, :64]).all()
    assert np.isnan(error[:48]).all()
    assert np.isfinite(error[50:, 80:200]).all()


def test_nothing_to_compare_is_nan():
    pair = plane_pair(CAMERA, (0.4, 0.0, 0.0))
    match = matched(warped(pair), np.full((192, 256), np.nan, np.float32))
    assert np.isnan(match.error)
    assert match.inside == 0


def test_an_output_of_zero_has_an_inverse():
    assert np.isfinite(inverse_at(np.zeros((48, 64), np.float32), CAMERA)).all()


def test_a_constant_that_leaves_little_to_compare_is_not_the_best():
    """Pictures that agree 32 px aside, of 60: less than half of them is inside then."""
    noise = np.random.default_rng(0).integers(0, 256, (48, 92, 1)).astype(np.uint8).repeat(3, axis=2)
    camera = Camera(60, 48, 100.0, 100.0, 29.5, 23.5)
    known = np.ones((48, 60), np.bool_)
    previous, current = np.ascontiguousarray(noise[:, :60]), np.ascontiguousarray(noise[:, 32:])
    pair = WarpedPair(
        previous, current, np.array([1.0, 0.0, 0.0]), camera, known_previous=known, known_current=known
    )
    assert matched(pair, np.full((48, 60), 100 / 32, np.float32)) == Match(
        pytest.approx(0, abs=1e-6), 28 / 60
    )
    assert pair.best_constant().error > 0.5


def half_known(previous: bool, current: bool) -> WarpedPair:
    """The left half of a picture, of the other, or of both shows nothing."""
    pair, half = plane_pair(CAMERA, (0.4, 0.0, 0.0)), ALL.copy()
    half[:, :128] = False
    known = {"known_previous": half if previous else ALL, "known_current": half if current else ALL}
    return WarpedPair(pair.previous, pair.current, pair.displacement, CAMERA, **known)


@pytest.mark.parametrize(("previous", "current"), [(True, False), (False, True)])
def test_padding_of_either_picture_counts_nowhere(previous, current):
    pair = half_known(previous, current)
    assert matched(pair, np.full((192, 256), np.inf, np.float32)) == Match(pytest.approx(1), 1)
    assert np.isfinite(pair.unmoved_map()).sum() == 192 * 128


def test_what_is_interpolated_with_padding_is_not_compared():
    """Seen 0.3 pixels to the left: of the first known column a part is padding."""
    pair, half = plane_pair(CAMERA, (-0.4, 0.0, 0.0)), ALL.copy()
    half[:, :128] = False
    seen = WarpedPair(
        pair.previous, pair.current, pair.displacement, CAMERA, known_previous=half, known_current=ALL
    )
    error = seen.error_map(np.full((192, 256), 200 * 0.4 / 0.3, np.float32))
    assert np.isnan(error[:, :129]).all()
    assert np.isfinite(error[:, 129:]).all()


def test_what_would_have_been_behind_the_earlier_camera_is_not_compared():
    pair = plane_pair(CAMERA, (0.2, 0.1, -1.2))
    error = warped(pair).error_map(np.full((192, 256), 0.5, np.float32))
    assert np.isnan(error).all()


@pytest.mark.parametrize("way", WAYS)
def test_the_principal_point_need_not_be_in_the_middle(way):
    camera = Camera(256, 192, 200.0, 180.0, 110.0, 70.0)
    pair = plane_pair(camera, way)
    seen = WarpedPair(
        pair.previous, pair.current, pair.displacement, camera, known_previous=ALL, known_current=ALL
    )
    assert matched(seen, pair.depth_m).error < 0.1


def test_near_depth_has_its_inverse():
    assert inverse_at(np.full((48, 64), 0.25, np.float32), CAMERA) == pytest.approx(4)
