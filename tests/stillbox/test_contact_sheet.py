"""The sheets that benchmarks/stillbox.py draws."""

import importlib
import sys
from pathlib import Path

import numpy as np

from flightdepth.renderers.raycast import render
from flightdepth.scenes import StillBoxConfig, Textures
from flightdepth.stillbox.sets import SceneSet

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
sheets = importlib.import_module("contact_sheet")
GAP, coloured_depth, contact_sheet = sheets.GAP, sheets.coloured_depth, sheets.contact_sheet

BLANK = Textures.from_images([])
SET = SceneSet(StillBoxConfig(), 16, 12, seed=3)
SHEET = contact_sheet(SET, BLANK, scenes=5, columns=2)


def test_three_rows_of_two_scenes():
    assert SHEET.shape == (3 * 12 + 2 * GAP, 2 * 32 + GAP, 3)


def test_each_scene_stands_in_its_place():
    seen = render(SET.scene(3, 0), BLANK, SET.camera, frames=[5])
    np.testing.assert_array_equal(SHEET[12 + GAP : 24 + GAP, 32 + GAP : 48 + GAP], seen.images[0])


def test_it_starts_where_it_is_told():
    np.testing.assert_array_equal(
        contact_sheet(SET, BLANK, scenes=1, columns=1, first=1), SHEET[:12, 32 + GAP :]
    )


def test_near_is_redder_than_far():
    near, far, sky = coloured_depth(np.array([[3.0, 80.0, np.inf]], np.float32))[0].astype(int)
    assert near[0] > near[2]
    assert far[2] > far[0]
    np.testing.assert_array_equal(sky, coloured_depth(np.array([[100.0]], np.float32))[0, 0])


def test_an_empty_place_stays_white():
    assert (SHEET[-12:, -32:] == 255).all()
