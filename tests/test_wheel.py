"""The wheel: small enough, and it works alone, from any folder."""

import os
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

from flightdepth.commands.demo import CALIBRATION, LOG, SAMPLE, VIDEO
from flightdepth.weights.store import shipped_networks

ROOT = Path(__file__).parents[1]
MAX_MB = 60
PIP = (sys.executable, "-m", "pip", "--python")  # works on another environment, which needs none of its own


def call(*command, **options):
    done = subprocess.run(command, capture_output=True, text=True, check=False, **options)
    assert done.returncode == 0, f"{command}\n{done.stdout[-2000:]}\n{done.stderr[-4000:]}"
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dist")
    call(sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(folder), str(ROOT))
    (path,) = folder.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """The Python of an environment that holds the wheel and its base dependencies, nothing else."""
    folder = tmp_path_factory.mktemp("alone")
    venv.create(folder)
    python = folder / ("Scripts" if os.name == "nt" else "bin") / "python"
    call(*PIP, str(python), "install", "--quiet", "--no-compile", str(wheel))
    return python


def test_the_wheel_is_small_enough(wheel):
    assert wheel.stat().st_size < MAX_MB * 1_000_000


def test_the_wheel_brings_no_pytorch(installed):
    names = call(*PIP, str(installed), "list", "--format", "freeze").lower()
    assert "flightdepth==" in names
    assert [name for name in ("torch==", "numba==", "onnxruntime==") if name in names] == []


def test_the_wheel_holds_the_sample_and_every_network(wheel):
    with zipfile.ZipFile(wheel) as files:
        held = set(files.namelist())
    folders = (ROOT / "src" / "flightdepth" / name for name in ("sample", "weights"))
    expected = {path for folder in folders for path in folder.rglob("*") if "__pycache__" not in path.parts}
    assert {path.relative_to(ROOT / "src").as_posix() for path in expected if path.is_file()} <= held


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_demo_runs_from_the_wheel(installed, tmp_path):
    call(str(installed.with_name("flightdepth")), "demo", "--network", "motion-tiny", cwd=tmp_path)
    assert list(tmp_path.rglob("preview.mp4"))


def test_the_default_network_runs_from_the_wheel(installed, tmp_path):
    """On a third of a second of the wheel's own sample: the demo above takes a quicker one."""
    (sample,) = installed.parents[1].rglob(SAMPLE.name + "/" + VIDEO.name)
    video, log, camera = (str(sample.with_name(path.name)) for path in (VIDEO, LOG, CALIBRATION))
    given = ("--telemetry", log, "--camera", camera, "--end", "0.3", "--out", "flight")
    said = call(str(installed.with_name("flightdepth")), "run", video, *given, cwd=tmp_path)
    assert " -> motion at " in said
    assert (tmp_path / "flight" / "preview.mp4").exists()


def test_the_wheel_brings_every_network(installed, tmp_path):
    listed = call(str(installed.with_name("flightdepth")), "networks", cwd=tmp_path)
    assert set(shipped_networks()) <= set(listed.split())
