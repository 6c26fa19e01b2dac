"""Ctrl-C after networks came and went: OpenVINO gives threads a stack for signals, and takes it back."""

import subprocess
import sys
from pathlib import Path

CODE = """
import os, signal
import numpy as np
from flightdepth.runtimes.onnx_openvino import OpenVinoRuntime
from tests_networks import difference_onnx

pairs = {"pairs": np.zeros((1, 64, 64, 6), np.uint8)}
first, second = OpenVinoRuntime(difference_onnx()), OpenVinoRuntime(difference_onnx())
first(pairs), second(pairs)
del first, second
signal.signal(signal.SIGINT, lambda *_: print("heard", flush=True))
os.kill(os.getpid(), signal.SIGINT)
print("alive")
"""


def test_a_signal_is_heard_after_networks_that_lived_at_once():
    tests = Path(__file__).parent.parent
    done = subprocess.run(
        [sys.executable, "-c", CODE], cwd=tests, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == (0, "heard\nalive\n"), done.stderr
