"""The commands and snippets of the docs' part about sets on the disk, in their order, with few scenes."""

import gc
import re
import shlex
import warnings
from pathlib import Path

import numpy as np
import pytest

from flightdepth import cli
from flightdepth.stillbox import shards

TEXT = (Path(__file__).parents[1] / "docs" / "stillbox-disk.md").read_text("utf-8")
COMMANDS = [line for block in re.findall(r"```sh\n(.*?)```", TEXT, re.DOTALL) for line in block.splitlines()]
FOLDER, SHARDS = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)


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


def run(snippet):
    names: dict = {}
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


def test_webdataset_reads_the_shards(rendered, monkeypatch):
    pytest.importorskip("webdataset", reason="needs flightdepth[cluster]")
    monkeypatch.chdir(rendered)
    names = run(SHARDS)
    assert names["image"].shape == (16, 16, 3)
    assert names["depth_m"].shape == (16, 16)
    assert np.linalg.norm(names["speed"]) == pytest.approx(1)


def test_the_set_was_made_larger(rendered):
    assert (rendered / "stillbox-64" / "01" / "metadata.json").exists()
