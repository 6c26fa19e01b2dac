"""Memory that is freed stays with the process: a page is cleared once, however often it is used again."""

import subprocess
import sys

import pytest

ROUNDS, PAGES = 10, 16384  # of 64 MiB, which glibc always gives back

SCRIPT = f"""
import resource, sys
import torch
from flightdepth.training.freed_memory import keep_freed_memory
if sys.argv[1] == "kept":
    assert keep_freed_memory()
torch.ones({PAGES} * 1024)
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range({ROUNDS}):
    torch.ones({PAGES} * 1024)
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


def faults(how):
    done = subprocess.run([sys.executable, "-c", SCRIPT, how], capture_output=True, text=True, check=True)
    return int(done.stdout)


@pytest.mark.skipif(sys.platform != "linux", reason="other C libraries have no such knob")
def test_a_page_is_cleared_once():
    given_back = faults("as it is")
    assert given_back > 0.9 * ROUNDS * PAGES
    # Once or twice, mostly; a busy machine may take pages away meanwhile.
    assert faults("kept") < 0.8 * given_back
