"""Laws of the slope of depth against metres flown."""

import cv2
import numpy as np
import pytest

from flightdepth.evaluation.tracked_points import PathLength, Slopes, TrackedPoints, _thinned, slopes_of

FOCAL, SIZE = 200.0, 256


def flown_at_wall(scale: float) -> TrackedPoints:
    """Fly 6 m straight at a textured wall 20 m away; the depth map is the truth times `scale`."""
    rng = np.random.default_rng(0)
    texture = cv2.GaussianBlur(rng.integers(0, 256, (700, 700, 3)).astype(np.uint8), (0, 0), 2.5)
    texture = cv2.normalize(texture, None, 0, 255, cv2.NORM_MINMAX)
    points = TrackedPoints()
    for flown in np.arange(0, 6, 0.2):
        depth = 20.0 - flown
        zoom = 20.0 / depth
        middle = (SIZE - 1) / 2
        matrix = np.array([[zoom, 0, middle - zoom * 350], [0, zoom, middle - zoom * 350]])
        image = cv2.warpAffine(texture, matrix, (SIZE, SIZE))
        points.add(image, np.full((SIZE, SIZE), scale * depth, np.float32), float(flown))
    return points


@pytest.mark.parametrize("scale", [1.0, 0.8])
def test_the_slope_is_minus_the_scale_of_the_depth(scale: float) -> None:
    found = flown_at_wall(scale).slopes(least_span_m=2.0)
    assert len(found.slopes) > 50
    assert found.median == pytest.approx(-scale, abs=1e-5)


def test_short_tracks_are_left_out() -> None:
    assert len(flown_at_wall(1.0).slopes(least_span_m=10.0).slopes) == 0


def test_unknown_depth_makes_no_tracks() -> None:
    points = TrackedPoints()
    image = np.random.default_rng(0).integers(0, 256, (64, 64, 3)).astype(np.uint8)
    for flown in range(30):
        points.add(image, np.full((64, 64), np.nan, np.float32), float(flown))
    assert np.isnan(points.slopes(least_span_m=1.0).median)


STILL = np.random.default_rng(3).integers(0, 256, (64, 64, 3)).astype(np.uint8)
FLOWN = np.arange(15) / 2


def seen_still(depths_m, flown_m=FLOWN, least_span_m: float = 1.0) -> Slopes:
    """Slopes of points that stay where they are in the picture, of maps [h, w] or numbers, one a frame."""
    points = TrackedPoints()
    for depth_m, flown in zip(depths_m, flown_m, strict=True):
        points.add(STILL, np.broadcast_to(np.float32(depth_m), (64, 64)), float(flown))
    return points.slopes(least_span_m=least_span_m)


def test_fifteen_depths_make_a_slope_and_fourteen_none() -> None:
    found = seen_still(20 - FLOWN)
    assert found.median == pytest.approx(-1, abs=1e-5)
    assert (found.first_m == 20).all()
    assert seen_still(20 - FLOWN[:14], FLOWN[:14]).slopes.size == 0


def test_the_span_is_what_was_flown_while_a_point_was_seen() -> None:
    assert seen_still(20 - FLOWN, FLOWN + 50, least_span_m=7.0).slopes.size > 0
    assert seen_still(20 - FLOWN, FLOWN + 50, least_span_m=7.1).slopes.size == 0


def test_a_depth_that_is_wrong_now_and_then_hardly_moves_the_slope() -> None:
    """Two of fifteen frames 30 m too far: the median of the pairs' slopes stays, their mean would not."""
    wrong = np.isin(np.arange(15), (4, 9))
    assert seen_still(20 - FLOWN + 30 * wrong).median == pytest.approx(-1, abs=0.2)


