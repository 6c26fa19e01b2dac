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
