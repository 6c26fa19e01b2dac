"""What the card of a network for any lens says of its training."""

import pytest

from flightdepth.commands.export import calibration_pairs, card_of, carried_over
from flightdepth.runtimes.devices import BF16_COST, BF16_COST_BEFORE
from flightdepth.training import load_recipe
from flightdepth.training.checkpoint import Progress
from flightdepth.training.run_folder import Trained
from flightdepth.weights.card import Predecessor
from tests_networks import difference_card


def test_the_card_tells_lenses_and_wrong_motion_of_each_stage(tmp_path):
    recipe = load_recipe("motion")
    done = Progress(recipe.name, recipe.digest, len(recipe.stages), 0, recipe.samples, 1.0)
    card = card_of(Trained(tmp_path / "checkpoint.safetensors", recipe, done, None), "motion")
    assert [stage.fov_deg for stage in card.stages] == [
        (60, 110),
        (55, 120),
        (60, 115),
        *[(55, 120)] * 18,
        *[(35, 120)] * 5,
    ]
    assert [stage.direction_noise_deg for stage in card.stages] == [0, 5, *[2] * 17, *[0.5] * 7]
    assert [stage.rotation_noise_deg for stage in card.stages] == [
        0,
        0.5,
        *[0.1] * 17,
        *[0.02] * 3,
        0,
        0,
        0,
        0,
    ]
    assert [stage.wide_share for stage in card.stages] == [
        *[0] * 11,
        *[0.25] * 8,
        0,
        0,
        0.1,
        0.2,
        0.2,
        0.2,
        0.2,
    ]
    # 0.3 m at 128 px of focal length, written down for the 256 px that flights are shown at.
    assert (card.any_lens, card.focal_px, card.D0_m) == (True, 256, pytest.approx(0.15))


def test_half_the_resolution_has_the_same_shift_in_pixels():
    motion, tiny = (load_recipe(name) for name in ("motion", "motion-tiny"))
    shifts_px = [recipe.nominal_shift * recipe.reference_focal_px for recipe in (motion, tiny)]
    assert shifts_px[0] == shifts_px[1]
    assert tiny.starts_from == motion.name


def test_a_run_that_started_from_one_lists_what_that_went_on_from(tmp_path):
    """motion-tiny starts from a run of motion, which went on from the shipped motion of its day."""
    recipe, tiny = load_recipe("motion"), load_recipe("motion-tiny")
    first = card_of(Trained(tmp_path / "a", recipe, Progress("", "", 2, 0, 184_000, 1.0), None), "motion")
    done = Progress("", "", len(recipe.stages), 0, recipe.samples, 1.0)
    run = Trained(tmp_path / "b", recipe, done, None, first)
    half = Trained(
        tmp_path / "c", tiny, Progress("", "", len(tiny.stages), 0, recipe.samples + tiny.samples, 1.0), run
    )
    assert [stage.name for stage in card_of(half, "motion-tiny").stages] == [
        stage.name for stage in (*recipe.stages, *tiny.stages)
    ]


def test_the_card_tells_what_shipped_before_and_its_error(tmp_path):
    recipe = load_recipe("motion")
    first = card_of(Trained(tmp_path / "a", recipe, Progress("", "", 2, 0, 184_000, 1.0), None), "motion")
    assert first.went_on_from is None
    first = first.model_copy(update={"metrics": {"l1_m": 3.5}, "sha256": "ab" * 32})
    done = Progress("", "", len(recipe.stages), 0, recipe.samples, 1.0)
    again = Trained(tmp_path / "b", recipe, done, None, first)
    before = Predecessor(sha256="ab" * 32, samples=184_000, l1_m=3.5)
    assert card_of(again, "motion").went_on_from == before
    assert card_of(again, "another").went_on_from is None


@pytest.mark.parametrize(
    ("metrics", "carried"),
    [
        ({BF16_COST: 0.002}, {BF16_COST_BEFORE: 0.002}),
        ({BF16_COST_BEFORE: 0.003}, {BF16_COST_BEFORE: 0.003}),
        ({}, {}),
    ],
)
def test_what_bf16_cost_the_weights_before_is_carried_over(tmp_path, metrics, carried):
    tiny = load_recipe("motion-tiny")
    done = Progress("", "", 1, 0, tiny.samples, 1.0)
    before = card_of(Trained(tmp_path / "a", tiny, done, None), "motion-tiny")
    before = before.model_copy(update={"metrics": metrics})
    assert carried_over(Trained(tmp_path / "b", tiny, done, None, before)) == carried
    assert carried_over(Trained(tmp_path / "c", load_recipe("motion"), done, None, before)) == {}
    assert carried_over(Trained(tmp_path / "d", tiny, done, None)) == {}


@pytest.mark.usefixtures("few_fixed_textures")
def test_half_of_the_pixels_that_the_error_bar_is_fitted_on_are_of_pictures_as_large_as_flights():
    """Fitted on the test set's size alone, `motion` held 63 % of the errors inside one sigma in flights' size."""
    card = difference_card(architecture="MotionNet", any_lens=True, focal_px=64.0)
    widths = [pair.current.shape[1] for pair in calibration_pairs(card, 8)]
    assert widths == [64] * 8 + [128] * 2


@pytest.mark.usefixtures("few_fixed_textures")
def test_the_error_bar_is_fitted_on_rooms_through_several_lenses():
    """Fitted through 90 degrees alone, `motion` held 61 % of the errors inside one sigma through 60."""
    card = difference_card(architecture="MotionNet", any_lens=True, focal_px=64.0)
    rooms = calibration_pairs(card, 8)[0:8:2]
    assert [round(pair.focal_px, 1) for pair in rooms] == [77.3, 55.4, 32.0, 22.4]