def test_frames_near_each_other_do_not_count_for_the_slope() -> None:
    """Twelve frames in a fifth of a metre, in which depth rises by one; then 9 m in which it falls by 9."""
    flown_m = np.concatenate([np.arange(12) * 0.02, [3.0, 6.0, 9.0]])
    depth_m = np.where(flown_m < 1, 20 + 5 * flown_m, 20 - flown_m)
    assert seen_still(depth_m, flown_m).median == pytest.approx(-1, abs=0.2)


def test_a_depth_is_the_median_of_what_is_round_a_point() -> None:
    """Half of the pixels beside each other are 100 m away, in a pattern that is another in each frame."""
    rng = np.random.default_rng(0)
    depths_m = [np.where(rng.random((64, 64)) < 0.1, 100, 20 - flown) for flown in FLOWN]
    assert seen_still(depths_m).slopes == pytest.approx(-1, abs=1e-5)


def test_where_more_than_half_round_a_point_is_unknown_there_is_no_depth() -> None:
    """Two pixels in five columns are known."""
    known = np.arange(64) % 5 < 2
    assert seen_still([np.where(known, 20 - flown, np.nan) for flown in FLOWN]).slopes.size == 0
    assert seen_still([np.where(~known, 20 - flown, np.nan) for flown in FLOWN]).slopes.size > 0


def test_new_points_are_apart_from_those_that_are_followed() -> None:
    """By 10 px: no more than fit into 64 x 64, though they are looked for in each frame."""
    flown_m = np.arange(20) / 2
    assert 5 < seen_still(20 - flown_m, flown_m).slopes.size <= 36


def test_a_point_that_is_lost_is_not_followed_on() -> None:
    """Another picture after each frame: where Lucas and Kanade end is not where they began."""
    rng, points = np.random.default_rng(5), TrackedPoints()
    for flown in FLOWN:
        points.add(
            rng.integers(0, 256, (64, 64, 3)).astype(np.uint8),
            np.full((64, 64), 20 - flown, np.float32),
            float(flown),
        )
    assert points.slopes(least_span_m=1.0).slopes.size == 0


def test_a_track_belongs_to_the_depth_at_which_it_began() -> None:
    found = slopes_of(np.array([-1.0, -2.0, -3.0]), np.array([5.0, 10.0, 20.0]))
    part = found.between(5, 20)
    assert (part.median, part.first_m.tolist()) == (-1.5, [5, 10])


def test_a_speed_that_changes_counts_half_before_and_half_after() -> None:
    path = PathLength()
    for second, speed in enumerate((4.0, 0.0, 0.0)):
        path.add(second * 10**9, speed)
    assert path.at(2 * 10**9) == pytest.approx(2.0)


def test_the_interval_holds_the_median_and_narrows_with_tracks() -> None:
    rng = np.random.default_rng(1)
    few, many = (slopes_of(s, s) for s in (rng.normal(-1, 0.2, 20), rng.normal(-1, 0.2, 2000)))
    assert few.low <= few.median <= few.high
    assert many.high - many.low < few.high - few.low


def test_the_path_is_the_integral_of_the_speed() -> None:
    path = PathLength()
    for second in range(5):
        path.add(second * 10**9, 2.0 * second)
    assert path.at(4 * 10**9) == pytest.approx(16.0)
    assert path.at(3_500_000_000) == pytest.approx((9.0 + 16.0) / 2)


def test_outside_the_log_the_path_is_unknown() -> None:
    path = PathLength()
    assert path.at(0) is None
    path.add(10, 1.0)
    path.add(20, 1.0)
    assert path.at(9) is None
    assert path.at(21) is None


def test_a_point_that_is_seen_for_long_is_fitted_at_some_hundred_of_its_depths() -> None:
    """With all 9,000 of five minutes a fit took five seconds and 1.4 GB."""
    assert [len(_thinned([1.0] * count)) for count in (15, 600, 601, 9000)] == [15, 600, 301, 600]
    flown_m = np.linspace(0, 60, 1500)
    found = seen_still(100 - 0.9 * flown_m, flown_m)
    assert found.median == pytest.approx(-0.9, abs=1e-4)
