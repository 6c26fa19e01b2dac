"""What --camera and --hfov of `flightdepth live` mean for pictures of each size."""

from pathlib import Path

import pytest

from flightdepth.errors import BadInput
from flightdepth.flight.lenses import find_lens
from flightdepth.live.depth_stage import Lens

NAME = "gopro-hero11-linear"


def test_a_name_of_the_table_is_that_lens():
    assert Lens.given(Path(NAME), None).at(1920, 1080) == find_lens(NAME).seen(1920, 1080)


def test_a_field_of_view_holds_for_any_size():
    lens = Lens.given(None, 80.0)
    assert {round(lens.at(*size).horizontal_fov_deg, 6) for size in [(640, 480), (1280, 720)]} == {80.0}


def test_a_name_that_no_one_knows_is_refused():
    with pytest.raises(BadInput, match="gopro-hero11"):
        Lens.given(Path("gopro-hero11-liner"), None)


@pytest.mark.parametrize("given", [(None, None), (Path(NAME), 80.0)])
def test_one_of_the_two_is_needed(given):
    with pytest.raises(BadInput, match="one of them"):
        Lens.given(*given)
