"""Work on a Ray cluster: joining one, and keeping just enough tasks ahead of whoever takes the results."""

from __future__ import annotations

import logging
import os
import socket
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from itertools import islice
from typing import Any, TypeVar

from flightdepth.errors import BadInput, FlightDepthError

KNOCK_S = 5.0
LONGEST_CAUSE = 200  # characters of somebody else's error
Work = TypeVar("Work")
Ticket = TypeVar("Ticket")


def ahead(work: Iterable[Work], submit: Callable[[Work], Ticket], most: int) -> Iterator[Ticket]:
    """Tickets in the order of the work, `most` submitted at any time, the one that is taken among them."""
    rest = iter(work)
    waiting = deque(submit(each) for each in islice(rest, most))
    while waiting:
        yield waiting.popleft()
        waiting.extend(submit(each) for each in islice(rest, 1))


@contextmanager
def cluster(ray: Any, address: str | None) -> Iterator[int]:
    """The cores of a cluster that is ours for a while: the one at `address` ("auto": where Ray says), else one on this
    machine. One that this process has joined already is used as it is.
    """
    os.environ.setdefault("RAY_IGNORE_UNHANDLED_ERRORS", "1")  # the first failure is raised, which is enough
    joined = ray.is_initialized()
    if not joined:
        if address not in (None, "auto"):
            _knock(address)
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # nothing is reported to anybody
        quiet = {"logging_level": logging.ERROR, "log_to_driver": False}
        try:
            ray.init(address=address or "local", **quiet, **({} if address else {"include_dashboard": False}))
        except (ConnectionError, ValueError, RuntimeError) as error:
            raise BadInput(
                "--address", expected="a Ray cluster", got=f"{address} ({_short(error)})"
            ) from error
    try:
        yield max(1, int(ray.cluster_resources().get("CPU", 1)))
    finally:
        if not joined:
            ray.shutdown()


def failed(what: str, error: Exception) -> FlightDepthError:
    """One line for what went wrong in a task; its own error where it raised one."""
    cause = getattr(error, "cause", None) or error
    if isinstance(cause, FlightDepthError):
        return cause
    return FlightDepthError(f"{what} on Ray: {type(cause).__name__}: {_short(cause)}")


def _knock(address: str) -> None:
    """Ray itself tries for minutes where nobody answers."""
    expected = "HOST:PORT of a Ray cluster's head, or auto"
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not (host and port.isdecimal()):
        raise BadInput("--address", expected=expected, got=address)
    try:
        socket.create_connection((host, int(port)), KNOCK_S).close()
    except (OSError, OverflowError) as error:
        raise BadInput("--address", expected=expected, got=f"{address} ({error})") from error


def _short(error: BaseException) -> str:
    lines = str(error).strip().splitlines() or [type(error).__name__]
    return lines[0][:LONGEST_CAUSE]
