"""What a command says whose disk is full."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from flightdepth.errors import FlightDepthError

NOT_WRITTEN = "nothing of it was written"  # of a file that appears when all of it stands


@contextmanager
def room_on_the_disk(
    out: Path, then: str = "give the same command again", *, left: str = "what stands there is valid"
) -> Iterator[None]:
    """A full disk is said in one line: what it left of `out`, and what to do once there is room."""
    try:
        yield
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        raise FlightDepthError(
            f"no room left on the disk of {out}; {left}. Free some room and {then}"
        ) from error
