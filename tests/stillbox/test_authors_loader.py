"""Our folders, read by the rules of the authors' loaders."""

import json

import numpy as np
import pytest
from authors_loader import intrinsics, relative_poses, scene_of, split_scenes, training_sample
from small_sets import A_FOLDER, as_rendered, render_small, small_source

from flightdepth.stillbox import original_layout
from flightdepth.stillbox.stored import open_stored_set

SCENES, FRAMES = 10, 5
SOURCE = small_source(frames=FRAMES, orientation_noise_rad=0.02)
MIRROR = np.diag([1.0, -1.0, 1.0])  # right, up, forward <-> right, down, forward


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    """Ten scenes in four folders."""
    folder = tmp_path_factory.mktemp("sets") / "set"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(original_layout, "SCENES_PER_FOLDER", A_FOLDER)
        render_small(folder, scenes=SCENES, source=SOURCE)
    return folder


def drawn(root, scene):
    """The scene as it was drawn."""
    number = int(scene["subdir"]) * A_FOLDER + int(scene["imgs"][0].split("_")[1])
    return as_rendered(SOURCE, number)


def test_four_fifths_train(root):
    train, tests = split_scenes(root)
    assert len(train) == 8
    assert len(tests) == (SCENES - 8 - 1) * (FRAMES - 3)


def test_the_test_samples_are_there(root):
    for pictures, depth, moved in split_scenes(root)[1]:
        assert all((root / name).exists() for name in (*pictures, depth))
        assert np.linalg.norm(moved) == pytest.approx(0.3, rel=1e-5)


@pytest.mark.parametrize(("i1", "i2"), [(0, 3), (4, 2), (1, 1)])
def test_a_training_sample_is_the_pair(root, i1, i2):
    scene = split_scenes(root)[0][0]
    pictures, target, moved = training_sample(root, scene, i1, i2)
    geometry, rendered = drawn(root, scene)
    for picture, i in zip(pictures, (i1, i2), strict=True):
        assert np.abs(picture.astype(float) - rendered.images[i]).mean() < 6
    near = rendered.depth_m[i2] * 3 / abs(i2 - i1) if i1 != i2 else np.full((12, 16), 100)
    assert target == pytest.approx(np.clip(near, 0, 100), rel=1e-6)
    expected = geometry.camera_position[3] - geometry.camera_position[0]
    expected = geometry.world_from_camera[0].T @ expected * [1, -1, 1]
    assert moved == pytest.approx(expected * (1 if i2 >= i1 else -1), abs=1e-6)


def test_poses_are_the_scenes(root):
    scene = split_scenes(root)[0][0]
    geometry, _ = drawn(root, scene)
    indices = [0, 2, 4]
    for pose, i in zip(relative_poses(scene, indices), indices, strict=True):
        turn = geometry.world_from_camera[4].T @ geometry.world_from_camera[i]
        assert pose[:, :3] == pytest.approx(MIRROR @ turn @ MIRROR, abs=1e-9)
        moved = geometry.camera_position[i] - geometry.camera_position[4]
        assert pose[:, 3] == pytest.approx(MIRROR @ geometry.world_from_camera[4].T @ moved, abs=1e-9)


def test_the_evaluation_finds_camera_and_scene(root):
    metadata = json.loads((root / "01" / "metadata.json").read_text())
    assert intrinsics(metadata) == (pytest.approx(8), 16, 12)
    for place, scene in enumerate(metadata["scenes"]):
        assert scene_of(f"01/{scene['imgs'][2]}", metadata) is metadata["scenes"][place]


def test_our_reader_splits_as_theirs(root):
    theirs = [(scene["subdir"], scene["imgs"]) for scene in split_scenes(root)[0]]
    ours = [(place.name, facts["imgs"]) for place, facts in open_stored_set(root).split()[0].entries]
    assert ours == theirs
