from itertools import pairwise

import numpy as np
import pytest

from flightdepth.renderers.surfaces import LINEAR, texture_colour
from flightdepth.scenes.textures import EDGE, Textures

PLACES = np.random.default_rng(0).uniform(0, 1, (400, 2))


@pytest.fixture(scope="module")
def noise() -> Textures:
    return Textures.from_images(np.random.default_rng(1).integers(0, 256, (1, EDGE, EDGE, 3), dtype=np.uint8))


def colours(textures, footprint, places=PLACES) -> np.ndarray:
    return np.array([texture_colour(textures.texels, 0, u, v, footprint) for u, v in places])


def test_a_pixel_as_small_as_a_texel_shows_the_texel(noise):
    row, column = 100, 37
    seen = texture_colour(noise.texels, 0, (column + 0.5) / EDGE, (row + 0.5) / EDGE, 0.5 / EDGE)
    np.testing.assert_allclose(seen, LINEAR[noise.texels[0, row * EDGE + column]], rtol=1e-6)


def test_half_way_between_two_texels_is_their_mean_light(noise):
    seen = texture_colour(noise.texels, 0, 38 / EDGE, 100.5 / EDGE, 1 / EDGE)
    two = LINEAR[noise.texels[0, [100 * EDGE + 37, 100 * EDGE + 38]]]
    np.testing.assert_allclose(seen, two.mean(axis=0), rtol=1e-6)


def test_a_pixel_that_covers_all_shows_the_mean_light(noise):
    mean = LINEAR[noise.texels[0, : EDGE * EDGE]].mean(axis=0)
    np.testing.assert_allclose(colours(noise, 1.0), np.broadcast_to(mean, (400, 3)), atol=0.01)


def test_a_larger_footprint_smooths_more(noise):
    spread = [colours(noise, footprint / EDGE).std() for footprint in (1, 2, 4, 8, 16, 64)]
    assert all(b < a for a, b in pairwise(spread))


@pytest.mark.parametrize("level", range(1, 9))
def test_levels_join_without_a_step(noise, level):
    below, above = (colours(noise, 2**level / EDGE * (1 + s * 1e-9)) for s in (-1, 1))
    np.testing.assert_allclose(below, above, atol=1e-6)


def test_textures_repeat(noise):
    np.testing.assert_allclose(
        colours(noise, 1 / EDGE), colours(noise, 1 / EDGE, np.add(PLACES, [1, 2])), atol=1e-6
    )


def test_levels_and_blends_are_those_of_the_logarithm(noise):
    for footprint in np.geomspace(0.3, 3000, 200) / EDGE:
        wide = max(footprint * EDGE, 1.0)
        level = min(int(np.floor(np.log2(wide))), 8)
        share = min(wide / 2**level - 1, 1.0)
        near, far = (texture_colour(noise.texels, 0, 0.3, 0.7, 2.0**n / EDGE) for n in (level, level + 1))
        mixed = np.array(near) + share * (np.array(far) - near)
        np.testing.assert_allclose(texture_colour(noise.texels, 0, 0.3, 0.7, footprint), mixed, atol=1e-12)
