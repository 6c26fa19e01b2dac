import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from range_oracle import card

from flightdepth.ranges.clusters import MAX_SAMPLES, centroids, wanted_displacements
from tests_networks import swept_card

CARD = card()


def blobs(*depths: float) -> np.ndarray:
    rng = np.random.default_rng(1)
    noise = rng.normal(0, 0.2, (32, 32)).astype(np.float32)
    return (np.resize(depths, (32, 32)) + noise).astype(np.float32)


def test_one_centroid_is_the_mean_of_what_is_known() -> None:
    depth = np.array([[1, 2, np.nan], [3, np.nan, 10]], dtype=np.float32)
    np.testing.assert_allclose(centroids(depth, 1), [4.0])


@pytest.mark.parametrize("logarithmic", [False, True])
@pytest.mark.parametrize("depths", [(5.0, 50.0), (5.0, 20.0, 80.0), (4.0, 10.0, 30.0, 90.0)])
def test_separate_depths_are_found(depths: tuple[float, ...], logarithmic: bool) -> None:
    found = centroids(blobs(*depths), len(depths), logarithmic=logarithmic)
    np.testing.assert_allclose(found, depths, rtol=0.02)


def test_a_card_may_say_which_output_displacements_are_chosen_for() -> None:
    """D = centroid / (alpha beta): a third of the output wants three times the displacement."""
    far = np.array([5.0, 50.0])
    usual, longer = (CARD.model_copy(update={"best_beta": beta}) for beta in (0.3, 0.1))
    np.testing.assert_allclose(
        wanted_displacements(far, longer, 1e9), 3 * wanted_displacements(far, usual, 1e9)
    )


def test_the_same_depth_gives_the_same_centroids() -> None:
    depth = np.random.default_rng(2).uniform(1, 100, (64, 64)).astype(np.float32)
    np.testing.assert_array_equal(centroids(depth, 4), centroids(depth.copy(), 4))


def test_centroids_follow_from_the_last_ones() -> None:
    found = centroids(blobs(6.0, 60.0), 2, np.array([5.0, 50.0]))
    np.testing.assert_allclose(found, [6, 60], rtol=0.02)


def test_last_centroids_that_fit_no_pixel_do_no_harm() -> None:
    found = centroids(blobs(6.0, 60.0), 2, np.array([900.0, 1000.0]))
    np.testing.assert_allclose(found, [6, 60], rtol=0.02)


@given(st.floats(0.1, 100))
def test_scaling_the_depth_scales_log_centroids(scale: float) -> None:
    depth = blobs(5.0, 20.0, 80.0)
    plain = centroids(depth, 3, logarithmic=True)
    scaled = centroids(depth * np.float32(scale), 3, logarithmic=True)
    np.testing.assert_allclose(scaled, plain * scale, rtol=1e-3)


def test_unknown_pixels_are_left_out() -> None:
    depth = blobs(5.0, 50.0)
    holes = np.concatenate([depth, np.full_like(depth, np.nan)])
    np.testing.assert_allclose(centroids(holes, 2), centroids(depth, 2), rtol=1e-6)


def test_one_depth_everywhere_gives_it_for_each() -> None:
    np.testing.assert_allclose(centroids(np.full((32, 32), 7.0, dtype=np.float32), 3), [7, 7, 7], rtol=1e-6)


def test_too_few_pixels_give_nothing() -> None:
    assert centroids(np.array([[3, np.nan]], dtype=np.float32), 2) is None


def test_subsampling_stays_close() -> None:
    depth = np.random.default_rng(3).gamma(2, 10, (128, 128)).astype(np.float32)
    assert depth.size > 4 * MAX_SAMPLES
    sub, full = centroids(depth, 2), centroids(depth[:32, :32], 2)
    np.testing.assert_allclose(sub, full, rtol=0.15)


def test_a_zero_depth_does_not_break_the_logarithm() -> None:
    depth = blobs(5.0, 50.0)
    depth[0, 0] = 0
    assert np.isfinite(centroids(depth, 2, logarithmic=True)).all()


def test_the_wanted_displacement_is_the_papers() -> None:
    # 40 m at alpha 1000/3 and beta_mean 0.4: the training displacement, 0.3 m.
    np.testing.assert_allclose(wanted_displacements(np.array([40.0, 400.0]), CARD, np.inf), [0.3, 3.0])


def test_the_wanted_displacement_is_limited() -> None:
    np.testing.assert_allclose(wanted_displacements(np.array([40.0, 400.0]), CARD, 1.0), [0.3, 1.0])


def test_a_network_that_sweeps_sees_best_what_moved_by_fewer_pixels() -> None:
    """Beta 0.13, not the paper's 0.4: D = 39 m / (100 m / 0.3 m * 0.13)."""
    np.testing.assert_allclose(wanted_displacements(np.array([39.0]), swept_card(), np.inf), [0.9])
