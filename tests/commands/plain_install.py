"""Commands as after a plain install, without the packages of any extra."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterable

EXTRAS = ("torch", "numba", "accelerate", "onnx", "onnxruntime")


def run_without_extras(words: Iterable[object]) -> subprocess.CompletedProcess[str]:
    """A command, in a process of its own in which the extras' packages cannot be imported."""
    script = (
        f"import sys; sys.modules.update(dict.fromkeys({EXTRAS}))\n"  # None makes an import of them fail
        f"from flightdepth.cli import main\nsys.exit(main({[str(word) for word in words]}))\n"
    )
    return subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
