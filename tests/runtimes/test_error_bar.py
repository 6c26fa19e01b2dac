"""What the error bar is multiplied by: the card's scale, and more the more of the picture is sky, and the finer."""

import numpy as np
import pytest

from flightdepth.ranges.fusion import ends
from flightdepth.runtimes.error_bar import (
    LEAST_BETA,
    SKY_BETA,
    USUAL_BETA,
    USUAL_FOCAL_PX,
    error_bar_scale,
    sky_share,
)
from flightdepth.weights.store import SHIPPED, read_card

CARD = read_card(SHIPPED / "motion.onnx").model_copy(
    update={"sigma_scale": 0.8, "sigma_growth": 0.5, "sigma_far": 0.0, "sigma_lens": 0.2}
)
VALID = np.array([[True, True, True, True, False]])


def pictures(*sky, rest=0.2):
    """As many of four valid pixels sky, in pictures whose padding is sky too."""
    return np.array([[[SKY_BETA] * k + [rest] * (4 - k) + [1.0]] for k in sky], np.float32)


def test_each_pair_has_the_share_of_its_own_pixels():
    assert sky_share(pictures(0, 1, 4), VALID).tolist() == [0.0, 0.25, 1.0]


def test_the_scale_grows_with_that_share():
    found = error_bar_scale(CARD, pictures(0, 1, 4), VALID, USUAL_FOCAL_PX)
    assert found.shape == (3, 1, 5) and found.dtype == np.float32
    expected = 0.8 * np.exp(np.array([0, 0.125, 0.5]))[:, None, None]
    assert found == pytest.approx(np.broadcast_to(expected, found.shape), rel=1e-6)


def test_under_a_sky_it_grows_with_the_output_by_a_power_and_in_a_room_it_does_not():
    steep = CARD.model_copy(update={"sigma_far": 0.6})
    room, sky = error_bar_scale(steep, pictures(0, 2, rest=USUAL_BETA * np.e), VALID, USUAL_FOCAL_PX)
    assert room == pytest.approx(np.full((1, 5), 0.8), rel=1e-6)
    # Half of it is sky, the rest e times as far as usual.
    assert sky[0, 2:4] == pytest.approx(0.8 * np.exp(0.25 + 0.3), rel=1e-6)
    nearer = error_bar_scale(steep, pictures(2, rest=USUAL_BETA / np.e), VALID, USUAL_FOCAL_PX)
    assert nearer[0, 0, 2:4] == pytest.approx(0.8 * np.exp(0.25 - 0.3), rel=1e-6)


@pytest.mark.parametrize("rest", [LEAST_BETA, LEAST_BETA / 2, 0.0])
def test_what_is_nearest_has_a_bar_too(rest):
    steep = CARD.model_copy(update={"sigma_far": 0.6})
    found = error_bar_scale(steep, pictures(2, rest=rest), VALID, USUAL_FOCAL_PX)
    assert found[0, 0, 2] == pytest.approx(0.8 * np.exp(0.25) * (LEAST_BETA / USUAL_BETA) ** 0.3, rel=1e-5)


@pytest.mark.parametrize("wall", [ends(CARD)[1], 0.75, SKY_BETA - 1e-3])
def test_far_walls_of_a_room_are_no_sky(wall):
    """Through 110 degrees an eighth of a room is as far as that, and bars were 5 % too wide there."""
    assert error_bar_scale(CARD, pictures(0, 1, rest=wall), VALID, 90.0) == pytest.approx(
        error_bar_scale(CARD, pictures(0, 1), VALID, 90.0)
    )


def test_sky_begins_at_nine_tenths_of_the_largest_depth():
    assert sky_share(np.array([[[0.89, 0.91, 0.95, 1.0, 1.0]]], np.float32), VALID).tolist() == [0.75]


def test_a_hundredth_of_the_largest_depth_is_the_nearest_that_counts():
    steep = CARD.model_copy(update={"sigma_far": 0.6})
    at = [error_bar_scale(steep, pictures(2, rest=beta), VALID, 256.0)[0, 0, 2] for beta in (0.01, 0.02, 0.1)]
    assert at / at[2] == pytest.approx(np.array([0.1**0.3, 0.2**0.3, 1]), rel=1e-5)


def test_sky_is_beyond_what_fusion_takes_for_a_bound():
    assert ends(CARD)[1] < SKY_BETA


def test_the_scale_grows_with_the_focal_length():
    """Through 60 degrees, as flights are seen, 61 % of the errors had been inside one sigma, through 110 73."""
    at = [error_bar_scale(CARD, pictures(1), VALID, focal_px)[0, 0, 1] for focal_px in (128.0, 256.0, 512.0)]
    assert at == pytest.approx(np.array([2**-0.2, 1, 2**0.2]) * 0.8 * np.exp(0.125), rel=1e-6)


@pytest.mark.parametrize("name", ["motion", "motion-tiny"])
def test_a_shipped_network_s_bar_is_larger_in_the_open(name):
    card = read_card(SHIPPED / f"{name}.onnx")
    assert 0.2 < card.sigma_growth + card.sigma_far * np.log(0.2 / USUAL_BETA) < 1.2  # of an output of .2
    assert 0.7 < card.sigma_scale < 1
    assert 0 <= card.sigma_lens < 0.4
    assert 0.2 < card.sigma_far < 1.2


def test_a_network_that_has_not_learnt_from_fine_pictures_has_larger_errors_there():
    assert read_card(SHIPPED / "motion.onnx").sigma_lens > 0.05
