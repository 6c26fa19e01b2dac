"""The snippets of docs/files.md, and the README's first, run on a folder that the writer wrote."""

import re
from pathlib import Path

import numpy as np
import pytest

from flightdepth.camera import Camera
from flightdepth.flight import Frame
from flightdepth.outputs import FlightWriter, Preview, Source
from flightdepth.outputs.frame_table import COLUMNS
from flightdepth.outputs.poses import COLUMNS as POSE_COLUMNS
from flightdepth.ranges import RangedDepth
from flightdepth.weights.card import NetworkCard

TEXT = (Path(__file__).parents[1] / "docs" / "files.md").read_text(encoding="utf-8")
PNG, NPZ, FOLDER, _ = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
CAMERA = Camera.from_fov(64, 48, 90)
CARD = NetworkCard(
    name="none",
    architecture="DepthNet",
    base_width=16,
    activation="none",
    nominal_shift=3,
    D0_m=0.3,
    depth_min_m=0,
    depth_max_m=100,
    focal_px=64,
    width=64,
    height=64,
    samples=0,
)


def result() -> RangedDepth:
    """Left half unknown, right half 12.34 m."""
    depth_m = np.full((48, 64), 12.34, np.float32)
    depth_m[:, :32] = np.nan
    nothing = np.full_like(depth_m, np.nan)
    confidence = np.where(np.isfinite(depth_m), np.float32(1), np.float32(0))
    one = np.ones(1)
    return RangedDepth(
        depth_m,
        confidence,
        0.2 * depth_m,
        depth_m[None],
        one.astype(np.int64),
        one,
        one,
        nothing,
        nothing,
        1.0,
    )


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Run a snippet beside an `out` that holds 13 frames; the variables it made."""

    def call(snippet: str, depth_format: str) -> dict:
        source = Source(flight="a.mp4", telemetry="a.csv", camera=CAMERA, network=CARD)
        with FlightWriter(tmp_path / "out", source, Preview(64, 48), depth_format=depth_format) as writer:
            for i in range(13):
                writer.add(Frame(i, i * 33_000_000, np.zeros((48, 64, 3), np.uint8)), result())
        monkeypatch.chdir(tmp_path)
        names: dict = {}
        exec(snippet, names)
        return names

    return call


@pytest.mark.parametrize(
    ("snippet", "depth_format"), [(PNG, "png"), (NPZ, "npz"), (FOLDER, "png"), (FOLDER, "npz")]
)
def test_a_snippet_reads_depth(run, snippet, depth_format):
    depth_m = run(snippet, depth_format)["depth_m"]
    assert depth_m[:, 32:] == pytest.approx(12.34)
    assert np.isnan(depth_m[:, :32]).all()


def test_the_readmes_snippet_reads_depth(run):
    depth_m = run(re.findall(r"```python\n(.*?)```", README, re.DOTALL)[0], "png")["depth_m"]
    assert depth_m[:, 32:] == pytest.approx(12.34)
    assert (depth_m[:, :32] == 0).all()


@pytest.mark.parametrize(("snippet", "depth_format"), [(PNG, "png"), (NPZ, "npz"), (FOLDER, "png")])
def test_a_snippet_reads_sigma(run, snippet, depth_format):
    sigma_m = run(snippet, depth_format)["sigma_m"]
    assert sigma_m[:, 32:] == pytest.approx(0.2 * 12.34, rel=1 / 64 + 0.002)
    assert np.isnan(sigma_m[:, :32]).all()


@pytest.mark.parametrize("snippet", [PNG, FOLDER])
def test_a_snippet_reads_confidence(run, snippet):
    confidence = run(snippet, "png")["confidence"]
    assert (confidence == np.isfinite(result().depth_m)).all()


def test_the_folder_snippet_gives_the_camera(run):
    assert run(FOLDER, "png")["camera"] == CAMERA


def test_every_column_is_described():
    frames, poses = (TEXT.split(f"## {name}")[1].split("\n## ")[0] for name in ("frames.csv", "poses.csv"))
    assert re.findall(r"^\| `(\w+)`", frames, re.MULTILINE) == list(COLUMNS)
    first_cells = " ".join(row.split("|")[1] for row in poses.splitlines() if row.startswith("| `"))
    assert re.findall(r"`(\w+)`", first_cells) == list(POSE_COLUMNS)
