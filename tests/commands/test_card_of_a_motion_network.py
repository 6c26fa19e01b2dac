"""What the card of a network for any lens says of its training."""

import pytest

from flightdepth.commands.export import card_of
from flightdepth.training import load_recipe
from flightdepth.training.checkpoint import Progress
from flightdepth.training.run_folder import Trained


def test_the_card_tells_lenses_and_wrong_motion_of_each_stage(tmp_path):
    recipe = load_recipe("motion-tiny")
    done = Progress(recipe.name, recipe.digest, len(recipe.stages), 0, recipe.samples, 1.0)
    card = card_of(Trained(tmp_path / "checkpoint.safetensors", recipe, done, None), "motion-tiny")
    assert [stage.fov_deg for stage in card.stages] == [(60, 110), (55, 120), (60, 115), *[(55, 120)] * 3]
    assert [stage.direction_noise_deg for stage in card.stages] == [0, 5, 2, 2, 2, 2]
    assert [stage.rotation_noise_deg for stage in card.stages] == [0, 0.5, *[0.1] * 4]
    # 0.3 m at 128 px of focal length, written down for the 256 px that flights are shown at.
    assert (card.any_lens, card.focal_px, card.D0_m) == (True, 256, pytest.approx(0.15))
