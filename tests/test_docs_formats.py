"""The commands and snippets of the docs' parts about Still Box, in their order, with few scenes."""

import gc
import re
import shlex
import warnings
from pathlib import Path

import numpy as np
import pytest

import flightdepth as fd
from flightdepth import cli
from flightdepth.evaluation.network import evaluate_network
from flightdepth.stillbox import PairRule, Picture, TestSet, shards

DOCS = Path(__file__).parents[1] / "docs"
TEXT = (DOCS / "stillbox-disk.md").read_text("utf-8")
COMMANDS = [line for block in re.findall(r"```sh\n(.*?)```", TEXT, re.DOTALL) for line in block.splitlines()]
FOLDER, READ, SHARDS = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
LOOP, MEASURE = re.findall(r"```python\n(.*?)```", (DOCS / "stillbox.md").read_text("utf-8"), re.DOTALL)


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    """A folder where all commands ran, with small pictures and ten scenes instead of a thousand, one a shard."""
    folder = tmp_path_factory.mktemp("docs")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(shards, "SCENES_PER_SHARD", 1)
        for command in COMMANDS:
            _, *words = shlex.split(command)
            words = ["10" if word == "1000" else word for word in words]
            assert cli.main([*words, "--size", "16x16", "--procedural", "2"]) == 0
    return folder


def run(snippet, **names):
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", ResourceWarning
        )  # short snippets leave files to the garbage collector
        exec(snippet, names)
        gc.collect()
    return names


def test_numpy_and_opencv_read_the_folder(rendered, monkeypatch):
    monkeypatch.chdir(rendered)
    names = run(FOLDER)
    assert [image.shape for image in names["images"]] == [(16, 16, 3)] * 10
    assert all(depth_m.shape == (16, 16) and depth_m.min() > 0 for depth_m in names["depths_m"])
    assert names["focal_px"] == pytest.approx(8)
    assert np.linalg.norm(names["metres_a_frame"]) == pytest.approx(0.1)


def test_this_package_reads_the_folder(rendered, monkeypatch):
    monkeypatch.chdir(rendered)
    names = run(READ)
    assert (len(names["learnt_from"]), len(names["held_out"])) == (160, 40)
    assert names["previous"].shape == names["current"].shape == (*names["depth_m"].shape, 3) == (16, 16, 3)
    assert np.linalg.norm(names["displacement"]) == pytest.approx(0.3)


def test_pairs_are_drawn_for_a_loop_of_ones_own():
    names = run(LOOP.replace("128", "32").replace("200", "2").replace("1000", "1"))
    batch = names["batch"]
    assert batch.pairs.shape == (32, 32, 32, 6)
    assert batch.target_m.shape == (32, 32, 32)
    assert all(np.linalg.norm(pair.displacement) < 0.6001 for pair in batch.each)
    assert all(pair.camera.fx == pytest.approx(16) for pair in batch.each)


@pytest.mark.usefixtures("few_fixed_textures")
def test_a_network_of_ones_own_is_measured_as_ours_are():
    network, camera = fd.load_network("depthnet-256"), fd.Camera(64, 64, 128, 128, 31.5, 31.5)
    picture, rule = Picture(width=64, height=64, full_width=256), PairRule(nominal_shift=3)

    def mine(previous, current):
        return network.predict([previous], current, [0.3], camera).depth_m[0]

    found = run(MEASURE.replace("300", "2"), picture=picture, PairRule=PairRule, mine=mine)["figures"]
    theirs = evaluate_network(network, TestSet(picture, rule, scenes=2), set_name="rooms")["network"]
    for name in ("l1_m", "rmse_m", "abs_rel", "delta", "known"):
        assert found[name] == pytest.approx(theirs[name])
    assert found["depth_bins"][1] == pytest.approx(theirs["depth_bins"][1])


def test_webdataset_reads_the_shards(rendered, monkeypatch):
    pytest.importorskip("webdataset", reason="needs flightdepth[cluster]")
    monkeypatch.chdir(rendered)
    names = run(SHARDS)
    assert names["image"].shape == (16, 16, 3)
    assert names["depth_m"].shape == (16, 16)
    assert np.linalg.norm(names["speed"]) == pytest.approx(1)


def test_the_set_was_made_larger(rendered):
    assert (rendered / "stillbox-64" / "01" / "metadata.json").exists()
