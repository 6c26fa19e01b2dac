"""Wrong motion: what each kind does to a network that looks along it, and to one that knows its length alone."""

import pytest
from plane_pairs import plane_pair
from test_evaluate_network import Constant

from flightdepth.camera import Camera
from flightdepth.errors import BadInput
from flightdepth.evaluation.noise import DEROTATED, KINDS, noise_rows
from flightdepth.runtimes.network import Network
from tests_networks import BestHypothesis, difference_card, swept_card

CAMERA = Camera.from_fov(128, 64, 90)
DIRECTION, SPEED, ROTATION = KINDS
MENDED = DEROTATED.format("best-hypothesis")


@pytest.fixture(scope="module")
def rows():
    depth_m = 64 * 0.3 / 2.0
    moves = [(0.3, 0.0, 0.0), (0.0, -0.3, 0.0), (-0.2, 0.2236, 0.0)]
    pairs = [plane_pair(CAMERA, move, distance_m=depth_m, seed=seed) for seed, move in enumerate(moves)]
    flat = Network(difference_card(focal_px=64.0, depth_min_m=0.0, depth_max_m=100.0), Constant(depth_m))
    found = noise_rows([Network(swept_card(), BestHypothesis()), flat], pairs)
    return {(row["kind"], row["size"]): row for row in found}


def test_the_sweep_finds_the_plane_when_all_is_right(rows):
    """Along the border the earlier picture lacks what is seen; elsewhere each pixel is right."""
    assert all(rows[kind, 0.0]["best-hypothesis"] < 0.7 for kind in KINDS)


def test_a_wrong_direction_harms_who_looks_along_it_only(rows):
    swept = [rows[DIRECTION, size]["best-hypothesis"] for size in KINDS[DIRECTION]]
    assert swept[-1] > 2 * swept[0]
    flat = {round(rows[DIRECTION, size]["difference"], 6) for size in KINDS[DIRECTION]}
    assert len(flat) == 1


def test_a_wrong_speed_is_a_wrong_scale(rows):
    assert rows[SPEED, 0.1]["difference"] == pytest.approx(0.96, abs=0.02)
    assert rows[SPEED, 0.1]["best-hypothesis"] == pytest.approx(0.96, abs=0.5)


def test_an_unreported_rotation_harms_the_sweep(rows):
    swept = [rows[ROTATION, size]["best-hypothesis"] for size in KINDS[ROTATION]]
    assert swept[-1] > 1.5 * swept[0]


def test_what_the_pictures_show_of_it_is_mended():
    """A box of many depths would do better; even a plane shows half a degree about two axes."""
    pairs = [plane_pair(CAMERA, (0.1, 0.2, 0.2), distance_m=9.6, seed=seed) for seed in range(2)]
    rows = noise_rows([Network(swept_card(), BestHypothesis())], pairs, derotate=True)
    found = {(row["kind"], row["size"]): (row["best-hypothesis"], row[MENDED]) for row in rows}
    assert found[ROTATION, 0.5][1] < 0.7 * found[ROTATION, 0.5][0]
    assert found[ROTATION, 0.0][1] == pytest.approx(found[ROTATION, 0.0][0], rel=0.1)
    assert found[SPEED, 0.1][1] == pytest.approx(found[SPEED, 0.1][0], rel=0.1)


def test_all_networks_are_asked_about_the_same_wrong_pairs():
    """Each had errors of its own: columns that could not be compared."""
    card = swept_card()
    twins = [Network(card.model_copy(update={"name": name}), BestHypothesis()) for name in ("one", "other")]
    pairs = [plane_pair(CAMERA, (0.3, 0.0, 0.0), distance_m=10.0)]
    for row in noise_rows(twins, pairs, derotate=True):
        assert row["one"] == row["other"]
        assert row[DEROTATED.format("one")] == row[DEROTATED.format("other")]


def test_two_networks_of_one_name_are_no_two_columns():
    flat = Network(difference_card(focal_px=64.0), Constant(9.6))
    with pytest.raises(BadInput, match="different names, got difference, difference"):
        noise_rows([flat, flat], [])


@pytest.mark.parametrize("other", [{"depth_max_m": 60.0}, {"depth_min_m": 10.0}, {"D0_m": 0.5}])
def test_errors_in_other_metres_do_not_stand_side_by_side(other):
    """Once a network clamped to 10-60 m at 0.5 m had its L1 beside that of one for 0-100 m at 0.3 m."""
    cards = (difference_card(focal_px=64.0), difference_card(name="other", focal_px=64.0, **other))
    pair = plane_pair(CAMERA, (0.3, 0.0, 0.0), distance_m=9.6)
    with pytest.raises(BadInput, match="expected networks of one range, got difference 0 to 100 m"):
        noise_rows([Network(card, Constant(9.6)) for card in cards], [pair])
