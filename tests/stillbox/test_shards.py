"""Sets as WebDataset shards."""

import gc
import json
import tarfile
import warnings

import cv2
import numpy as np
import pytest
from small_sets import A_FOLDER, SCENES, TEXTURES, as_rendered, render_small, small_source, tree

from flightdepth.stillbox import shards
from flightdepth.stillbox.set_on_disk import Layout

SOURCE = small_source()


@pytest.fixture
def folder(monkeypatch, tmp_path):
    """Seven scenes in three shards."""
    monkeypatch.setattr(shards, "SCENES_PER_SHARD", A_FOLDER)
    render_small(tmp_path / "set", Layout.SHARDS)
    return tmp_path / "set"


def test_what_is_there(folder):
    tars = [f"small-00000{n}.tar" for n in range(3)]
    assert sorted(path.name for path in folder.iterdir()) == [*tars, "stillbox.json"]


def test_members_lie_scene_by_scene(folder):
    with tarfile.open(folder / "small-000002.tar") as tar:
        assert [member.name for member in tar] == [
            "000006.json",
            *(f"000006.0{frame}.{kind}" for frame in range(3) for kind in ("jpg", "npy")),
        ]


def test_headers_tell_neither_time_nor_owner(folder):
    with tarfile.open(folder / "small-000000.tar") as tar:
        assert {(m.mtime, m.uid, m.gid, m.uname, m.gname, m.mode) for m in tar} == {(0, 0, 0, "", "", 0o644)}


def test_the_same_set_is_the_same_bytes(folder, tmp_path):
    render_small(tmp_path / "again", Layout.SHARDS)
    assert tree(tmp_path / "again") == tree(folder)


def test_webdataset_reads_them(folder):
    webdataset = pytest.importorskip("webdataset", reason="needs flightdepth[cluster]")
    urls = str(folder / "small-{000000..000002}.tar")
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", ResourceWarning
        )  # webdataset 1.0 leaves its files to the garbage collector
        samples = list(webdataset.WebDataset(urls, shardshuffle=False).decode("rgb8"))
        gc.collect()
    assert [sample["__key__"] for sample in samples] == [f"{n:06d}" for n in range(SCENES)]
    for number, sample in enumerate(samples):
        scene, rendered = as_rendered(SOURCE, number)
        for frame in range(scene.frames):
            assert np.array_equal(sample[f"{frame:02d}.npy"], rendered.depth_m[frame].clip(0.1, 200))
            assert np.abs(sample[f"{frame:02d}.jpg"].astype(float) - rendered.images[frame]).mean() < 6
        facts = sample["json"]
        assert (facts["number"], facts["fov"], facts["resolution"], facts["length"]) == (
            number,
            90,
            [16, 12],
            3,
        )
        assert np.linalg.norm(facts["speed"]) == pytest.approx(1)


def test_nothing_is_left_of_a_shard_that_is_not_whole(folder, tmp_path):
    with shards.Shards(tmp_path, "small", SOURCE.arguments(TEXTURES), SCENES) as target:
        for number in range(4):
            target.add(SOURCE.encoded(number, TEXTURES))
    assert [path.name for path in tmp_path.glob("small*")] == ["small-000000.tar"]
    assert not list(tmp_path.glob(".small*"))


def test_a_shard_holds_what_the_folder_holds(folder, tmp_path):
    render_small(tmp_path / "folder")
    with tarfile.open(folder / "small-000000.tar") as tar:
        picture = tar.extractfile("000001.02.jpg").read()
        facts = json.loads(tar.extractfile("000001.json").read())
    assert picture == (tmp_path / "folder" / "00" / "RGB_0001_02.jpg").read_bytes()
    scene = json.loads((tmp_path / "folder" / "00" / "metadata.json").read_text())["scenes"][1]
    assert facts["speed"] == scene["speed"]
    assert cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR).shape == (12, 16, 3)
