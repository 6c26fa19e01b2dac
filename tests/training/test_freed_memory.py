"""Memory that is freed stays with the process: a page is cleared once, however often it is used again."""

import subprocess
import sys

import pytest

ROUNDS, PAGES = 10, 16384  # of 64 MiB, which glibc always gives back

SCRIPT = f"""
import resource
import torch
from flightdepth.training.freed_memory import keep_freed_memory

def faults():
    torch.ones({PAGES} * 1024)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range({ROUNDS}):
        torch.ones({PAGES} * 1024)
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

print(faults())
assert keep_freed_memory()
print(faults())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="other C libraries have no such knob")
def test_a_page_is_cleared_once():
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    given_back, kept = map(int, done.stdout.split())
    assert given_back > 0.9 * ROUNDS * PAGES
    # Once or twice, mostly; a busy machine may take pages away meanwhile.
    assert kept < 0.8 * given_back
