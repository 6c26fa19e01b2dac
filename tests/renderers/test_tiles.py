import numpy as np
import pytest
from bundled import filled

from flightdepth.renderers.antialiasing import mark_edges
from flightdepth.renderers.tiles import NOBODY, TILE, gather, sort_tile
from flightdepth.renderers.tracing import PARTS, SKY


def labels(seed: int, shape=(TILE + 3, TILE + 5)) -> np.ndarray:
    return np.random.default_rng(seed).choice([PARTS * SKY, 3, 8, 9, 27], shape).astype(np.int32)


@pytest.mark.parametrize("corner", [(0, 0), (0, TILE), (TILE, 0), (TILE, TILE), (2, 3)])
def test_each_pixel_of_a_tile_is_in_the_bundle_of_its_label(corner):
    label, (top, left) = labels(1), corner
    across, down = (np.repeat([np.arange(n) * 0.1], 3, axis=0) for n in label.shape[::-1])
    depth = np.random.default_rng(2).random(label.shape)
    heads, chain, kinds = (
        np.full(48, NOBODY),
        np.empty(TILE * TILE, np.int64),
        np.empty(TILE * TILE, np.int64),
    )
    tile, found = np.full(label.shape, NOBODY), 0
    for seen in kinds[: sort_tile(label, top, left, heads, chain, kinds)]:
        bundles, _ = filled(x=[0.0])
        count = gather(across, down, depth, chain, heads[seen + PARTS], top, left, bundles)
        row, column = (bundles[0][name][:count].astype(int) for name in ("row", "column"))
        tile[row, column] = seen
        found += count
        np.testing.assert_array_equal(bundles[0]["x"][:count], across[1, column])
        np.testing.assert_array_equal(bundles[0]["y"][:count], down[1, row])
        np.testing.assert_array_equal(bundles[0]["t"][:count], depth[row, column])
    window = slice(top, top + TILE), slice(left, left + TILE)
    assert found == label[window].size
    np.testing.assert_array_equal(tile[window], label[window])


@pytest.mark.parametrize("seed", range(3))
def test_edges_are_where_a_neighbour_differs(seed):
    rng = np.random.default_rng(seed)
    label, dark = (np.where(rng.random((9, 14)) < 0.1, 5, 1).astype(np.int32) for _ in range(2))
    both = label + 100 * dark
    edge = np.zeros(14, np.bool_)
    for row in range(1, 8):
        mark_edges(label, dark, row, edge)
        here, sides = (
            both[row, 1:-1],
            (both[row, :-2], both[row, 2:], both[row - 1, 1:-1], both[row + 1, 1:-1]),
        )
        np.testing.assert_array_equal(edge[1:-1], np.any([here != side for side in sides], axis=0))
