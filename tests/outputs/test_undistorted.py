"""Laws of what an ideal lens would have filmed."""

import cv2
import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.outputs.undistorted import all_in_view, centred, ideal_view, map_through, picture_through
from flightdepth.runtimes.lens import pixel_rays

WIDTH, HEIGHT = 320, 200
LENSES = {
    "barrel": Camera(WIDTH, HEIGHT, 210, 205, 150, 104, (-0.2, 0.04, 0.001, -0.002, -0.003)),
    "pincushion": Camera(WIDTH, HEIGHT, 300, 300, 161, 98, (0.1, 0.02, 0, 0)),
    "rational": Camera(WIDTH, HEIGHT, 220, 220, 160, 100, (0.1, -0.05, 0, 0, 0.01, 0.3, -0.02, 0.01)),
    "thin prism": Camera(
        WIDTH, HEIGHT, 220, 220, 160, 100, (-0.1, 0.01, 0, 0, 0, 0, 0, 0, 0.01, 0, -0.01, 0)
    ),
    "fisheye": Camera(WIDTH, HEIGHT, 120, 120, 164, 97, (0.02, -0.01, 0.002, 0), "fisheye"),
    "wide fisheye": Camera.from_fov(WIDTH, HEIGHT, 190, model="fisheye"),
}
every_lens = pytest.mark.parametrize("lens", LENSES.values(), ids=list(LENSES))


def plane_m(rays):
    """Depth of a slanted plane along rays [..., 3] with z = 1, metres."""
    return 20 / (1 + 0.2 * rays[..., 0] - 0.3 * rays[..., 1])


def seen_by(lens):
    rays = pixel_rays(lens, 1)
    known = np.isfinite(rays).all(axis=-1) & (np.abs(rays[..., :2]) < 2.5).all(axis=-1)
    return np.where(known, plane_m(np.where(known[..., None], rays, 0)), np.nan).astype(np.float32)


@every_lens
def test_a_slanted_plane_stays_where_it_is(lens):
    """Depth at each pixel of the ideal lens is that of its own ray, or of one a pixel beside it as filmed."""
    ideal, seen_m = ideal_view(lens), seen_by(lens)
    window, true_m = np.ones((3, 3), np.uint8), plane_m(ideal.rays())
    nearest_m = cv2.erode(np.nan_to_num(seen_m, nan=0.0), window)
    farthest_m = cv2.dilate(np.nan_to_num(seen_m, nan=1e3), window)
    assert np.isfinite(map_through(ideal, seen_m, lens)).all()
    inner = np.s_[3:-3, 3:-3]  # a pixel at the rim has none beside it on one side
    assert (map_through(ideal, nearest_m, lens) <= true_m)[inner].all()
    assert (map_through(ideal, farthest_m, lens) >= true_m)[inner].all()


@every_lens
@pytest.mark.parametrize("times", [1, 0.5])
def test_a_picture_shows_each_ray_where_the_ideal_lens_sees_it(lens, times):
    """At a picture's own size too, smaller than the lens is told for."""
    own = lens.resized(round(times * WIDTH), round(times * HEIGHT))
    ideal = ideal_view(lens).resized(own.width, own.height)
    shade = np.nan_to_num(4 * seen_by(own)).astype(np.uint8)
    shown = picture_through(ideal, np.repeat(shade[..., None], 3, axis=2), lens)
    assert shown.shape == (own.height, own.width, 3)
    true = 4 * plane_m(ideal.rays())
    assert np.median(np.abs(shown[..., 0] - true)) < 1  # bytes are cut off
    assert np.percentile(np.abs(shown[..., 0] - true), 99) < 1 + 2 * np.abs(np.diff(true, axis=1)).max()


@every_lens
def test_it_sees_all_that_a_centred_rectangle_can(lens):
    ideal = ideal_view(lens)
    assert (ideal.is_ideal, ideal.width, ideal.height) == (True, WIDTH, HEIGHT)
    assert (ideal.cx, ideal.cy) == ((WIDTH - 1) / 2, (HEIGHT - 1) / 2)
    assert all_in_view(ideal, lens)
    if ideal.horizontal_fov_deg < 119:
        assert not all_in_view(centred(ideal, 0.99), lens)


def test_a_fisheye_is_cut_at_sixty_degrees():
    assert ideal_view(LENSES["wide fisheye"]).horizontal_fov_deg == pytest.approx(120)


def test_an_ideal_lens_stays_as_it_is():
    """Pictures and maps too, byte for byte, wherever its axis stands."""
    lens = Camera(WIDTH, HEIGHT, 210, 205, 140, 110, (0.0,) * 5)
    assert ideal_view(lens) == lens.without_distortion()
    depth_m, picture = seen_by(lens), np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    assert map_through(ideal_view(lens), depth_m, lens) is depth_m
    assert picture_through(ideal_view(lens), picture, lens) is picture


def test_a_lens_whose_axis_is_out_of_its_picture():
    with pytest.raises(BadInput, match="what lies on its axis"):
        ideal_view(Camera(WIDTH, HEIGHT, 200, 200, -80, 100, (-0.1, 0, 0, 0)))
