"""The one way in which functions here are compiled: cached on disk, without the GIL, the same sums everywhere.

Nothing is fused or reordered (no fast-math), so that depth has the same bits on every machine, and infinities,
which mark misses, stay what they are. Compiled code makes no arrays and so counts no references to them: two
atomic updates per array and call were more than half of a frame's time.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeVar

import numba

from flightdepth.scenes import textures

logger = logging.getLogger(__name__)

OPTIONS: dict[str, Any] = {
    "nogil": True,
    "cache": True,
    "error_model": "numpy",
    "forceinline": True,
    "_nrt": False,
}
F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """Compile with numba on first call; the signature for readers and for mypy stays the Python one."""
    wrapped: F = numba.njit(function, **OPTIONS)
    # Code cached for a function holds the code of what it calls, but numba asks only whether its own file changed.
    files = wrapped._cache._cache_file  # type: ignore[attr-defined]
    files._source_stamp = _newest_source()
    # numba numbers what it keeps: two processes that compile at once would take the same number, and run wrong code.
    files._data_name = partial(_own_name, files._data_name)
    return wrapped


@cache
def announce_compiling(function: Callable[..., object]) -> None:
    """Say once in a process that the first call of a function waits a minute, where it does."""
    if not function._cache._cache_file._load_index():  # type: ignore[attr-defined]
        logger.warning("the renderer is compiled first, once on this machine: about a minute")


def _own_name(numbered: Callable[[int], str], number: int) -> str:
    """A file name that no other process gives."""
    name = Path(numbered(number))
    return f"{name.stem}.{os.getpid()}{name.suffix}"


@cache
def _newest_source() -> tuple[float, int]:
    """Time of the last change in this package and in what its compiled code takes from others, and their bytes."""
    stats = [path.stat() for path in (*Path(__file__).parent.glob("*.py"), Path(textures.__file__))]
    return max(s.st_mtime for s in stats), sum(s.st_size for s in stats)
