import math

import numpy as np
import pytest

from flightdepth.errors import BadInput
from flightdepth.outputs.encoding import centimetres_from_depth
from flightdepth.outputs.palette import (
    FARTHER_HATCH,
    NEARER_HATCH,
    UNKNOWN_HATCH,
    DepthScale,
    Palette,
    coloured,
    steps_of,
)

SCALE = DepthScale(1, 100)


def paint(depths_m):
    stored = centimetres_from_depth(np.array([depths_m], np.float32))
    return Palette(SCALE).paint(stored)[0].astype(int)


def test_nearer_is_brighter():
    brightness = paint(np.geomspace(1, 100, 40)).sum(axis=1)
    assert (np.diff(brightness) < 0).all()


def test_the_same_ratio_is_the_same_step():
    assert math.isclose(SCALE.position(2) - SCALE.position(4), SCALE.position(20) - SCALE.position(40))


@pytest.mark.parametrize(("depth_m", "position"), [(1, 1.0), (10, 0.5), (100, 0.0), (0.1, 1.0), (900, 0.0)])
def test_position_by_hand(depth_m, position):
    assert SCALE.position(depth_m) == pytest.approx(position)


@pytest.mark.parametrize(("step", "rgb"), [(0, (0, 0, 4)), (128, (188, 55, 84)), (255, (252, 255, 164))])
def test_the_colours_are_matplotlibs_inferno(step, rgb):
    assert coloured(np.full((1, 1), step, np.uint8))[0, 0] == pytest.approx(rgb, abs=3)


def test_beyond_the_ends_the_colour_stays():
    colours = paint([0.3, 1, 100, 600])
    assert (colours[0] == colours[1]).all()
    assert (colours[2] == colours[3]).all()


def test_depth_has_the_colour_of_the_scale_bar():
    bar = coloured(steps_of(np.array([[SCALE.position(10)]])))[0, 0]
    assert np.abs(paint([10.0])[0] - bar).max() <= 1


def test_a_scale_that_begins_farther_off_colours_as_its_bar_too():
    scale = DepthScale(4, 100)
    stored = centimetres_from_depth(np.array([[4.0, 20.0, 100.0]], np.float32))
    bar = coloured(steps_of(np.array([[1, 0.5, 0]])))  # 20 is halfway from 4 to 100
    assert np.abs(Palette(scale).paint(stored).astype(int) - bar).max() <= 1


@pytest.mark.parametrize("hatch", [UNKNOWN_HATCH, FARTHER_HATCH, NEARER_HATCH])
def test_no_depth_looks_like_a_hatch(hatch):
    every = coloured(np.arange(256, dtype=np.uint8)[None])[0].astype(int)
    for colour in (hatch.ground_rgb, hatch.line_rgb):
        assert np.abs(every - colour).max(axis=1).min() > 20


def test_bounds_show_only_where_depth_is_unknown():
    depth_m = np.full((40, 60), np.nan, np.float32)
    depth_m[:, 40:] = 10
    farther = np.zeros((40, 60), np.bool_)
    farther[:, 20:] = True
    picture = Palette(SCALE).paint(centimetres_from_depth(depth_m), farther)
    assert (picture[:, :20] == UNKNOWN_HATCH.picture(60, 40)[:, :20]).all()
    assert (picture[:, 20:40] == FARTHER_HATCH.picture(60, 40)[:, 20:40]).all()
    assert (picture[:, 40:] == paint([10.0])[0]).all()


def test_a_nearer_bound_has_its_own_hatch():
    picture = Palette(SCALE).paint(np.zeros((40, 60), np.uint16), nearer=np.ones((40, 60), np.bool_))
    assert (picture == NEARER_HATCH.picture(60, 40)).all()


def test_ticks_lie_within_the_scale():
    assert DepthScale(2, 100).ticks_m == (2, 5, 10, 20, 50, 100)


@pytest.mark.parametrize("ends", [(0, 10), (10, 10), (1, 700), (float("nan"), 10)])
def test_a_scale_that_is_none_is_refused(ends):
    with pytest.raises(BadInput, match="depth scale"):
        DepthScale(*ends)
