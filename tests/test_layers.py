"""Which package may import which, and what the base install can do without."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "flightdepth"
# The parts that run on a drone; they must work without the extras.
BASE = ("weights", "runtimes", "flight", "ranges", "outputs", "commands")
EXTRAS = ("torch", "numba", "accelerate", "onnx", "onnxscript", "onnxruntime", "tensorboard")


def test_the_layers_hold():
    pytest.importorskip("importlinter")
    lint = Path(sys.executable).with_name("lint-imports")
    done = subprocess.run([lint, "--no-cache"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_base_install_imports_without_extras():
    names = sorted(
        ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)
        for part in BASE
        for path in (PACKAGE / part).rglob("*.py")
        if path.name != "__init__.py"
    )
    script = (
        "import sys, importlib\n"
        f"sys.modules.update(dict.fromkeys({EXTRAS}))\n"  # None makes an import of them fail
        f"for name in ['flightdepth.cli', *{names}]: importlib.import_module(name)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
