"""What a command needs beyond the base install."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from flightdepth.errors import MissingExtra


@contextmanager
def extra_packages(feature: str, extra: str) -> Iterator[None]:
    """Imports inside that fail for want of somebody else's package say which extra brings it."""
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name is None or error.name.split(".")[0] == "flightdepth":
            raise  # a bug of ours
        raise MissingExtra(f"{feature} ({error.name} is not installed)", extra) from error
