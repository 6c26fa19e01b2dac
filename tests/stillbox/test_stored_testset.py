"""Test pairs from a set on the disk."""

import json

import numpy as np
import pytest
from small_sets import render_small, small_source

from flightdepth.errors import BadInput
from flightdepth.stillbox import StoredTestSet
from flightdepth.stillbox.stored import open_stored_set

STRIDE = 4  # of these pictures of 16x12 px


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tests") / "set"
    render_small(folder, source=small_source())
    return open_stored_set(folder)


@pytest.mark.parametrize(("D0_m", "apart_m"), [(0.01, 0.1), (0.1, 0.1), (0.14, 0.1), (0.16, 0.2), (9.0, 0.2)])
def test_frames_are_as_near_to_the_networks_displacement_as_they_come(stored, D0_m, apart_m):
    assert stored.scene(0).frames == 3  # so 0.2 m at most
    pairs = StoredTestSet(stored, D0_m, STRIDE)
    assert [np.linalg.norm(pair.displacement) for pair in pairs] == pytest.approx([apart_m] * len(stored))


def test_a_pair_is_what_the_set_holds(stored):
    pair = StoredTestSet(stored, 0.2, STRIDE).pair(1)
    scene = stored.scene(1)
    np.testing.assert_array_equal(pair.previous, scene.images[0])
    np.testing.assert_array_equal(pair.current, scene.images[2])
    np.testing.assert_array_equal(pair.depth_m, scene.depth_m[2])
    np.testing.assert_allclose(pair.displacement, scene.displacement(0, 2))
    assert pair.focal_px == stored.camera.fx


def test_pictures_are_cut_around_their_middle(stored):
    pair, scene = StoredTestSet(stored, 0.2, 8).pair(0), stored.scene(0)
    np.testing.assert_array_equal(pair.current, scene.images[2][2:10])
    np.testing.assert_array_equal(pair.depth_m, scene.depth_m[2][2:10])


def test_what_is_clipped_is_farther(stored, tmp_path):
    clipped = tmp_path / "clipped"
    render_small(clipped, source=small_source())
    for path in clipped.glob("*/depth_*.npy"):
        depth_m = np.load(path)
        depth_m[:4] = 200
        np.save(path, depth_m)
    pair = StoredTestSet(open_stored_set(clipped), 0.2, STRIDE).pair(0)
    assert np.isinf(pair.depth_m[:4]).all()
    np.testing.assert_array_equal(pair.depth_m[4:], stored.scene(0).depth_m[2][4:])


def test_sets_that_make_no_pairs_are_refused(stored, tmp_path):
    with pytest.raises(BadInput, match="expected at least 64 px, got 16x12"):
        StoredTestSet(stored, 0.3, 64)
    render_small(tmp_path / "turning", source=small_source(orientation_noise_rad=0.3))
    with pytest.raises(BadInput, match="expected a camera that does not turn"):
        StoredTestSet(open_stored_set(tmp_path / "turning"), 0.3, STRIDE)
    render_small(tmp_path / "single", source=small_source())
    for path in (tmp_path / "single").glob("*/metadata.json"):
        facts = json.loads(path.read_text())
        for scene in facts["scenes"]:
            scene.update(imgs=scene["imgs"][:1], depth=scene["depth"][:1], length=1)
        path.write_text(json.dumps(facts))
    with pytest.raises(BadInput, match="expected 2 frames a scene, got 1"):
        StoredTestSet(open_stored_set(tmp_path / "single"), 0.3, STRIDE)
