"""What this machine has for this process: cores, memory."""

from __future__ import annotations

import os


def usable_cores() -> int:
    """Those that this process may run on: fewer than the machine's where a container or `taskset` keeps it to some."""
    affinity = getattr(os, "sched_getaffinity", None)  # Linux only
    return len(affinity(0)) if affinity else os.cpu_count() or 1


def memory_bytes() -> float:
    """All the memory of the machine; infinite where the system does not tell (Windows)."""
    sysconf = getattr(os, "sysconf", None)
    return sysconf("SC_PAGE_SIZE") * sysconf("SC_PHYS_PAGES") if sysconf else float("inf")
