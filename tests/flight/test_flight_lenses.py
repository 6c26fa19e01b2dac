import math

import pytest

from flightdepth.errors import BadInput
from flightdepth.flight.lenses import (
    HALF_DIAGONAL_35MM,
    find_lens,
    fov_of_equivalent_deg,
    known_lenses,
    millimetres,
)

LENSES = known_lenses()


def test_names_are_unique():
    assert len({lens.name for lens in LENSES}) == len(LENSES)


@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: lens.name)
def test_each_entry_tells_its_lens_in_one_way_and_where_it_is_from(lens):
    assert sum(value is not None for value in (lens.hfov_deg, lens.equivalent_mm, lens.focal)) == 1
    assert "." in lens.source
    assert lens.mode
    assert 40 < lens.horizontal_fov_deg < 160


@pytest.mark.parametrize("lens", [lens for lens in LENSES if lens.diagonal_deg], ids=lambda lens: lens.name)
def test_the_makers_diagonal_agrees_with_the_makers_equivalent(lens):
    diagonal_deg = 2 * math.degrees(math.atan(HALF_DIAGONAL_35MM / lens.equivalent_mm))
    assert diagonal_deg == pytest.approx(lens.diagonal_deg, abs=2.1)


def test_the_diagonal_of_an_equivalent_by_hand():
    # 24 mm on 36x24: 73.7 degrees across, the figure of every lens table.
    assert fov_of_equivalent_deg(24, (3, 2)) == pytest.approx(73.74, abs=0.01)


@pytest.mark.parametrize("mode", ["linear", "wide"])
def test_hypersmooth_narrows_the_view_by_the_published_crop(mode):
    crop = {"linear": 0.913, "wide": 0.928}[mode]
    focal = [find_lens(f"gopro-hero11-{mode}{end}").seen(1920, 1080).fx for end in ("", "-hypersmooth")]
    assert focal[0] / focal[1] == pytest.approx(crop, abs=0.002)


def test_a_lens_scales_with_the_picture():
    lens = find_lens("dji-mini-2")
    assert lens.seen(3840, 2160).fx == pytest.approx(2 * lens.seen(1920, 1080).fx)


@pytest.mark.parametrize("name", ["gopro-hero11-linear", "dji-mini-2"])
def test_a_lens_looks_through_the_middle_of_the_picture(name):
    camera = find_lens(name).seen(1920, 1080)
    assert (camera.cx, camera.cy) == (959.5, 539.5)


@pytest.mark.parametrize(
    ("told", "expected"),
    [("26.00MM", 26.0), (24, 24.0), ("0", None), (5000, None), ("nan", None), ("wide", None)],
)
def test_an_equivalent_is_millimetres_that_a_lens_may_have(told, expected):
    assert millimetres(told) == expected


@pytest.mark.parametrize(
    ("name", "size"),
    [
        ("gopro-hero5-linear", (1920, 1440)),
        ("gopro-hero10-wide", (5312, 2988)),
        ("raspberry-pi-2", (1920, 1080)),
    ],
)
def test_another_mode_is_refused(name, size):
    with pytest.raises(BadInput, match=r"the mode it holds for.*--hfov"):
        find_lens(name).seen(*size)


def test_a_name_that_nearly_fits_is_helped():
    with pytest.raises(BadInput, match=r"Near: .*dji-mini-2"):
        find_lens("dji-mini2")
    with pytest.raises(BadInput, match="flightdepth cameras"):
        find_lens("zzzz")
