import numpy as np

from flightdepth.camera import Camera
from flightdepth.renderers.raycast import render
from flightdepth.scenes import StillBoxConfig, Textures, draw_scene
from flightdepth.stillbox.contact_sheet import GAP, contact_sheet

BLANK = Textures.from_images([])
SHEET = contact_sheet(StillBoxConfig(), BLANK, 3, scenes=5, columns=2, width=16)


def test_three_rows_of_two_scenes():
    assert SHEET.shape == (3 * 16 + 2 * GAP, 2 * 32 + GAP, 3)


def test_each_scene_stands_in_its_place():
    seen = render(draw_scene(StillBoxConfig(), 0, 3, 3), BLANK, Camera.from_fov(16, 16, 90), frames=[5])
    np.testing.assert_array_equal(SHEET[16 + GAP : 32 + GAP, 32 + GAP : 48 + GAP], seen.images[0])


def test_near_is_redder_than_far():
    seen = render(draw_scene(StillBoxConfig(), 0, 3, 0), BLANK, Camera.from_fov(16, 16, 90), frames=[5])
    colour = SHEET[:16, 16:32].astype(int)
    redness = (colour[..., 0] - colour[..., 2]).ravel()
    depth_m = seen.depth_m[0].ravel()
    assert (
        redness[depth_m < np.percentile(depth_m, 20)].mean()
        > redness[depth_m > np.percentile(depth_m, 80)].mean()
    )


def test_an_empty_place_stays_white():
    assert (SHEET[-16:, -32:] == 255).all()
