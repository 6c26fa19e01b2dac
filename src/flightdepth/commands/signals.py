"""What ends a command from outside: Ctrl-C, SIGTERM (service managers, batch systems), SIGHUP (a lost terminal)."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from flightdepth.commands.terminal import mention


@contextmanager
def stop_request(told: str | None = None, *, insist: bool = True) -> Iterator[threading.Event]:
    """An event that Ctrl-C, SIGTERM and SIGHUP set, so that what is under way is finished; from the main thread only.

    told    a line to say then
    insist  whether a second one ends at once, by KeyboardInterrupt; else it says no more than the first
    """
    stop = threading.Event()

    def request(*_: object) -> None:
        if stop.is_set():
            if insist:
                raise KeyboardInterrupt
            return
        stop.set()
        if told is not None:
            mention(told)

    numbers = [signal.SIGINT, signal.SIGTERM]
    lost = getattr(signal, "SIGHUP", None)  # not on Windows
    if lost is not None and signal.getsignal(lost) is not signal.SIG_IGN:  # as under nohup
        numbers.append(lost)
    before = {number: signal.signal(number, request) for number in numbers}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
