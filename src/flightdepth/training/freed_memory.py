"""Memory that a step frees is kept for the next: the kernel would clear each page anew, which takes time."""

from __future__ import annotations

import ctypes
import sys

M_TRIM_THRESHOLD, M_MMAP_MAX = -1, -4  # of malloc.h
NEVER = 2**31 - 1


def keep_freed_memory() -> bool:
    """From now on this process gives freed memory back at its end only; False where the C library has no such knob.

    Without it glibc maps every tensor of over 32 MiB anew and unmaps it: some hundred thousand page faults a minute.
    """
    if sys.platform != "linux":
        return False
    libc = ctypes.CDLL(None)
    if not hasattr(libc, "mallopt"):
        return False
    return bool(libc.mallopt(M_MMAP_MAX, 0) and libc.mallopt(M_TRIM_THRESHOLD, NEVER))
