import pytest

from flightdepth.flight.gopro_settings import GoproSettings
from flightdepth.flight.stabilisation import find_stabilisation


@pytest.mark.parametrize(
    ("tags", "name"),
    [
        ({"com.apple.quicktime.make": "Apple"}, "Apple"),
        ({"com.android.version": "14"}, "telephone"),
        ({"encoder": "DJI Avata 2"}, "RockSteady"),
        ({"encoder": "DJI Action 4"}, "RockSteady"),
    ],
)
def test_what_is_only_usual_is_said_to_be_so(tags, name):
    found = find_stabilisation(tags, None)
    assert not found.certain
    assert name in found.warning
    assert "the file does not tell" in found.warning


@pytest.mark.parametrize("tags", [{}, {"encoder": "DJI Mini 2"}, {"encoder": "Lavf62.0"}, {"make": "Sony"}])
def test_nothing_is_claimed_of_a_gimbal_or_an_unknown_maker(tags):
    assert find_stabilisation(tags, None) is None


def test_a_gopro_tells():
    on = GoproSettings("HERO9 Black", "L", stabilised=True, stabilisation="HS Boost")
    assert find_stabilisation({}, on).certain
    assert "HS Boost" in find_stabilisation({}, on).warning
    assert find_stabilisation({}, GoproSettings("HERO9 Black", "L", stabilised=False)) is None
    assert not find_stabilisation({}, GoproSettings("HERO5 Black")).certain
