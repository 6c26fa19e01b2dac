"""What the error bar is multiplied by: the card's scale, and more where more of the picture is far."""

import numpy as np
import pytest

from flightdepth.ranges.fusion import ends
from flightdepth.runtimes.error_bar import FAR_BETA, error_bar_scale, far_share
from flightdepth.weights.store import SHIPPED, read_card

CARD = read_card(SHIPPED / "motion.onnx").model_copy(update={"sigma_scale": 0.8, "sigma_growth": 0.5})
VALID = np.array([[True, True, True, True, False]])


def pictures(*far):
    """As many of four valid pixels far, in pictures whose padding is far too."""
    return np.array([[[FAR_BETA] * k + [0.2] * (4 - k) + [1.0]] for k in far], np.float32)


def test_each_pair_has_the_share_of_its_own_pixels():
    assert far_share(pictures(0, 1, 4), VALID).tolist() == [0.0, 0.25, 1.0]


def test_the_scale_grows_with_that_share():
    found = error_bar_scale(CARD, pictures(0, 1, 4), VALID)
    assert found.shape == (3, 1, 1)
    assert found.ravel() == pytest.approx([0.8, 0.8 * np.exp(0.125), 0.8 * np.exp(0.5)], rel=1e-6)


def test_what_is_far_is_what_fusion_takes_for_a_bound():
    assert ends(CARD)[1] == FAR_BETA


@pytest.mark.parametrize("name", ["motion", "motion-tiny"])
def test_a_shipped_network_s_bar_is_larger_in_the_open(name):
    card = read_card(SHIPPED / f"{name}.onnx")
    assert 0.2 < card.sigma_growth < 1.2
    assert 0.7 < card.sigma_scale < 1
