"""Which fixed test set belongs to a network."""

import pytest

from flightdepth.errors import BadInput
from flightdepth.evaluation.fixed_set import fixed_set, set_name
from flightdepth.scenes import Textures
from flightdepth.stillbox import Picture
from flightdepth.weights.card import Stage
from tests_networks import difference_card


def stage(width, height, focal_px):
    facts = {"name": "s", "samples": 1, "batch": 1, "learning_rate": 1.0, "photometric": False}
    return Stage(width=width, height=height, focal_px=focal_px, **facts)


def test_without_stages_the_card_s_own_size_counts():
    pairs = fixed_set(difference_card(width=128, height=128, focal_px=64.0))
    assert pairs.picture == Picture(128, 128, 128)
    assert len(pairs) == 300


def test_the_last_square_stage_at_the_card_s_focal_length_counts():
    stages = (stage(512, 512, 128.0), stage(128, 128, 256.0), stage(256, 256, 256.0), stage(320, 192, 256.0))
    card = difference_card(width=320, height=192, focal_px=256.0, stages=stages)
    assert fixed_set(card).picture == Picture(256, 256, 512)


def test_without_a_square_stage_the_shorter_side_counts():
    card = difference_card(width=320, height=192, focal_px=256.0, stages=(stage(320, 192, 256.0),))
    assert fixed_set(card).picture == Picture(192, 192, 512)


def test_the_rule_is_the_network_s():
    rule = fixed_set(difference_card(nominal_shift=5, depth_min_m=10.0, depth_max_m=60.0)).rule
    assert (rule.nominal_shift, rule.depth_min_m, rule.depth_max_m) == (5, 10, 60)


def test_names_tell_sets_apart():
    card = difference_card(width=64, height=64, focal_px=64.0)
    assert set_name(fixed_set(card)) == "Still Box 64 px, crops of 128 px, shift 3"
    own = fixed_set(difference_card(), textures=Textures.procedural(1, 1))
    assert set_name(own) == "Still Box 64 px, shift 3, own textures"


def test_no_scenes_are_no_set():
    with pytest.raises(BadInput, match="at least 1, got 0"):
        fixed_set(difference_card(), scenes=0)
