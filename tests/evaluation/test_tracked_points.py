"""Laws of the slope of depth against metres flown."""

import cv2
import numpy as np
import pytest

from flightdepth.evaluation.tracked_points import PathLength, TrackedPoints, slopes_of

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
