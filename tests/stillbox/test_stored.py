"""Sets in the original layout, read back."""

import json
import random
import shutil
from contextlib import suppress

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from small_sets import A_FOLDER, SCENES, as_rendered, render_small, small_source

from flightdepth.errors import BadInput
from flightdepth.stillbox import original_layout
from flightdepth.stillbox.set_on_disk import Layout
from flightdepth.stillbox.stored import open_stored_set

SOURCE = small_source(orientation_noise_rad=0.01)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Seven scenes in three folders; not to be changed."""
    folder = tmp_path_factory.mktemp("stored") / "set"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(original_layout, "SCENES_PER_FOLDER", A_FOLDER)
        render_small(folder, source=SOURCE)
    return folder


@pytest.fixture
def copy(folder, tmp_path):
    """A folder of its own to damage."""
    return shutil.copytree(folder, tmp_path / "set")


def test_a_set_comes_back(folder):
    stored = open_stored_set(folder)
    assert (stored.width, stored.height, stored.horizontal_fov_deg) == (16, 12, 90)
    for number, scene in enumerate(stored):
        drawn, rendered = as_rendered(SOURCE, number)
        assert scene.frames == 3
        assert np.array_equal(scene.depth_m, rendered.depth_m.clip(0.1, 200))
        assert np.abs(scene.images.astype(float) - rendered.images).mean() < 6
        assert scene.displacement(0, 2) == pytest.approx(drawn.displacement(0, 2), abs=1e-9)
    assert number == SCENES - 1


def test_the_split_is_of_scenes_and_follows_from_its_seed(folder):
    stored = open_stored_set(folder)
    train, rest = stored.split()

    def names(part):
        return [(place.name, scene["imgs"][0]) for place, scene in part.entries]

    assert (len(train), len(rest)) == (5, 2)
    assert sorted(names(train) + names(rest)) == names(stored)
    assert names(stored.split()[0]) == names(train)
    assert names(stored.split(seed=1)[0]) != names(train)


def test_a_folder_as_the_authors_wrote_it(copy):
    """Field of view and resolution in `args` only, no `orientation`: what their code falls back on."""
    for path in copy.glob("*/metadata.json"):
        facts = json.loads(path.read_text())
        scenes = [{k: v for k, v in scene.items() if k != "orientation"} for scene in facts["scenes"]]
        args = {"fov": facts["fov"], "resolution": facts["resolution"]}
        path.write_text(json.dumps({"args": args, "scenes": scenes}))
    (copy / "stillbox.json").unlink()
    stored = open_stored_set(copy)
    assert (stored.width, len(stored)) == (16, SCENES)
    assert np.array_equal(stored.scene(0).world_from_camera, np.repeat(np.eye(3)[None], 3, axis=0))


def test_a_camera_that_is_said_not_to_turn_does_not(copy):
    """Orientations that were all the same were taken for a turn, and the set was refused."""
    assert open_stored_set(copy).turns
    for path in copy.glob("*/metadata.json"):
        facts = json.loads(path.read_text())
        for scene in facts["scenes"]:
            scene["orientation"] = [[1.0, 0.0, 0.0, 0.0]] * len(scene["imgs"])
        path.write_text(json.dumps(facts))
    assert not open_stored_set(copy).turns


def test_a_set_without_arguments(copy):
    for path in copy.glob("*/metadata.json"):
        path.write_text(json.dumps(json.loads(path.read_text()) | {"args": None}))
    assert open_stored_set(copy).renderer == "unknown"


def test_no_set_at_all(tmp_path):
    with pytest.raises(BadInput, match=r"expected sub-folders with metadata\.json, got none"):
        open_stored_set(tmp_path)


def test_shards_are_no_folders(tmp_path):
    render_small(tmp_path / "set", Layout.SHARDS)
    with pytest.raises(BadInput, match=r"got none\. Shards are not read: render with --format folder"):
        open_stored_set(tmp_path / "set")


def test_a_set_of_empty_folders(copy):
    for path in copy.glob("*/metadata.json"):
        path.write_text(json.dumps(json.loads(path.read_text()) | {"scenes": []}))
    with pytest.raises(BadInput, match="expected at least one scene, got none"):
        open_stored_set(copy)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda f: f.pop("scenes"), "got no 'scenes'"),
        (lambda f: f["scenes"][1].pop("imgs"), "got no 'imgs'"),
        (lambda f: f["scenes"][1]["depth"].pop(), "scene 1, depth: expected one for each of 3 imgs, got 2"),
        (lambda f: f["scenes"][1]["orientation"].pop(), "scene 1, orientation: expected one for each"),
        (lambda f: f["scenes"][0]["imgs"].__setitem__(0, "../../a.jpg"), "expected names of files beside"),
        (lambda f: f["scenes"][0].update(speed=[1, 2]), "expected that of a Still Box folder"),
        (lambda f: f["scenes"][0].update(speed=["a", 2, 3]), "expected that of a Still Box folder"),
        (lambda f: f["scenes"][0].update(time_step=float("nan")), "speed .* and time_step, finite"),
        # Once an AttributeError, and errors of the depths below that named no file or spoke of another key.
        (lambda f: f.update(args=[1]), "expected that of a Still Box folder"),
        (lambda f: f.update(fov=200), "field of view: expected more than 0 and less than 180 degrees"),
        (
            lambda f: f["scenes"][1]["orientation"].__setitem__(0, [0] * 4),
            "scene 1, quaternion: expected four",
        ),
        (
            lambda f: f["scenes"][1].update(position=[[0, 0, 0]]),
            "scene 1, position: expected one for each of 3",
        ),
        (lambda f: f.update(resolution=[64, 64]), "expected one resolution, field of view"),
        (lambda f: f.update(resolution=[64]), "expected that of a Still Box folder"),
    ],
)
def test_metadata_that_does_not_fit_is_named(copy, change, said):
    path = copy / "01" / "metadata.json"
    facts = json.loads(path.read_text())
    change(facts)
    path.write_text(json.dumps(facts))
    with pytest.raises(BadInput, match=said) as error:
        open_stored_set(copy)
    assert str(path) in str(error.value)


@given(st.integers(0, 2**32), st.integers(0, 400))
def test_trash_in_metadata_is_bad_input(folder, seed, cut):
    path = folder.parent / "trash" / "00" / "metadata.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    data = bytearray((folder / "00" / "metadata.json").read_bytes()[: -cut or None])
    for place in np.random.default_rng(seed).integers(len(data), size=5):
        data[place] = int(seed % 256)
    path.write_bytes(data)
    with suppress(BadInput):
        open_stored_set(path.parent.parent)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
@pytest.mark.parametrize("name", ["RGB_0001_02.jpg", "depth_0001_02.npy"])
def test_a_file_that_was_cut_is_named(copy, name, share):
    path = copy / "00" / name
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    stored = open_stored_set(copy)
    stored.scene(0)
    with pytest.raises(BadInput, match=name):
        stored.scene(1)


@pytest.mark.parametrize("name", ["RGB_0001_02.jpg", "depth_0001_02.npy"])
def test_a_file_that_is_gone_is_named(copy, name):
    (copy / "00" / name).unlink()
    with pytest.raises(BadInput, match=name):
        open_stored_set(copy).scene(1)


@pytest.mark.parametrize(
    ("array", "said"),
    [
        (np.ones((12, 15), np.float32), "got float32"),
        (np.ones((12, 16), np.int32), "got int32"),
        (np.zeros((12, 16), np.float32), "expected depth above 0 everywhere, got 192 others"),
        (np.full((12, 16), np.nan), "got 192 others"),
        (np.array([None]), "allow_pickle"),
    ],
)
def test_depth_that_is_none_is_named(copy, array, said):
    np.save(copy / "00" / "depth_0001_00.npy", array)
    with pytest.raises(BadInput, match=f"depth_0001_00.npy.*{said}"):
        open_stored_set(copy).scene(1)


def test_a_picture_of_another_size_is_named(copy):
    cv2.imwrite(str(copy / "00" / "RGB_0000_01.jpg"), np.zeros((8, 8, 3), np.uint8))
    with pytest.raises(BadInput, match=r"RGB_0000_01\.jpg: expected an image of 16x12 px, got 8x8"):
        open_stored_set(copy).scene(0)


def test_sub_folders_from_the_hundredth_on_stand_by_their_number(folder, tmp_path):
    """By name 100 came before 11; the split is of the scenes in that order, as it always was."""
    facts = json.loads((folder / "00" / "metadata.json").read_text())
    for number in range(103):
        place = tmp_path / f"{number:02d}"
        place.mkdir()
        (place / "metadata.json").write_text(json.dumps(facts | {"scenes": facts["scenes"][:2]}))
    stored = open_stored_set(tmp_path)
    assert [int(place.name) for place, _ in stored.entries[::2]] == list(range(103))
    by_name = [(name, n) for name in sorted(f"{number:02d}" for number in range(103)) for n in range(2)]
    random.Random(0).shuffle(by_name)
    split = [
        (place.name, int(scene["imgs"][0][6:8])) for part in stored.split() for place, scene in part.entries
    ]
    assert split == by_name
