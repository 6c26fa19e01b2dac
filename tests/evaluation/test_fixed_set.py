"""Which fixed test set belongs to a network."""

from dataclasses import replace

import numpy as np
import pytest

from flightdepth.errors import BadInput
from flightdepth.evaluation.fixed_set import fixed_set, outdoor_set, set_name
from flightdepth.evaluation.pairs import Task
from flightdepth.scenes import StillBoxConfig, Textures
from flightdepth.stillbox import Picture
from flightdepth.weights.store import find_network, read_card, shipped_networks
from tests_networks import difference_card
from tests_textures import few_textures


def test_pictures_are_as_wide_as_90_degrees_at_the_card_s_focal_length():
    pairs = fixed_set(difference_card(width=128, height=64, focal_px=64.0))
    assert pairs.picture == Picture(128, 128, 128)
    assert len(pairs) == 300


def test_of_wide_pictures_crops_are_measured_whatever_size_was_trained_on():
    assert fixed_set(difference_card(width=320, height=192, focal_px=256.0)).picture == Picture(256, 256, 512)


@pytest.mark.parametrize(  # 64, 128 and 256 px through 110 degrees; crops of 100, 160 and 300 px
    ("focal_px", "px"), [(22.4, 64), (44.8, 64), (89.6, 192), (50.0, 128), (80.0, 128), (150.0, 256)]
)
def test_a_network_of_any_focal_length_has_a_test_set(focal_px, px):
    """Once a recipe with `horizontal_fov_deg = 110` trained to its end, and could not be exported."""
    card = difference_card(focal_px=focal_px)
    rooms, outdoors = fixed_set(card, scenes=1, textures=few_textures()), outdoor_set(card, scenes=1)
    assert rooms.picture.width == px
    for pair in (rooms.pair(0), outdoors.pair(0)):
        assert Task.of(pair, card).camera.fx == pytest.approx(focal_px, rel=0.01)


def test_a_name_tells_a_lens_of_another_angle():
    card = difference_card(focal_px=89.6)
    assert set_name(fixed_set(card)) == "Still Box 192 px, shift 3, 93.95 degrees"
    assert set_name(outdoor_set(card, scenes=1)) == "outdoor flights 192 px, 93.95 degrees"


def test_the_rule_is_the_network_s():
    rule = fixed_set(difference_card(nominal_shift=5, depth_min_m=10.0, depth_max_m=60.0)).rule
    assert (rule.nominal_shift, rule.depth_min_m, rule.depth_max_m) == (5, 10, 60)


def test_pairs_are_as_far_apart_as_in_training():
    """Once a recipe with `speed_m_s = 5` was measured 0.3 m apart, five times nearer than it had learnt."""
    own = fixed_set(difference_card(D0_m=1.5), scenes=1)
    assert np.linalg.norm(replace(own, textures=few_textures()).pair(0).displacement) == pytest.approx(1.5)
    assert set_name(own) == "Still Box 64 px, shift 3 of 0.5 m"
    usual = fixed_set(difference_card(D0_m=3 * 0.1), scenes=1)
    assert usual.config == StillBoxConfig()


def test_pairs_for_any_lens_are_as_far_apart_as_in_training():
    """One of a recipe with `speed_m_s = 5` was measured 0.3 m apart."""
    own = fixed_set(any_lens(D0_m=0.75), scenes=1)  # 1.5 m at the set's 128 px
    pair = replace(own, textures=few_textures()).pair(0)
    assert np.linalg.norm(pair.displacement) == pytest.approx(1.5)
    assert np.linalg.norm(Task.of(pair, any_lens(D0_m=0.75)).nominal - pair.displacement) < 1e-6
    assert set_name(own) == "Still Box 256 px, shift 3 of 0.5 m"


@pytest.mark.parametrize("name", shipped_networks())
def test_the_sets_of_networks_that_ship_are_0_1_m_a_frame(name):
    assert fixed_set(read_card(find_network(name)), scenes=1).config == StillBoxConfig()


def test_pictures_as_large_as_flights_are_seen():
    """The same rooms twice as fine, half as far apart: points move by as many pixels."""
    card = any_lens()
    few = few_textures()
    usual, fine = (fixed_set(card, scenes=1, textures=few, flight_size=fine) for fine in (False, True))
    assert fine.picture.width == 2 * usual.picture.width
    pairs = usual.pair(0), fine.pair(0)
    assert pairs[1].focal_px == pytest.approx(card.focal_px)
    px = [np.linalg.norm(pair.displacement) * pair.focal_px for pair in pairs]
    assert px[1] == pytest.approx(px[0])
    outdoors = outdoor_set(card, scenes=1), outdoor_set(card, scenes=1, flight_size=True)
    assert [pairs.pair(0).focal_px / card.focal_px for pairs in outdoors] == pytest.approx([0.5, 1])
    slow, usual_speed = (np.array(pairs.config.speed_m_s) for pairs in reversed(outdoors))
    assert usual_speed == pytest.approx(2 * slow)


def test_only_a_network_of_any_lens_sees_flights_larger():
    for pairs in (fixed_set, outdoor_set):
        with pytest.raises(BadInput, match="--flight-size"):
            pairs(difference_card(), scenes=1, flight_size=True)


def test_names_tell_sets_apart():
    card = difference_card(focal_px=256.0)
    assert set_name(fixed_set(card)) == "Still Box 256 px, crops of 512 px, shift 3"
    own = fixed_set(difference_card(), textures=Textures.procedural(1, 1))
    assert set_name(own) == f"Still Box 64 px, shift 3, own textures {own.textures.digest[:12]}"


def test_no_scenes_are_no_set():
    with pytest.raises(BadInput, match="at least 1, got 0"):
        fixed_set(difference_card(), scenes=0)
    with pytest.raises(BadInput, match="at least 1, got 0"):
        outdoor_set(any_lens(), scenes=0)


def test_a_lens_that_sees_behind_itself_is_refused():
    with pytest.raises(BadInput, match="horizontal_fov_deg"):
        fixed_set(any_lens(), horizontal_fov_deg=200.0)


def any_lens(**changes):
    return difference_card(**{"architecture": "MotionNet", "any_lens": True, "focal_px": 256.0} | changes)


@pytest.mark.parametrize(("focal_px", "px"), [(128, 128), (256, 256), (200, 192), (20, 64)])
def test_a_network_for_any_lens_sees_90_degrees_half_as_fine_as_on_flights(focal_px, px):
    card = any_lens(focal_px=float(focal_px))
    assert fixed_set(card).picture == Picture(px, px, px)
    assert outdoor_set(card, scenes=1).width == px


def test_another_lens_is_for_networks_that_know_any():
    pair = fixed_set(any_lens(), scenes=1, textures=few_textures(), horizontal_fov_deg=60.0).pair(0)
    assert pair.focal_px == pytest.approx(128 / np.tan(np.radians(30)))
    with pytest.raises(BadInput, match="expected 90 degrees, its own"):
        fixed_set(difference_card(), horizontal_fov_deg=60.0)


def test_outdoor_pairs_have_a_sky_and_move_half_a_metre():
    pairs = outdoor_set(difference_card(focal_px=64.0), scenes=4)
    assert set_name(pairs) == "outdoor flights 128 px"
    for pair in pairs:
        assert pair.depth_m.shape == (128, 128)
        assert 0.35 < np.linalg.norm(pair.displacement) < 0.7
        assert np.isinf(pair.depth_m).any()
        assert pair.depth_m.min() > 1
